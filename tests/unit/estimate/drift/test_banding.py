"""Bands of a rolling shutter in a verification's photographs, and what must not be taken for them."""

import numpy as np
import pytest

from procam.estimate.drift.banding import find_banding
from procam.estimate.drift.pictures import ProjectorPhotographs, VenuePhotographs
from procam.estimate.geometry.camera_view import ScreenView
from procam.model.calibration import Calibration

SIZE = 160
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE] / SIZE
HALVES = {"south": ROWS > 0.4, "north": ROWS < 0.6}  # overlapping pictures


def photographs(calibration: Calibration, **factors: np.ndarray | float) -> VenuePhotographs:
    """Both projectors' whites by a camera with noise, times a factor each."""
    rng = np.random.default_rng(len(factors))
    on_screen = np.hypot(ROWS - 0.5, COLUMNS - 0.5) < 0.48
    shown = {}
    for name, lit in HALVES.items():
        light = np.where(lit & on_screen, 0.4 + 0.3 * COLUMNS, 0.02) * factors.get(name, 1.0)
        noise = 1 + rng.normal(0, 0.01, light.shape)
        white = (light * noise)[..., None].repeat(3, axis=-1).astype(np.float32)
        shown[name] = ProjectorPhotographs(white, 0 * white, white)
    camera = calibration.camera
    none = np.zeros((SIZE, SIZE, 3), np.float32)
    view = ScreenView(camera, none, on_screen, on_screen.astype(float))
    return VenuePhotographs(view, none, shown)


SOUTH, NORTH = (np.hypot((ROWS - row) / 0.3, (COLUMNS - 0.5) / 0.5) for row in (0.7, 0.3))


@pytest.mark.parametrize(("across", "place"), [(0, ROWS), (1, COLUMNS)])
@pytest.mark.parametrize("pulsing", [["south", "north"], ["south"]])
def test_bands_have_their_size_and_number(
    across: int, place: np.ndarray, pulsing: list[str], calibration: Calibration
) -> None:
    bands = 1 + 0.03 * np.sin(2 * np.pi * 6 * place)
    now = photographs(calibration, **dict.fromkeys(pulsing, bands))
    found = find_banding(photographs(calibration), now, pulsing)
    assert found is not None and found.across == across
    assert found.amplitude == pytest.approx(0.03, abs=3 * found.sigma) and found.sigma < 0.004
    assert found.count == pytest.approx(6, abs=0.5)
    assert f"{found.amplitude:.1%}, about {found.count:.0f} bands" in found.text


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"south": 0.8},  # a lamp that aged, though its picture ends along a row
        {"south": 0.8, "north": 1.2},
        {"south": 1 - 0.1 * ROWS, "north": 1 - 0.1 * ROWS},  # dust
        {"south": 1 + 0.3 * (ROWS - 0.7), "north": 1 - 0.3 * (ROWS - 0.3)},  # lamps turned in them
        {"south": 1 - 0.1 * SOUTH**2, "north": 1 - 0.1 * NORTH**2},  # hot spots
        {"south": 1 - 0.15 * np.exp(-(SOUTH**2) / 0.2)},  # dirt on a lens
        {"south": 1 - 0.1 * (np.abs(ROWS - 0.75) < 0.03)},  # a stripe of dirt
        {"south": 1 - 0.3 * (np.hypot(ROWS - 0.7, COLUMNS - 0.5) < 0.1)},  # a stain
    ],
)
def test_other_changes_are_no_bands(
    change: dict[str, np.ndarray | float], calibration: Calibration
) -> None:
    assert (
        find_banding(photographs(calibration), photographs(calibration, **change), HALVES) is None
    )


def test_pictures_that_moved_and_dark_ones_show_no_bands(calibration: Calibration) -> None:
    bands = 1 + 0.03 * np.sin(2 * np.pi * 6 * ROWS)
    before, now = photographs(calibration), photographs(calibration, south=bands)
    assert find_banding(before, now, []) is None
    assert find_banding(photographs(calibration, south=0.0), now, ["south"]) is None
