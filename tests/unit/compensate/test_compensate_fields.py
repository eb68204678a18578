"""Fields of a calibration: what stands in them where something is lit, and just beside it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.compensator import Compensator
from procam.compensate.fields import SAMPLE, Fields
from procam.compensate.projector_frames import projector_frames
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import (
    direction_from_angles,
    master_directions,
)
from procam.maths.light.scatter_kernel import basis
from procam.maths.warp import sample
from procam.model.calibration import Calibration
from procam.model.transport import ScatterKernel

SIZE = 96


@pytest.fixture
def bare(make_calibration: Callable[..., Calibration]) -> Calibration:
    """Maps of ones and twos, lit in a ragged part of the half sphere that meets the picture's edge."""
    made = make_calibration(size=SIZE)
    direction, inside = master_directions(SIZE)
    lit = inside & (direction[..., 0] + 0.2 * np.sin(9 * direction[..., 1]) > -0.3)
    lit[40:43, 50:52] = False
    one = np.where(lit[..., None], np.ones(3, np.float32), 7)
    maps = replace(
        made.maps,
        scatter_per_flux=0.1 * one,
        lo=0.01 * one,
        hi=2 * one,
        coverage=lit.astype(np.float32),
        falloff=np.where(lit, np.float32(0.8), np.float32(3)),
    )
    return replace(made, maps=maps)


def beyond(lit: np.ndarray, nodes: int) -> np.ndarray:
    """Nodes that are lit, or so many steps from there, corners too."""
    for _ in range(nodes):
        wide = np.pad(lit, 1)
        parts = [wide[y : y + SIZE, x : x + SIZE] for y in range(3) for x in range(3)]
        lit = np.logical_or.reduce(parts)
    return lit


class TestBesideTheLitPart:
    def test_even_fields_go_on_evenly_and_end(self, bare: Calibration) -> None:
        model, lit = Fields.of(bare, SIZE).shown, bare.maps.coverage > 0
        near, far = beyond(lit, 5), ~beyond(lit, 9)
        assert 0 < near.mean() - lit.mean() < 0.2 < far.mean()
        assert model.hi is not None and model.gain is not None
        fields = {0.1: model.spread, 0.01: model.lo, 2.0: model.hi, 0.8: model.gain[..., None]}
        for value, field in fields.items():
            np.testing.assert_allclose(field[near], value, rtol=1e-6)
            assert not field[far].any()

    def test_nodes_there_are_means_of_their_lit_neighbours(self, bare: Calibration) -> None:
        hi = np.random.default_rng(1).uniform(1, 2, (SIZE, SIZE, 3)).astype(np.float32)
        noisy = replace(bare, maps=replace(bare.maps, hi=hi))
        lit, found = bare.maps.coverage > 0, Fields.of(noisy, SIZE).shown.hi
        assert found is not None
        np.testing.assert_array_equal(found[lit], hi[lit])
        beside = np.argwhere(beyond(lit, 1) & ~lit)
        assert (beside == SIZE - 1).any() and len(beside) > SIZE
        for y, x in beside:
            near = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            mean = hi[near][lit[near]].mean(axis=0)
            np.testing.assert_allclose(found[y, x], mean, rtol=1e-6)

    def test_a_border_that_fades_dims_no_picture(self, bare: Calibration) -> None:
        """Measured limits fade with the coverage, faster where that is faint; the projectors do not."""
        from_border = np.clip(np.arange(SIZE) - SIZE / 3, 0, 5) / 5
        coverage = np.where(bare.maps.coverage > 0, from_border[:, None], 0).astype(np.float32)
        hi = (
            2 * np.where(coverage < 0.3, coverage / 3, coverage)[..., None] * np.ones(3, np.float32)
        )
        maps = replace(bare.maps, coverage=coverage, hi=hi)
        found = Compensator(replace(bare, maps=maps), 4 * SIZE)
        asked = np.full((4 * SIZE, 4 * SIZE, 3), 0.9, np.float32)
        assert found.predict(asked).free[found.lit].all()

    def test_what_is_faint_everywhere_keeps_what_was_measured(self, bare: Calibration) -> None:
        coverage = np.where(bare.maps.coverage > 0, np.float32(0.3), np.float32(0))
        lo = np.random.default_rng(2).uniform(0, 0.01, (SIZE, SIZE, 3)).astype(np.float32)
        faint = replace(bare, maps=replace(bare.maps, coverage=coverage, lo=lo))
        model, lit = Fields.of(faint, SIZE).shown, coverage > 0
        np.testing.assert_array_equal(model.lo[lit], lo[lit])
        assert model.hi is not None
        np.testing.assert_allclose(model.hi[lit], 2 * 2, rtol=1e-6)  # never above twice, if faint
        np.testing.assert_allclose(model.spread[beyond(lit, 5)], 0.1, rtol=1e-6)

    @pytest.mark.filterwarnings("error")
    def test_what_is_unknown_there_spreads_nowhere(self, bare: Calibration) -> None:
        unlit = bare.maps.coverage == 0
        scatter = bare.maps.scatter_per_flux.copy()
        scatter[unlit] = np.nan
        unknown = replace(bare, maps=replace(bare.maps, scatter_per_flux=scatter))
        model = Fields.of(unknown, SIZE).shown
        np.testing.assert_array_equal(model.spread, Fields.of(bare, SIZE).shown.spread)


class TestOfTheModel:
    @pytest.mark.parametrize("degree", [0, 1, 2])
    def test_paint_times_the_profile_is_what_white_brings(
        self, bare: Calibration, degree: int
    ) -> None:
        terms, rng = (degree + 1) ** 2, np.random.default_rng(degree)
        profile = np.eye(terms)[0] + 0.05 * rng.standard_normal((3, terms))
        kernel = ScatterKernel(degree, np.stack([np.eye(terms)] * 3), profile)
        scatter = rng.uniform(0.05, 0.1, (SIZE, SIZE, 3)).astype(np.float32)
        maps = replace(bare.maps, kernel=kernel, scatter_per_flux=scatter)
        model = Fields.of(replace(bare, maps=maps), SIZE).shown
        lit = bare.maps.coverage > 0
        phi = basis(master_directions(SIZE)[0][lit], degree)
        np.testing.assert_allclose(
            model.spread[lit] * (phi @ profile.T), scatter[lit], rtol=FLOAT32
        )

    @pytest.mark.parametrize("size", [60, 129, 200, 500])
    def test_a_sample_is_of_the_whole_dome(self, bare: Calibration, size: int) -> None:
        fields = Fields.of(bare, size)
        whole = replace(fields.model, ambient=fields.model.lo)
        sample = replace(fields, model=whole).sampled().model
        assert sample.nodes == sample.size == len(fields.sampled_pixels) <= SAMPLE
        per_node = (whole.size / whole.nodes) ** 2
        assert sample.solid_angle_sr.sum() == pytest.approx(
            per_node * whole.solid_angle_sr.sum(), rel=1e-5
        )
        at = fields.sampled_pixels
        node = at * whole.nodes // size
        for name in ("spread", "lo", "hi", "ambient", "gain", "coverage"):
            expected = getattr(whole, name)[np.ix_(node, node)]
            np.testing.assert_array_equal(getattr(sample, name), expected)
        direction = master_directions(size)[0][at][:, at]
        off = np.moveaxis(sample.direction, 0, -1) - direction
        rim = (direction[..., 2] > 0.3) & (sample.coverage > 0)
        assert np.linalg.norm(off[rim], axis=-1).max() < 5 / SIZE


def test_the_same_picture_on_another_canvas_gives_the_same_light(calibration: Calibration) -> None:
    """Content of 220 degrees, turned, is taken at its own directions, not at those of 180 degrees."""

    def sky(direction: np.ndarray) -> np.ndarray:
        picture = 0.4 + 0.2 * direction[..., 0] - 0.1 * direction[..., 1]
        return np.asarray(picture[..., None].repeat(3, axis=-1), np.float32)

    canvas, size = Canvas(np.radians(220), 0.8), 384
    plain, wide = (Compensator(calibration.on(each), size) for each in (STANDARD, canvas))
    expected = plain.frame(sky(STANDARD.directions(size)[0]))
    found = wide.frame(sky(canvas.directions(size)[0]))
    low = direction_from_angles(np.linspace(-3, 3, 40), np.radians(12))
    places = np.concatenate([low, direction_from_angles(np.linspace(-3, 3, 40), np.radians(60))])
    at = [sample(p, c.pixels(places, size)) for p, c in ((expected, STANDARD), (found, canvas))]
    np.testing.assert_allclose(at[1], at[0], atol=2e-3)
    assert np.abs(at[0] - sky(places)).min() > 0.01  # it is compensated


def test_the_projectors_are_sent_the_same_from_another_canvas(calibration: Calibration) -> None:
    def frames(canvas: Canvas) -> dict[str, np.ndarray]:
        ramp = 0.4 + 0.2 * canvas.directions(384)[0][..., :1].repeat(3, axis=-1)
        return projector_frames(np.asarray(ramp, np.float32), calibration.on(canvas))

    expected, found = frames(STANDARD), frames(Canvas(np.radians(220), -1.0))
    for name, frame in expected.items():
        np.testing.assert_allclose(found[name], frame, atol=2e-3)
