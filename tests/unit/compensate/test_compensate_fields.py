"""Fields of a calibration: what stands in them where something is lit, and just beside it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.fields import REACH, Fields
from procam.maths.scatter_kernel import basis
from procam.maths.sphere import master_directions, master_solid_angles
from procam.maths.warp import grow
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


class TestBesideTheLitPart:
    def test_even_fields_go_on_evenly_and_end(self, bare: Calibration) -> None:
        model = Fields.of(bare, SIZE).shown
        lit = bare.maps.coverage > 0
        corners = lit.copy()
        for _ in range(REACH):  # nodes that touch, at corners too
            wide = np.pad(corners, 1)
            parts = [wide[y : y + SIZE, x : x + SIZE] for y in range(3) for x in range(3)]
            corners = np.logical_or.reduce(parts)
        assert 0 < corners.mean() - lit.mean() < 0.2
        assert model.hi is not None and model.gain is not None
        fields = {0.1: model.spread, 0.01: model.lo, 2.0: model.hi, 0.8: model.gain[..., None]}
        for value, field in fields.items():
            expected = np.where(corners[..., None], value, 0)
            np.testing.assert_allclose(field, np.broadcast_to(expected, field.shape), rtol=1e-6)

    def test_nodes_there_are_means_of_their_lit_neighbours(self, bare: Calibration) -> None:
        hi = np.random.default_rng(1).uniform(1, 2, (SIZE, SIZE, 3)).astype(np.float32)
        noisy = replace(bare, maps=replace(bare.maps, hi=hi))
        lit, found = bare.maps.coverage > 0, Fields.of(noisy, SIZE).shown.hi
        assert found is not None
        np.testing.assert_array_equal(found[lit], hi[lit])
        beside = np.argwhere(grow(lit, 1) & ~lit)
        assert len(beside) > SIZE
        for y, x in beside:
            near = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            if 0 < y < SIZE - 1 and 0 < x < SIZE - 1:
                mean = hi[near][lit[near]].mean(axis=0)
                np.testing.assert_allclose(found[y, x], mean, rtol=1e-6)

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

    @pytest.mark.parametrize("size", [48, SIZE, 200])
    def test_solid_angles_are_of_pixels_of_the_picture(self, bare: Calibration, size: int) -> None:
        model = Fields.of(bare, size).shown
        whole = master_solid_angles(size)[size // 2, size // 2]
        lit = model.coverage[model.nodes // 2, model.nodes // 2]
        assert model.solid_angle_sr[model.nodes // 2, model.nodes // 2] == pytest.approx(
            lit * whole, rel=1e-3
        )
        assert model.nodes == min(size, SIZE)
