"""Feedback of a traced room seen by a camera at the dome's centre: its value, and what its sigma holds."""

from dataclasses import replace

import numpy as np
import pytest
from traced_rooms import DIRECTION, INSIDE, TracedRoom, Where, parts

from procam.errors import OutOfModelRange
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.dome_scatter import DomeScatter, measure_scatter
from procam.estimate.light.feedback import estimate_albedo
from procam.estimate.light.scatter_kernel import CELLS
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.sphere import master_solid_angles
from procam.model.optics import CameraModel, Sensor
from procam.model.screen import Dome

SHAPE = (CELLS, CELLS, 1)
SOLID_SR = master_solid_angles(CELLS)
LIT = (INSIDE & (DIRECTION[:, 2] > 0.1)).reshape(CELLS, CELLS)
DOME = Dome(1.0, np.pi / 2, floor_albedo=0.3, floor_albedo_sigma=0.1)


def left(direction: np.ndarray) -> np.ndarray:
    return (direction[:, 2] > 0.1) & (direction[:, 1] > 0)


def right(direction: np.ndarray) -> np.ndarray:
    return (direction[:, 2] > 0.1) & (direction[:, 1] <= 0)


def light_of(room: TracedRoom, lit: Where) -> SeparatedLight:
    """Light of a projector that makes one place as bright as another."""
    direct = (LIT.ravel() & lit(DIRECTION)).reshape(SHAPE).astype(np.float32)
    scattered = (room.scattered(lit) * INSIDE).reshape(SHAPE)
    return SeparatedLight(direct, scattered, np.tensordot(SOLID_SR, direct, 2), direct[..., 0] > 0)


def measured(
    room: TracedRoom,
    glare: tuple[float, float] = (0.0, 0.0),
    hidden: float = 0.0,
    stretch: float = 1.0,
) -> DomeScatter:
    """The scatter by two projectors; gloss hides a share of the direct light of every other picture.

    `glare` is all of it and its local part; `stretch` multiplies the solid angles of the camera's pixels.
    """
    near = ((glare[1] / 2, 0.03), (glare[1] / 2, 0.1)) if glare[1] else ()
    lens = Lens("kannala-brandt", np.ones(2), np.zeros(2), np.zeros(4))
    camera = CameraModel("c", (CELLS, CELLS), lens, Sensor(12, 0.0, (0.0,), glare[0], 0.0, near))
    inside = INSIDE.reshape(CELLS, CELLS)
    view = ScreenView(
        camera, DIRECTION.reshape(CELLS, CELLS, 3), inside, np.where(inside, stretch * SOLID_SR, 0)
    )
    samples = [room.scatter_sample(lit, 0.0) for lit in parts()]
    samples[::2] = [replace(x, direct=(1 - hidden) * x.direct) for x in samples[::2]]
    lights = [light_of(room, lit) for lit in (left, right)]
    return measure_scatter(
        DOME, view, lights, [samples[:4], samples[4:]], room.known()[1], LIT.astype(np.float32)
    )


def test_feedback_is_scattered_flux_of_white_over_its_direct_flux(furnished: TracedRoom) -> None:
    white = light_of(furnished, lambda d: d[:, 2] > 0.1)
    expected = np.tensordot(SOLID_SR * LIT, white.scattered, 2) / white.flux
    found = measured(furnished).feedback
    np.testing.assert_allclose(found.value, expected, rtol=2e-3)
    assert found.sigma < 0.004 * found.value


@pytest.mark.parametrize(
    ("glare", "unknown"), [((0.005, 0), 0.1 * 0.005), ((0.01, 0.006), 0.2 * 0.006)]
)
def test_what_stays_near_its_light_is_not_known_exactly(
    furnished: TracedRoom, glare: tuple[float, float], unknown: float
) -> None:
    without, with_glare = (measured(furnished, g).feedback for g in ((0.0, 0.0), glare))
    widened = np.sqrt(with_glare.sigma**2 - without.sigma**2)
    # the veil is that of all light on the screen, of which the lit part gets its share
    share = (SOLID_SR * LIT).sum() / (SOLID_SR.ravel() * INSIDE).sum()
    np.testing.assert_allclose(widened, unknown * (share + without.value), rtol=0.02)


def test_gloss_widens_by_the_number_of_projectors(furnished: TracedRoom) -> None:
    matte, glossy = (measured(furnished, hidden=share) for share in (0.0, 0.04))
    assert glossy.floor.flux_inconsistency == pytest.approx(0.02, rel=0.2)
    spread = [x.floor.flux_inconsistency / np.sqrt(2) * x.feedback.value for x in (matte, glossy)]
    widened = glossy.feedback.sigma**2 - matte.feedback.sigma**2
    np.testing.assert_allclose(widened, spread[1] ** 2 - spread[0] ** 2, rtol=1e-6)
    # all pictures may hide the same share, which the albedo cannot average away
    lit_sr, inconsistency = float((SOLID_SR * LIT).sum()), glossy.floor.flux_inconsistency
    stated = estimate_albedo(glossy.feedback, lit_sr, 2 * np.pi, glossy.dome, inconsistency)
    np.testing.assert_allclose(glossy.albedo.sigma, stated.sigma, rtol=1e-6)


def test_a_lens_that_sees_more_than_there_is_is_refused(furnished: TracedRoom) -> None:
    measured(furnished, stretch=1.02)
    with pytest.raises(OutOfModelRange, match=r"camera c: its pixels cover .* sr of the lit part"):
        measured(furnished, stretch=1.04)
