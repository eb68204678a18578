"""A camera of which blocks of pixels measure light: solve, verify, recalibrate."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import TINY_PAIR, drift, make_venue, procam, solved, take_session

from procam.estimate.camera import binning
from procam.files.calibration import load_calibration
from procam.model.calibration import Calibration
from procam.workflows.main_camera import MainCamera

SIZE = replace(TINY_PAIR, projector_size=(160, 100), camera_size=(512, 512), map_size=256)
NUDGE = '{ kind = "turned", projector = "south", size = 0.6, angle_deg = 40 }'


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Calibration]]:
    """A venue whose calibration 0001 is of all pixels, and 0002, from the same session, of blocks of four."""
    folder = tmp_path_factory.mktemp("large") / "venue"
    with pytest.MonkeyPatch.context() as patch:
        venue = make_venue(folder, size=SIZE)
        session = take_session(venue)
        whole = load_calibration(solved(venue, session))
        patch.setattr(binning, "MOST_PIXELS", 512**2 / 3)
        blocks = load_calibration(solved(venue, session))
        assert MainCamera.of(venue, blocks).view.camera.size == (256, 256)
        yield folder, whole


@pytest.fixture
def venue(pair: tuple[Path, Calibration], tmp_path: Path) -> Path:
    return Path(shutil.copytree(pair[0], tmp_path / "venue"))


def test_the_calibration_is_that_of_all_pixels(pair: tuple[Path, Calibration]) -> None:
    folder, whole = pair
    blocks = load_calibration(folder / "calibrations" / "0002")
    assert blocks.camera.size == whole.camera.size == (512, 512)
    for name, projector in whole.projectors.items():
        other = blocks.projectors[name]
        np.testing.assert_allclose(other.surface.direction, projector.surface.direction, atol=1e-6)
        both = projector.surface.valid & other.surface.valid
        assert both.sum() > 0.97 * projector.surface.valid.sum()
        gains = other.photometry.gain[both] / projector.photometry.gain[both]
        # of so few blocks the darkest, which makes white, is another; at its border they differ most
        assert np.percentile(np.abs(gains / np.median(gains) - 1), 80) < 0.03
    sigma = np.hypot(whole.feedback.sigma, blocks.feedback.sigma)
    assert (np.abs(blocks.feedback.value - whole.feedback.value) < 2 * sigma).all()


def test_verify_finds_nothing_and_then_what_changed(venue: Path) -> None:
    clean = procam("verify", venue)
    assert clean.code == 0 and clean.out.endswith("calibration 0002: all is well\n"), clean.out
    drift(venue, NUDGE)
    nudged = procam("verify", venue)
    assert nudged.code == 1 and "CHANGED  south: " in nudged.out, nudged.out


def test_recalibrate_repairs_it(venue: Path) -> None:
    drift(venue, NUDGE)
    repaired = procam("recalibrate", venue, "--projector", "south")
    assert repaired.code == 0, repaired.out
    assert procam("verify", venue).code == 0
