"""The last judge: the picture on the dome, of whatever makes a calibration, and of spoilt ones."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from looped_dome import SIZE, quick_loop
from tiny_venue import calibrated, procam

from procam.errors import CalibrationError
from procam.files.calibration import load_calibration, save_calibration
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.pose import rotation_matrix
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.workflows.comparison import compare
from procam.workflows.solve.plausible import check_calibration
from studies.seen import front, grey, seen, waves

PICTURES = grey(), front(), waves()
WORSE = 1.15  # of the errors of a whole calibration, that others may have
SPOILT = 1.5  # times one of these errors, at least, of a spoilt one
Spoil = Callable[[Calibration], Calibration]


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    with quick_loop():
        yield


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return calibrated(tmp_path_factory.mktemp("dome"), SIZE).directory


def errors(venue: Path, calibration: Path) -> np.ndarray:
    """Of what is seen of three pictures, everywhere and in seams; and the least share of a lit panel."""
    shown = [seen(venue, calibration, picture, STANDARD) for picture in PICTURES]
    return np.array([part for each in shown for part in (each.error(), each.error(each.seam))])


@pytest.fixture(scope="module")
def whole(once: Path) -> np.ndarray:
    """The errors of a whole calibration of these coarse panels."""
    found = errors(once, once / "calibrations" / "0001")
    assert (found < 0.07).all()
    return found


def newest(venue: Path) -> Path:
    return max((venue / "calibrations").glob("[0-9]*"))


WAYS = {
    "recalibrate": [("recalibrate", "{venue}", "--projector", "south")],
    "refine": [("refine", "{venue}")],
    "state": [("state", "{venue}", "full")],
    "solve": [("session", "solve", "{venue}")],
    "restore": [
        ("session", "solve", "{venue}"),
        ("venue", "use", "{venue}@1"),
    ],
}


@pytest.mark.parametrize("way", WAYS)
def test_whatever_makes_a_calibration_is_as_good_as_a_whole_one(
    way: str, venue: Path, whole: np.ndarray
) -> None:
    for command in WAYS[way]:
        ran = procam(*(part.format(venue=venue) for part in command))
        assert ran.code in (0, 1), ran  # 1 where a figure of such coarse panels misses its goal
    assert (errors(venue, newest(venue)) < WORSE * whole).all()


def test_a_bundle_that_was_opened(venue: Path, tmp_path: Path, whole: np.ndarray) -> None:
    assert procam("venue", "pack", venue, tmp_path / "dome.zip").code == 0
    ran = procam("venue", "unpack", tmp_path / "dome.zip", tmp_path / "opened", "--json")
    opened = Path(json.loads(ran.out)["venue"])
    assert procam("session", "solve", opened / "sessions" / "0001").code in (0, 1)
    assert (errors(venue, newest(opened)) < WORSE * whole).all()


def _south(change: Callable[[ProjectorCalibration], ProjectorCalibration]) -> Spoil:
    def spoil(calibration: Calibration) -> Calibration:
        south = change(calibration.projectors["south"])
        return replace(calibration, projectors={**calibration.projectors, "south": south})

    return spoil


def _gain(factor: Callable[[ProjectorCalibration], np.ndarray]) -> Spoil:
    return _south(
        lambda p: replace(
            p,
            photometry=replace(
                p.photometry, gain=(p.photometry.gain * factor(p)).astype(np.float32)
            ),
        )
    )


def _waves(projector: ProjectorCalibration) -> np.ndarray:
    """As of light that was measured by another camera than the main one."""
    direction = np.nan_to_num(projector.surface.direction)
    return 1 + 0.5 * np.sin(6 * direction[..., :1])


def _turned(projector: ProjectorCalibration) -> ProjectorCalibration:
    turn = rotation_matrix([0.0, 0.0, np.radians(4.0)]).astype(np.float32)
    surface = replace(projector.surface, direction=projector.surface.direction @ turn.T)
    return replace(projector, surface=surface)


def _swapped_gains(calibration: Calibration) -> Calibration:
    south, north = calibration.projectors["south"], calibration.projectors["north"]
    light = replace(south.photometry, gain=np.ascontiguousarray(north.photometry.gain[::-1]))
    return replace(
        calibration,
        projectors={**calibration.projectors, "south": replace(south, photometry=light)},
    )


def _other_maps(calibration: Calibration, **factors: float) -> Calibration:
    changed = {
        name: getattr(calibration.maps, name) * np.float32(factor)
        for name, factor in factors.items()
    }
    return replace(calibration, maps=replace(calibration.maps, **changed))


def _response(calibration: Calibration) -> Calibration:
    def bent(projector: ProjectorCalibration) -> ProjectorCalibration:
        response = projector.photometry.response
        light = replace(
            projector.photometry, response=replace(response, values=response.values**0.8)
        )
        return replace(projector, photometry=light)

    return _south(bent)(calibration)


def _swapped_channels(projector: ProjectorCalibration) -> ProjectorCalibration:
    gain = projector.photometry.gain[..., ::-1] * np.array([1.1, 1, 0.9], np.float32)
    light = replace(
        projector.photometry,
        gain=np.ascontiguousarray(gain),
        colour_mix=projector.photometry.colour_mix[::-1],
    )
    return replace(projector, photometry=light)


SPOILERS: dict[str, Spoil] = {
    "a blend of zeros": _south(lambda p: replace(p, blend=np.zeros_like(p.blend))),
    "a blend of ones": _south(lambda p: replace(p, blend=np.ones_like(p.blend))),
    "gains of another projector": _swapped_gains,
    "gains by another camera": _gain(_waves),
    "a map from before it was turned": _south(_turned),
    "a canvas turned by 90 degrees": lambda c: replace(c, canvas=Canvas(np.pi, np.pi / 2)),
    "channels swapped": _south(_swapped_channels),
    "another response": _response,
    "twice the scattered light": lambda c: _other_maps(c, scatter_per_flux=2),
    "a tenth of the white as black": lambda c: _other_maps(c, lo=30),
}


@pytest.mark.parametrize("name", SPOILERS)
def test_the_judge_sees_each_spoilt_calibration(
    name: str, once: Path, tmp_path: Path, whole: np.ndarray
) -> None:
    good = load_calibration(once / "calibrations" / "0001")
    save_calibration(SPOILERS[name](good), tmp_path / "spoilt")
    found = errors(once, tmp_path / "spoilt")
    assert (found > SPOILT * whole).any()


SHOWN_BY_FRAMES = (
    *("a blend of zeros", "a blend of ones", "gains of another projector"),
    *("gains by another camera", "channels swapped", "another response"),
    *("twice the scattered light",),
)


@pytest.mark.parametrize("name", SHOWN_BY_FRAMES)
def test_two_calibrations_agree_only_if_their_frames_do(name: str, once: Path) -> None:
    good = load_calibration(once / "calibrations" / "0001")
    assert compare(good, good).verdict.kind == "agree"
    found = compare(good, SPOILERS[name](good))
    assert found.verdict.kind == "light"


def test_a_calibration_that_contradicts_itself_is_not_written(once: Path) -> None:
    good = load_calibration(once / "calibrations" / "0001")
    assert check_calibration(good) == []
    for name in ("a blend of zeros", "a blend of ones"):
        with pytest.raises(CalibrationError, match="a uniform picture would be off"):
            check_calibration(SPOILERS[name](good))
