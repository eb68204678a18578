"""The compensator on a calibration that is fully known."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.compensator import Compensator
from procam.errors import InputError, ShapeError
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.mask import Mask

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
