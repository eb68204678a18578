"""The compensator on a calibration that is fully known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.compensator import Compensator
from procam.errors import InputError, ShapeError
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.scatter_kernel import basis
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.model.transport import ScatterKernel

SIZE = 96
EXACT = 1e-6  # the goal for unclipped pixels


@pytest.fixture
def content(rng: np.random.Generator) -> np.ndarray:
    """Bright enough to be reached in most places, with some black and some too bright."""
    picture = rng.uniform(0.45, 0.9, (SIZE, SIZE, 3))
    picture[30:34, 40:60] = 0.0
    picture[60:64, 40:60] = 3.0
    return picture.astype(np.float32)


def _solid(calibration: Calibration, size: int = SIZE) -> np.ndarray:
    """Lit solid angle of each content pixel; on the maps' own grid no sampling comes in."""
    assert calibration.maps.size == size
    return master_solid_angles(size) * calibration.maps.coverage


class TestExact:
    def test_unclipped_pixels_are_exact(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE).predict(content)
        assert 0.7 < found.free[_solid(calibration) > 0].mean() < 1
        np.testing.assert_allclose(found.observed[found.free], content[found.free], atol=EXACT)

    def test_flux_is_that_of_the_direct_light(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE).predict(content)
        own = np.tensordot(_solid(calibration), found.direct.astype(float), 2)
        np.testing.assert_allclose(found.flux, own, rtol=1e-6)

    def test_observed_is_direct_plus_its_own_bounces(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE).predict(content)
        lit = _solid(calibration) > 0
        expected = found.direct + calibration.maps.scatter_per_flux * found.flux
        np.testing.assert_allclose(found.observed[lit], expected[lit], atol=EXACT)

    def test_clipped_pixels_sit_on_their_limit_and_on_the_right_side(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE).predict(content)
        lit = (_solid(calibration) > 0)[..., None]
        low = lit & (found.direct <= calibration.maps.lo * (1 + FLOAT32))
        high = lit & (found.direct >= calibration.maps.hi * (1 - FLOAT32))
        np.testing.assert_array_equal((low | high) & lit, ~found.free & lit)
        assert low.any() and high.any()
        assert (found.observed[low] >= content[low] - EXACT).all()
        assert (found.observed[high] <= content[high] + EXACT).all()

    def test_nothing_where_nothing_is_lit(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE).predict(content)
        dark = _solid(calibration) == 0
        assert not found.direct[dark].any() and not found.free[dark].any()
        assert not found.observed[dark].any()

    @pytest.mark.parametrize("size", [64, 200])
    def test_content_of_any_size(self, calibration: Calibration, size: int) -> None:
        content = np.full((size, size, 3), 0.6, np.float32)
        found = Compensator(calibration, size).predict(content)
        direction, _ = master_directions(size)
        inner = direction[..., 2] > np.sin(np.radians(15.0))
        assert found.free[inner].all()
        np.testing.assert_allclose(found.observed[inner], 0.6, atol=EXACT)

    def test_a_dome_without_bounces_shows_the_content(
        self, make_calibration: Callable[..., Calibration]
    ) -> None:
        black = make_calibration(feedback=(0.0, 0.0, 0.0), lo=0.0)
        content = np.full((SIZE, SIZE, 3), 0.4, np.float32)
        found = Compensator(black, SIZE).predict(content)
        lit = _solid(black) > 0
        np.testing.assert_allclose(found.direct[lit], 0.4, rtol=FLOAT32)

    def test_black_content_gives_the_black_level(self, calibration: Calibration) -> None:
        found = Compensator(calibration, SIZE).predict(np.zeros((SIZE, SIZE, 3), np.float32))
        np.testing.assert_allclose(found.direct, calibration.maps.lo, rtol=FLOAT32)
        assert not found.free.any()


class TestOthers:
    def test_none_is_clamp(self, calibration: Calibration, content: np.ndarray) -> None:
        found = Compensator(calibration, SIZE, "none").predict(content)
        lit = _solid(calibration) > 0
        expected = np.clip(content, calibration.maps.lo, calibration.maps.hi)[lit]
        np.testing.assert_allclose(found.direct[lit], expected, rtol=FLOAT32)
        assert (found.observed[lit] > found.direct[lit]).all()

    def test_paper_equation_12_subtracts_by_the_target(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        found = Compensator(calibration, SIZE, "paper-eq12").predict(content)
        flux = np.tensordot(_solid(calibration), content.astype(float), 2)
        wanted = content - calibration.albedo.value / (4 * np.pi) * flux
        expected = np.clip(wanted, calibration.maps.lo, calibration.maps.hi)
        lit = _solid(calibration) > 0
        np.testing.assert_allclose(found.direct[lit], expected[lit], atol=1e-6)

    def test_subtract_then_clamp_leaves_too_much_light(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        """What is clipped adds light that the target's flux did not count."""
        content[20:70, 20:70] = 0.0
        exact = Compensator(calibration, SIZE).predict(content)
        paper = Compensator(calibration, SIZE, "paper-eq12").predict(content)
        free = exact.free & paper.free
        assert (paper.observed[free] - content[free]).mean() > 0.005


@pytest.fixture
def furnished(calibration: Calibration) -> Calibration:
    """A dome whose floor returns more to the side that the light came from."""
    bend = np.diag([1.0, 0.03, 0.06, 0.05])
    bend[0, 1] = bend[1, 0] = 0.02
    kernel = ScatterKernel(1, np.stack([bend] * 3), np.tile([1.0, 0.02, 0.0, 0.0], (3, 1)))
    return replace(calibration, maps=replace(calibration.maps, kernel=kernel))


class TestFurnished:
    def scattered(self, calibration: Calibration, direct: np.ndarray) -> np.ndarray:
        """Bounced light pixel by pixel, without moments."""
        solid, kernel = _solid(calibration), calibration.maps.kernel
        lit = solid > 0
        phi = basis(master_directions(SIZE)[0][lit], kernel.degree)
        out = np.zeros_like(direct, dtype=float)
        for c in range(3):
            paint = calibration.maps.scatter_per_flux[lit][:, c] / (phi @ kernel.profile[c])
            pairs = phi @ kernel.matrix[c] @ phi.T
            out[..., c][lit] = paint * (pairs @ (solid[lit] * direct[lit][:, c]))
        return out

    def test_unclipped_pixels_are_exact(self, furnished: Calibration, content: np.ndarray) -> None:
        found = Compensator(furnished, SIZE).predict(content)
        assert 0.7 < found.free[_solid(furnished) > 0].mean() < 1
        seen = found.direct + self.scattered(furnished, found.direct.astype(float))
        np.testing.assert_allclose(seen[found.free], content[found.free], atol=2 * EXACT)
        np.testing.assert_allclose(found.observed[found.free], content[found.free], atol=EXACT)

    def test_one_sided_light_is_not_what_one_scalar_makes_of_it(
        self, furnished: Calibration, calibration: Calibration, content: np.ndarray
    ) -> None:
        content[:, : SIZE // 2] *= 0.1
        finer, scalar = (Compensator(c, SIZE).predict(content) for c in (furnished, calibration))
        difference = finer.observed - add_interreflection_of(calibration, finer.direct)
        lit = _solid(furnished) > 0
        assert np.abs(difference[lit]).max() > 0.002
        assert not np.allclose(finer.direct, scalar.direct, atol=1e-3)


def add_interreflection_of(calibration: Calibration, direct: np.ndarray) -> np.ndarray:
    flux = np.tensordot(_solid(calibration), direct.astype(float), 2)
    return direct + calibration.maps.scatter_per_flux * flux


def test_content_lies_under_the_matched_white(
    calibration: Calibration, content: np.ndarray
) -> None:
    x = np.linspace(0.6, 1, SIZE, dtype=np.float32)
    falloff = np.broadcast_to(x, (SIZE, SIZE)).copy()
    matched = replace(calibration, maps=replace(calibration.maps, falloff=falloff))
    compensator = Compensator(matched, SIZE)
    found = compensator.predict(content)
    meant = content * falloff[..., None]
    lit = _solid(calibration) > 0
    np.testing.assert_allclose(compensator.target(content)[lit], meant[lit], rtol=1e-6)
    np.testing.assert_allclose(found.observed[found.free], meant[found.free], atol=EXACT)


@pytest.fixture
def protecting(calibration: Calibration) -> Calibration:
    """A band across the dome that is left as it is: black, too bright and unlit content in it."""
    covered = np.zeros((SIZE, SIZE), bool)
    covered[25:70, 45:55] = True
    covered[40:50, :] = True
    maps = replace(calibration.maps, protected=Mask("screen", covered))
    return replace(calibration, maps=maps)


class TestProtected:
    @pytest.mark.parametrize("method", ["exact", "paper-eq12", "none"])
    def test_the_picture_is_left_as_it_is(
        self, protecting: Calibration, content: np.ndarray, method: str
    ) -> None:
        compensator = Compensator(protecting, SIZE, method)  # type: ignore[arg-type]
        _, inside = master_directions(SIZE)
        assert protecting.maps.protected is not None
        kept = protecting.maps.protected.covered & inside
        np.testing.assert_array_equal(compensator.protected, kept)
        found = compensator.predict(content)
        np.testing.assert_array_equal(found.direct[kept], content[kept])
        assert not found.free[kept].any()

    def test_the_rest_is_compensated_for_all_the_light_that_arrives(
        self, protecting: Calibration, content: np.ndarray
    ) -> None:
        """Protected light counts as far as projectors can show it."""
        found = Compensator(protecting, SIZE).predict(content)
        solid, maps = _solid(protecting), protecting.maps
        shown = np.clip(found.direct.astype(float), maps.lo, maps.hi)
        np.testing.assert_allclose(found.flux, np.tensordot(solid, shown, 2), rtol=1e-6)
        lit = solid > 0
        expected = shown + maps.scatter_per_flux * found.flux
        np.testing.assert_allclose(found.observed[lit], expected[lit], atol=EXACT)
        assert 0.6 < found.free[lit].mean() < 0.9
        np.testing.assert_allclose(found.observed[found.free], content[found.free], atol=EXACT)

    def test_more_protected_light_leaves_less_for_the_rest(
        self, protecting: Calibration, content: np.ndarray
    ) -> None:
        assert protecting.maps.protected is not None
        covered = protecting.maps.protected.covered
        dark, bright = content.copy(), content.copy()
        dark[covered], bright[covered] = 0.1, 1.0
        first, second = (Compensator(protecting, SIZE).predict(c) for c in (dark, bright))
        free = first.free & second.free
        assert (second.direct[free] < first.direct[free]).all()

    def test_all_of_the_dome(self, calibration: Calibration, content: np.ndarray) -> None:
        mask = Mask("screen", np.ones((SIZE, SIZE), bool))
        maps = replace(calibration.maps, protected=mask)
        found = Compensator(replace(calibration, maps=maps), SIZE).predict(content)
        assert not found.free.any()


class TestCalls:
    @pytest.mark.parametrize("shape", [(SIZE, SIZE), (SIZE, SIZE + 1, 3), (SIZE, SIZE, 4)])
    def test_content_of_a_wrong_shape(
        self, calibration: Calibration, shape: tuple[int, ...]
    ) -> None:
        expected = r"content has shape \(.*\); it needs \(96, 96, 3\)"
        with pytest.raises(ShapeError, match=expected):
            Compensator(calibration, SIZE).predict(np.zeros(shape, np.float32))

    def test_an_unknown_method(self, calibration: Calibration) -> None:
        with pytest.raises(
            InputError, match="method: 'magic' is unknown; choose one of exact, perceptual"
        ):
            Compensator(calibration, SIZE, "magic")  # type: ignore[arg-type]

    def test_frame_is_the_direct_light_and_can_be_put_in_place(
        self, calibration: Calibration, content: np.ndarray
    ) -> None:
        compensator = Compensator(calibration, SIZE)
        direct = compensator.frame(content)
        # the second starts from the first's solution
        np.testing.assert_allclose(direct, compensator.predict(content).direct, atol=2e-7)
        out = np.full_like(direct, np.nan)
        assert compensator.frame(content, out) is out
        np.testing.assert_allclose(out, direct, atol=2e-7)

    def test_content_is_left_alone(self, calibration: Calibration, content: np.ndarray) -> None:
        before = content.copy()
        Compensator(calibration, SIZE).frame(content)
        np.testing.assert_array_equal(content, before)


def test_maps_are_sampled_where_the_content_lies(calibration: Calibration) -> None:
    """Content of another size meets the maps at the same directions; u slants to front and left."""
    size = 64
    found = Compensator(calibration, size, "none").predict(
        np.full((size, size, 3), 0.5, np.float32)
    )
    direction, _ = master_directions(size)
    inner = direction[..., 2] > np.sin(np.radians(15.0))
    u = (found.observed - found.direct)[inner] / found.flux
    wave = 1 + 0.03 * direction[..., 0] - 0.02 * direction[..., 1]
    flat = calibration.feedback.value / (2 * np.pi * (1 - np.sin(np.radians(10.0))))
    np.testing.assert_allclose(u, wave[inner][:, None] * flat, rtol=1e-4)
