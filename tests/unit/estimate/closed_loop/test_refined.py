"""The calibration that the closed loop's estimates give."""

import numpy as np
import pytest
from small_loop import LOOP_SIZE, observed
from tolerances import FLOAT32

from procam.estimate.closed_loop.gains import COMMON_SIGMA
from procam.estimate.closed_loop.picture_loop import LoopCells, PictureLoop
from procam.estimate.closed_loop.refined import with_gains, with_scatter
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import master_directions
from procam.model.calibration import Calibration

Image = np.ndarray


@pytest.fixture
def refined(loop: PictureLoop, calibration: Calibration) -> Calibration:
    """By gains 5 % too low everywhere and 10 % more scatter."""
    factor = np.full((LOOP_SIZE, LOOP_SIZE, 3), 0.95)
    return with_gains(with_scatter(calibration, np.full(3, 1.1)), factor)


def test_gains_multiply_the_projectors(calibration: Calibration, refined: Calibration) -> None:
    for name, old in calibration.projectors.items():
        high = old.surface.direction[..., 2] > np.sin(np.radians(30))
        gain = refined.projectors[name].photometry.gain
        np.testing.assert_allclose(gain[high], 0.95 * old.photometry.gain[high], rtol=1e-4)


def test_gains_are_light_got_per_light_asked(loop: PictureLoop) -> None:
    loop.state.surplus = -0.05 * loop._asked[loop._inside]
    factor = loop.gain_factor()
    np.testing.assert_allclose(factor[loop.free], 0.95, atol=COMMON_SIGMA**2 / 0.05)
    rim = loop.direction[..., 2] < np.sin(np.radians(-5))  # far from all cells that the camera sees
    assert (factor[rim] == 1.0).all()


def test_cells_that_no_pixel_sees_follow_their_neighbours(
    calibration: Calibration, direct: Image
) -> None:
    direction, inside = master_directions(2 * LOOP_SIZE)
    inside = inside & (direction[..., 2] > 0.02)
    inside[LOOP_SIZE : LOOP_SIZE + 2] = False  # a row of cells at the zenith
    few = LoopCells.of(STANDARD, direction.astype(np.float32), inside)
    loop = PictureLoop(calibration, few, direct, observed(calibration, direct))
    loop.state.surplus = -0.05 * loop._asked[loop._inside]
    hole = (LOOP_SIZE // 2, slice(LOOP_SIZE // 2 - 5, LOOP_SIZE // 2 + 5))
    assert (few.count[hole] == 0).all()
    np.testing.assert_allclose(loop.gain_factor()[hole], 0.95, atol=COMMON_SIGMA**2 / 0.05)


def test_dark_cells_teach_no_gain(loop: PictureLoop) -> None:
    """Where a thousandth of white is asked for, a surplus is scattered light or noise."""
    asked = loop._asked[loop._inside]
    loop.state.surplus = np.where(asked < 0.02, 0.2 * asked, -0.05 * asked)
    elevation = np.arcsin(np.clip(loop.direction[..., 2], -1, 1))
    factor = loop.gain_factor()
    dark = loop.known.all(axis=-1) & (elevation < np.radians(14))
    assert dark.sum() > 50
    assert (factor[dark] <= 1).all()
    bright = factor[elevation > np.radians(30)]
    np.testing.assert_allclose(bright, 0.95, atol=1.1 * COMMON_SIGMA**2 / 0.05)


def test_feedback_maps_and_albedo_follow(calibration: Calibration, refined: Calibration) -> None:
    np.testing.assert_allclose(refined.feedback.value, 1.1 * calibration.feedback.value)
    np.testing.assert_allclose(refined.feedback.sigma, 1.1 * calibration.feedback.sigma)
    np.testing.assert_allclose(
        refined.maps.scatter_per_flux, 1.1 * calibration.maps.scatter_per_flux, rtol=FLOAT32
    )
    centre = calibration.maps.size // 2
    hi, was = (c.maps.hi[centre, centre] for c in (refined, calibration))
    lo = calibration.maps.lo[centre, centre]
    np.testing.assert_allclose(hi - lo, 0.95 * (was - lo), rtol=1e-4)
    brighter = refined.albedo.value / calibration.albedo.value
    assert ((brighter > 1.03) & (brighter < 1.1)).all()
