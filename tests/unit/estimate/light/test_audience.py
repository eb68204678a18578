"""Scattered and ambient light of a venue state, on a sphere where both are known."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from tolerances import SOLVER

from procam.estimate.camera.radiance import Radiometer
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.audience import (
    AudienceView,
    audience_feedback,
    centre_shift,
)
from procam.estimate.structured_light.patterns import zone_picture
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.sphere import master_directions
from procam.maths.light.scatter_kernel import basis
from procam.model.calibration import Calibration
from procam.model.transport import Measured, ScatterKernel

CAMERA_PX = 160
U = np.array([0.06, 0.065, 0.08])
RIM = 5e-5  # the maps end within the outermost camera pixels
RATIO = np.array([1.12, 1.07, 0.93])
ZONES = 4
NAMES = ("south", "north")
Picture = tuple[np.ndarray, np.ndarray]  # photograph (H, W, 3), and where it is lit (H, W)


@pytest.fixture(scope="module")
def known(make_calibration: Callable[..., Calibration]) -> Calibration:
    """A dome of one u per colour, seen by a fisheye that sees all of it."""
    made = make_calibration()
    lens = Lens("kannala-brandt", np.full(2, 49.0), np.full(2, 79.3), np.zeros(4))
    camera = replace(made.cameras["zenith"], size=(CAMERA_PX, CAMERA_PX), lens=lens)
    u = np.broadcast_to(U, (96, 96, 3)).astype(np.float32)
    maps = replace(made.maps, scatter_per_flux=u)
    return replace(made, cameras={"zenith": camera}, maps=maps)


@pytest.fixture(scope="module")
def view(known: Calibration) -> ScreenView:
    radiometer = Radiometer(known.cameras["zenith"])
    return ScreenView.of(radiometer.camera, known.screen, radiometer.rays, radiometer.seen)


def _quarters(
    known: Calibration, view: ScreenView, ratio: np.ndarray, lamp: float = 1.0
) -> list[Picture]:
    """Pictures of quarters with `ratio` times the calibrated scatter, from lamps of some strength."""
    audience, found = AudienceView(known, view), []
    for name in NAMES:
        size = known.projectors[name].model.size
        for zone in range(ZONES):
            lit = audience.expected(name, zone_picture(size, zone, ZONES) / np.float32(255)) > 0
            slope = lamp * (1 + 0.3 * view.direction[..., :1]) * [1.0, 0.9, 1.1]
            direct = np.where(lit[..., None], slope, 0)
            light = direct + ratio * _scattered(known, view, direct)
            seen = (light * view.on_screen[..., None]).astype(np.float32)
            found.append((seen, lit))
    return found


def _ratio(
    known: Calibration, view: ScreenView, pictures: list[Picture], before: Sequence[Picture] = ()
) -> Measured:
    audience = AudienceView(known, view)
    now, then = ([audience.observe(*picture) for picture in each] for each in (pictures, before))
    return audience.scatter_ratio(now, then)


def _one_sided(known: Calibration) -> Calibration:
    """A dome whose scattered light is stronger on the side that is lit."""
    bend = np.diag([1.0, 0.2, 0.2, 0.2])
    kernel = ScatterKernel(1, np.stack([bend] * 3), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    return replace(known, maps=replace(known.maps, kernel=kernel))


def _scattered(known: Calibration, view: ScreenView, direct: np.ndarray) -> np.ndarray:
    """Scattered light (H, W, 3) pixel by pixel; that of full white is uniform."""
    kernel = known.maps.kernel
    phi = basis(view.direction.reshape(-1, 3).astype(float), kernel.degree)
    moments = phi.T @ (view.weight[..., None] * direct).reshape(-1, 3)
    light = [phi @ (matrix @ m) for matrix, m in zip(kernel.matrix, moments.T, strict=True)]
    return U * np.stack(light, axis=-1).reshape(direct.shape)


class TestRatio:
    @pytest.mark.parametrize("lamp", [1.0, 0.6])
    def test_does_not_depend_on_the_brightness_of_the_lamps(
        self, known: Calibration, view: ScreenView, lamp: float
    ) -> None:
        found = _ratio(known, view, _quarters(known, view, RATIO, lamp))
        np.testing.assert_allclose(found.value, RATIO, rtol=RIM)
        # the pictures agree, so only the errors of unseen light and of the kernel remain
        sigma = np.hypot(0.1 * (RATIO - 1), 0.03 * RATIO)
        np.testing.assert_allclose(found.sigma, sigma, rtol=0.01)

    def test_one_sided_scatter_that_the_kernel_describes(
        self, known: Calibration, view: ScreenView
    ) -> None:
        one_sided = _one_sided(known)
        found = _ratio(one_sided, view, _quarters(one_sided, view, RATIO))
        np.testing.assert_allclose(
            found.value, RATIO, rtol=2e-3
        )  # phi is taken at the cells' centres

    def test_errors_of_the_kernel_cancel_with_the_calibrations_own_pictures(
        self, known: Calibration, view: ScreenView
    ) -> None:
        """The scatter is one-sided, and the calibrated kernel is not."""
        one_sided = _one_sided(known)
        now, then = (_quarters(one_sided, view, r) for r in (RATIO, np.ones(3)))
        off = _ratio(known, view, now).value / RATIO - 1
        found = _ratio(known, view, now, then)
        assert (np.abs(off) > 0.02).all()
        # the scattered light subtracted where light falls grows with the ratio: a second-order error
        assert (np.abs(found.value / RATIO - 1) < 0.1 * np.abs(off)).all()
        np.testing.assert_allclose(found.sigma, 0.1 * np.abs(found.value - 1), atol=2e-3)

    def test_pictures_that_disagree_widen_the_error(
        self, known: Calibration, view: ScreenView
    ) -> None:
        same, more = (_quarters(known, view, np.full(3, r)) for r in (1.0, 1.2))
        found = _ratio(known, view, [*same[:4], *more[4:]], same)
        assert (np.abs(found.value - 1.1) < 0.02).all()
        assert (found.sigma > 0.02).all()

    def test_feedback_is_the_calibrations_times_the_ratio(self, known: Calibration) -> None:
        m = audience_feedback(known, Measured(RATIO, np.full(3, 0.01)))
        before = known.feedback
        np.testing.assert_allclose(m.value, RATIO * before.value, rtol=SOLVER)
        sigma = np.sqrt((RATIO * before.sigma) ** 2 + (0.01 * before.value) ** 2)
        np.testing.assert_allclose(m.sigma, sigma, rtol=SOLVER)


class TestAmbient:
    def test_is_mapped_to_the_dome_master_where_it_is_seen(
        self, known: Calibration, view: ScreenView
    ) -> None:
        slope = 0.02 * (1 + 0.5 * view.direction[..., 1:2]) * [1.0, 0.5, 0.2]
        light = (slope * view.on_screen[..., None]).astype(np.float32)
        light[70:74, 90:94] = np.nan  # a lamp in the picture
        level, mean = AudienceView(known, view).ambient(light)
        direction, inside = master_directions(96)
        high = inside & (direction[..., 2] > np.sin(np.radians(12.0)))
        expected = 0.02 * (1 + 0.5 * direction[..., 1:2]) * [1.0, 0.5, 0.2]
        # smoothing over a few pixels changes a slope at the border of the view
        np.testing.assert_allclose(level[high], expected[high], rtol=0.02)
        np.testing.assert_allclose(mean, [0.02, 0.01, 0.004], rtol=0.01)
        assert not level[~inside].any()

    def test_noise_is_not_ambient_light(
        self, known: Calibration, view: ScreenView, rng: np.random.Generator
    ) -> None:
        light = rng.normal(0, 1e-3, (*view.on_screen.shape, 3)).astype(np.float32)
        level, mean = AudienceView(known, view).ambient(light)
        assert level.min() >= 0 and mean.min() >= 0
        assert level.mean() < 1e-4 and mean.max() < 1e-4


class TestCentre:
    def shifted(self, known: Calibration, view: ScreenView, by: int) -> float:
        seen, _ = _quarters(known, view, np.ones(3))[0]
        audience = AudienceView(known, view)
        expected = audience.expected("south", zone_picture((48, 30), 0, ZONES) / np.float32(255))
        light = np.roll(seen[..., 1], by, axis=1)
        return centre_shift(light, expected, view.on_screen)

    @pytest.mark.parametrize("by", [5, -8])
    def test_moved(self, known: Calibration, view: ScreenView, by: int) -> None:
        assert self.shifted(known, view, by) == pytest.approx(abs(by), abs=1.0)

    def test_no_light(self, known: Calibration, view: ScreenView) -> None:
        audience = AudienceView(known, view)
        expected = audience.expected("south", zone_picture((48, 30), 0, ZONES) / np.float32(255))
        assert np.isnan(centre_shift(0 * expected, expected, view.on_screen))
