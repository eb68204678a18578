"""A small closed loop on a dome master, on a known plant."""

from collections.abc import Iterator

import numpy as np
import pytest

from procam.estimate.closed_loop import picture_loop
from procam.estimate.closed_loop.picture_loop import LoopCells, PictureLoop
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.calibration import Calibration

Image = np.ndarray
LOOP_SIZE = 64  # a quarter of the real one: the same arithmetic, sixteen times as fast
SIZE = 128


@pytest.fixture(scope="module", autouse=True)
def few_cells() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(picture_loop, "LOOP_SIZE", LOOP_SIZE)
        yield


@pytest.fixture(scope="module")
def cells(few_cells: None) -> LoopCells:
    """A camera whose pixels are a dome master twice as fine as the loop's cells."""
    direction, inside = master_directions(2 * LOOP_SIZE)
    return LoopCells.of(STANDARD, direction.astype(np.float32), inside & (direction[..., 2] > 0.02))


@pytest.fixture
def direct(calibration: Calibration) -> Image:
    """Half of white above 20 degrees; the rest is at the black level."""
    direction, inside = master_directions(SIZE)
    lo = sample(calibration.maps.lo, master_pixels(direction, calibration.maps.size))
    high = (direction[..., 2] > np.sin(np.radians(20.0)))[..., None]
    return np.where(high, 0.5, lo).astype(np.float32) * inside[..., None]


@pytest.fixture
def loop(calibration: Calibration, cells: LoopCells, direct: Image) -> PictureLoop:
    return PictureLoop(calibration, cells, direct, observed(calibration, direct))


def observed(calibration: Calibration, direct: Image) -> Image:
    """Total light of direct light, by the calibration's scalar kernel."""
    direction, _ = master_directions(SIZE)
    where = master_pixels(direction, calibration.maps.size)
    lit = (sample(calibration.maps.coverage, where) * master_solid_angles(SIZE))[..., None]
    scatter = sample(calibration.maps.scatter_per_flux, where)
    return (direct + scatter * (lit * direct).sum(axis=(0, 1))).astype(np.float32)
