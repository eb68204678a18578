"""Direct/global separation on scenes where both parts are known."""

from collections.abc import Sequence

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.estimate.light.feedback import (
    estimate_albedo,
    estimate_feedback,
    estimate_scatter_per_flux,
)
from procam.estimate.light.picture_flux import PictureFlux
from procam.estimate.light.separation import (
    CLEAR_CAMERA_PX,
    MAX_BLUR,
    OVERSHOOT,
    SeparatedLight,
    Separation,
)
from procam.estimate.structured_light.patterns import SEPARATION_BITS
from procam.maths.codes.gray import stripe, stripe_edge_distance
from procam.maths.geometry.sphere import cap_solid_angle
from procam.maths.warp import blur
from procam.model.screen import Dome
from procam.model.transport import Measured

SIZE = 320
PANEL = 512
SUBPIXELS = 8  # along an axis of a camera pixel
LENS_BLUR_PX = 0.5  # blurs the edges of stripes


class Scene:
    """A camera that sees a projector's picture as a square in the middle of the screen."""

    def __init__(
        self,
        left: int = 60,
        right: int = 260,
        px_per_px: float = 1.6,
        blur_px: tuple[float, float, float] = (LENS_BLUR_PX,) * 3,
    ) -> None:
        self.blur_px = blur_px
        y, x = np.mgrid[0:SIZE, 0:SIZE].astype(np.float32)
        self.lit = (x >= left) & (x < right) & (y >= 80) & (y < 240)
        self.px_per_px, self.panel = px_per_px, int(PANEL * max(1, px_per_px / 1.6))
        self.xy = np.stack([(x - 50) * px_per_px + 0.2, (y - 70) * px_per_px + 0.3], axis=-1)
        self.xy[(self.xy < -0.5).any(axis=-1) | (self.xy > self.panel - 0.5).any(axis=-1)] = np.nan
        wave = 1 + 0.1 * np.sin(x / 40) * np.cos(y / 50)
        self.solid = np.where(np.hypot(x - 160, y - 160) < 155, 6.0 / (np.pi * 155**2), 0)
        self.on_screen = self.solid > 0
        self.u = (wave[..., None] * [0.05, 0.06, 0.08] * self.on_screen[..., None]).astype(float)
        self.direct = wave[..., None] * [0.9, 1.0, 0.7] * self.lit[..., None]

    def picture(self, drive: np.ndarray) -> np.ndarray:
        """What the camera sees of relative drive (H, W): direct, and u times its flux."""
        light = np.moveaxis(self.direct * drive[..., None], -1, 0)
        direct = np.stack([blur(*x) for x in zip(light, self.blur_px, strict=True)], axis=-1)
        flux = np.tensordot(self.solid, direct, 2)
        return (direct + self.u * flux).astype(np.float32)

    def white(self) -> np.ndarray:
        return self.picture(np.ones((SIZE, SIZE)))

    def pair(self, axis: str, bit: int) -> tuple[np.ndarray, np.ndarray]:
        centre = np.nan_to_num(self.xy[..., 0 if axis == "x" else 1])
        parts = ((np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5) * self.px_per_px
        columns = np.rint(centre[..., None] + parts).astype(int).clip(0, self.panel - 1)
        bright = stripe(self.panel, bit)[columns].mean(axis=-1)
        return self.picture(bright), self.picture(1 - bright)

    def untouched(self, more: np.ndarray | float = 0.0) -> Separation:
        """Without any stripes yet; `more` light is in white."""
        white = self.white() + np.float32(more)
        return Separation(white, self.xy, self.lit, PictureFlux(self.solid, white))

    def separation(self, bits: Sequence[int] = SEPARATION_BITS) -> Separation:
        separation = self.untouched()
        for axis in ("x", "y"):
            for bit in bits:
                separation.add_pair(axis, bit, *self.pair(axis, bit))
        return separation

    def separate(self) -> SeparatedLight:
        return self.separation().result()

    @property
    def flux(self) -> np.ndarray:
        return np.tensordot(self.solid, self.direct, 2)

    @property
    def inner(self) -> np.ndarray:
        """Clear of the picture's border and of the screen's."""
        y, x = np.mgrid[0:SIZE, 0:SIZE]
        return (x > 80) & (x < 240) & (y > 100) & (y < 220)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene()


@pytest.fixture(scope="module")
def light(scene: Scene) -> SeparatedLight:
    return scene.separate()


class TestSeparation:
    @pytest.mark.parametrize(
        ("px_per_px", "blur_px"),
        [
            (1.6, (0.5, 0.5, 0.5)),
            (0.7, (0.5, 0.5, 0.5)),
            (3.0, (0.5, 0.5, 0.5)),
            (4.0, (0.5, 0.5, 0.5)),
            (1.6, (0.5, 0.5, 2.0)),  # blue is out of focus
            (1.6, (2.0, 0.5, 0.5)),
        ],
    )
    def test_no_edge_of_a_stripe_leaks_into_the_scattered_light(
        self, px_per_px: float, blur_px: tuple[float, float, float]
    ) -> None:
        scene = Scene(px_per_px=px_per_px, blur_px=blur_px)
        inner = scene.inner & np.isfinite(scene.xy).all(axis=-1)
        expected = scene.u * scene.flux
        found = scene.separate().scattered
        np.testing.assert_allclose(found[inner], expected[inner], rtol=1e-3)

    @pytest.mark.parametrize(("px_per_px", "sigma_px"), [(1.6, 0.5), (0.7, 2.5), (0.4, 4.0)])
    def test_a_blurred_border_does_not_leak_into_the_scattered_light(
        self, px_per_px: float, sigma_px: float
    ) -> None:
        """Where camera pixels are finer than the projector's, its blur spans many of them."""
        scene = Scene(px_per_px=px_per_px, blur_px=(sigma_px,) * 3)
        separation = scene.separation()
        found, expected = separation.result(), scene.u * scene.flux
        on_screen = scene.on_screen
        np.testing.assert_allclose(found.scattered[on_screen], expected[on_screen], rtol=0.03)
        np.testing.assert_allclose(
            np.tensordot(scene.solid, found.scattered, 2),
            np.tensordot(scene.solid, expected, 2),
            rtol=1e-3,
        )
        np.testing.assert_allclose(found.flux, scene.flux, rtol=3e-4)
        across = 4 * sigma_px  # four standard deviations
        assert separation.clear_px == pytest.approx(max(6, across), rel=0.6)

    def test_scattered_light_has_no_gap_beside_a_wide_blurred_border(self) -> None:
        scene = Scene(px_per_px=0.25, blur_px=(9.0,) * 3)
        found = scene.separation(bits=(3, 4)).result().scattered[scene.on_screen]
        np.testing.assert_allclose(found, (scene.u * scene.flux)[scene.on_screen], rtol=0.1)

    @pytest.mark.parametrize("px_per_px", [1.6, 3.0])
    @pytest.mark.parametrize("sigma_px", [2.0, 3.0, 4.0, 10.0])
    def test_a_blur_too_large_is_measured_as_such(self, px_per_px: float, sigma_px: float) -> None:
        scene = Scene(px_per_px=px_per_px, blur_px=(sigma_px,) * 3)
        separation = scene.separation()
        inner = scene.inner & np.isfinite(scene.xy).all(axis=-1)
        error = separation.result().scattered / np.maximum(scene.u * scene.flux, 1e-9) - 1
        assert separation.blur > MAX_BLUR or np.abs(error[inner]).max() < 5e-3
        assert (separation.blur > MAX_BLUR) == (sigma_px > 3 or px_per_px * sigma_px > 6)

    @pytest.mark.parametrize(("sigma_px", "wide"), [(1.0, 0.88), (1.5, 1.29)])
    def test_narrow_stripes_keep_their_middles(self, sigma_px: float, wide: float) -> None:
        """Even where four sigmas of the blur reach over all of a stripe; `wide`: of wide stripes."""
        scene = Scene(blur_px=(sigma_px,) * 3)
        separation = scene.untouched()
        separation.add_pair("x", 3, *scene.pair("x", 3))
        assert 0.8 * wide < separation.blur < wide
        known = separation.dark_weight[scene.inner & np.isfinite(scene.xy).all(axis=-1)] > 0
        assert 0.15 < known.mean() < 0.35  # a quarter of each stripe

    @pytest.mark.parametrize(("px_per_px", "sigma_px"), [(1.6, 1.0), (1.6, 2.0), (3.0, 1.0)])
    def test_blur_of_edges_is_that_of_camera_and_pixels(
        self, px_per_px: float, sigma_px: float
    ) -> None:
        scene = Scene(px_per_px=px_per_px, blur_px=(sigma_px,) * 3)
        separation = scene.untouched()
        separation.add_pair("x", 5, *scene.pair("x", 5))
        expected = px_per_px * np.hypot(sigma_px, 1 / np.sqrt(12)) / np.hypot(1, px_per_px)
        assert separation.blur == pytest.approx(expected, rel=0.1)

    def test_saturated_pixels_of_stripes_are_left_out(self, scene: Scene) -> None:
        separation = scene.untouched()
        for axis in ("x", "y"):
            for bit in SEPARATION_BITS:
                pattern, inverse = scene.pair(axis, bit)
                pattern[120:124, 140:144] = np.nan
                separation.add_pair(axis, bit, pattern, inverse)
        found = separation.result()
        assert np.isfinite(found.direct).all() and np.isfinite(found.flux).all()

    @pytest.mark.parametrize(("amount", "sharp"), [(0.0, False), (1.0, True)])
    def test_sharpened_stripes_are_brightest_beside_their_edges(
        self, scene: Scene, amount: float, sharp: bool
    ) -> None:
        separation = scene.untouched()
        for bit in SEPARATION_BITS[::-1]:
            pair = [p + amount * (p - blur(p, 1.2)) for p in scene.pair("x", bit)]
            separation.add_pair("x", bit, *pair)
        assert (separation.overshoot > OVERSHOOT) == sharp

    def test_scattered_light_that_differs_from_place_to_place_is_no_overshoot(
        self, scene: Scene
    ) -> None:
        away = stripe_edge_distance(scene.xy[..., 0], SEPARATION_BITS[0])
        more = np.where(away < 5, 0.0, 0.3 * scene.direct.mean())[..., None]
        separation = scene.untouched(more)
        for bit in SEPARATION_BITS[::-1]:
            separation.add_pair("x", bit, *(p + more / 2 for p in scene.pair("x", bit)))
        assert -0.1 < separation.overshoot < OVERSHOOT

    @pytest.mark.parametrize("columns", [6, 12])
    def test_a_stripe_that_holds_nearly_all_of_the_light_shows_no_overshoot(
        self, columns: int
    ) -> None:
        """As of a panel with little beyond the edge of its widest stripes: scattered light is uneven."""
        bit, px_per_px = 8, 1.6
        scene = Scene(right=int(50 + 2**bit / px_per_px) + columns, px_per_px=px_per_px)
        uneven = 0.005
        separation = scene.untouched()
        for each in SEPARATION_BITS:
            separation.add_pair("x", each, *scene.pair("x", each))
            pattern, inverse = scene.pair("x", bit)
            separation.add_pair("x", bit, pattern + uneven, inverse - uneven)
        assert separation.overshoot < OVERSHOOT

    def test_scattered_light_outside_the_picture_too(
        self, scene: Scene, light: SeparatedLight
    ) -> None:
        y, x = np.mgrid[0:SIZE, 0:SIZE]
        away = scene.on_screen & ((x < 50) | (x > 270)) & (np.hypot(x - 160, y - 160) < 145)
        expected = scene.u * scene.flux
        np.testing.assert_allclose(light.scattered[away], expected[away], rtol=1e-3)

    def test_flux_and_parts_add_up(self, scene: Scene, light: SeparatedLight) -> None:
        np.testing.assert_allclose(light.flux, scene.flux, rtol=1e-3)
        inner = scene.inner
        total = (light.direct + light.scattered)[inner]
        np.testing.assert_allclose(total, scene.white()[inner], rtol=FLOAT32)

    def test_extended_goes_on_beyond_the_border(self, scene: Scene, light: SeparatedLight) -> None:
        extended, middle = light.extended(), (160, 160)
        assert not scene.lit[160, 58] and extended[160, 58].min() > 0.5
        np.testing.assert_array_equal(extended[middle], light.direct[middle])

    def test_a_glint_in_one_picture_stays_local(self, scene: Scene, light: SeparatedLight) -> None:
        """A pixel that saturates in one picture must not affect the map around it."""
        separation = scene.untouched()
        for axis in ("x", "y"):
            for bit in SEPARATION_BITS:
                pattern, inverse = scene.pair(axis, bit)
                if (axis, bit) == ("x", SEPARATION_BITS[0]):
                    pattern[150, 160] = np.nan
                separation.add_pair(axis, bit, pattern, inverse)
        found = separation.result()
        far = np.ones((SIZE, SIZE), bool)
        far[150 - 2 * CLEAR_CAMERA_PX : 150 + 2 * CLEAR_CAMERA_PX, 160 - 12 : 160 + 12] = False
        parts = [(each.direct, each.scattered, each.extended()) for each in (found, light)]
        for values, right in zip(*parts, strict=True):
            assert np.isfinite(values[far]).all()
            np.testing.assert_allclose(values[far], right[far], rtol=1e-3, atol=1e-5)
        assert np.isfinite(found.flux).all()


def measured_feedback(
    scene: Scene, lights: list[SeparatedLight], lit_sr: np.ndarray, glare: float, flux: float
) -> Measured:
    return estimate_feedback(lights, lit_sr, scene.solid, glare_sigma=glare, flux_sigma=flux)


class TestTogether:
    def test_scatter_per_flux_of_two_projectors(self) -> None:
        scenes = [Scene(60, 180), Scene(150, 260)]
        lights = [s.separate() for s in scenes]
        u = estimate_scatter_per_flux(lights)
        clear = scenes[0].inner & (np.abs(np.arange(SIZE) - 165) > 30)
        np.testing.assert_allclose(u[clear], scenes[0].u[clear], rtol=2e-3)

    def test_feedback_is_u_over_the_lit_part(self, scene: Scene, light: SeparatedLight) -> None:
        lit_sr = np.where(scene.inner, scene.solid, 0)
        found = measured_feedback(scene, [light, light], lit_sr, 0.0, 0.0)
        expected = np.tensordot(lit_sr, scene.u, 2)
        np.testing.assert_allclose(found.value, expected, rtol=2e-3)
        # if two projectors agree, only the error of the border remains
        np.testing.assert_allclose(found.sigma, 1e-3 * found.value, rtol=1e-6)

    def test_disagreement_of_projectors_widens_the_error(
        self, scene: Scene, light: SeparatedLight
    ) -> None:
        other = SeparatedLight(light.direct, 1.1 * light.scattered, light.flux, light.lit)
        lit_sr = np.where(scene.inner, scene.solid, 0)
        found = measured_feedback(scene, [light, other], lit_sr, 0.0, 0.0)
        single = measured_feedback(scene, [light, light], lit_sr, 0.0, 0.0).value
        np.testing.assert_allclose(found.value, 1.05 * single, rtol=1e-4)
        expected = np.hypot(0.05 * single, 1e-3 * found.value)
        np.testing.assert_allclose(found.sigma, expected, rtol=1e-4)

    def test_unknown_glare_widens_the_error(self, scene: Scene, light: SeparatedLight) -> None:
        lit_sr = np.where(scene.inner, scene.solid, 0)
        found = measured_feedback(scene, [light, light], lit_sr, 0.01, 0.0)
        total = np.tensordot(scene.solid, light.direct + light.scattered, 2) / light.flux
        expected = 0.01 * total * lit_sr.sum() / scene.solid.sum()
        np.testing.assert_allclose(found.sigma, np.hypot(expected, 1e-3 * found.value), rtol=1e-5)

    def test_error_of_direct_light_widens_the_error(
        self, scene: Scene, light: SeparatedLight
    ) -> None:
        lit_sr = np.where(scene.inner, scene.solid, 0)
        found = measured_feedback(scene, [light, light], lit_sr, 0.0, 0.005)
        np.testing.assert_allclose(found.sigma, np.hypot(0.005, 1e-3) * found.value, rtol=1e-6)


class TestAlbedo:
    screen_sr = cap_solid_angle(np.pi / 2)

    def test_of_a_uniform_hemisphere(self) -> None:
        """m = kappa / (1 - kappa) with kappa = rho / 2."""
        rho = np.array([0.3, 0.5, 0.8])
        m = Measured(rho / 2 / (1 - rho / 2), np.zeros(3))
        found = estimate_albedo(m, self.screen_sr, self.screen_sr, Dome(6.0, np.pi / 2), 0.01)
        np.testing.assert_allclose(found.value, rho, rtol=1e-12)
        np.testing.assert_allclose(found.sigma, 0.01 * rho, rtol=1e-12)

    def test_errors_of_feedback_and_floor_propagate(self) -> None:
        m = Measured(np.full(3, 0.33), np.full(3, 0.003))
        sharp, vague = Dome(6.0, np.pi / 2), Dome(6.0, np.pi / 2, 0.0, 0.1, 0.03)
        first = estimate_albedo(m, self.screen_sr, self.screen_sr, sharp, 0.001)
        second = estimate_albedo(m, self.screen_sr, self.screen_sr, vague, 0.001)
        assert (first.sigma > 2 * 0.001 * first.value).all()
        assert (second.sigma > 2 * first.sigma).all()
        assert (second.value < first.value).all()  # the floor explains part of the feedback
