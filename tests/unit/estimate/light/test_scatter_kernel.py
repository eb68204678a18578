"""Degree of the scatter kernel by cross-validation, and albedo of the floor, in traced rooms."""

from dataclasses import replace

import numpy as np
import pytest
from traced_rooms import TracedRoom, parts

from procam.errors import OutOfModelRange
from procam.estimate.light.scatter_kernel import (
    CELLS,
    ScatterCells,
    cell_basis,
    fit_scatter,
)
from procam.maths.geometry.sphere import master_directions, master_solid_angles


def fitted(room: TracedRoom, noise: float = 0.003):  # type: ignore[no-untyped-def]
    per_flux, white = room.known()
    found = [room.scatter_sample(lit, noise) for lit in parts()]
    return fit_scatter(found, per_flux, cell_basis().T @ white)


def test_a_furnished_one_takes_a_higher_degree(furnished: TracedRoom) -> None:
    fit = fitted(furnished)
    assert fit.kernel.degree >= 1
    assert fit.held_out[fit.kernel.degree] < 0.5 * fit.held_out[0]
    assert f"degree {fit.kernel.degree} used" in fit.summary()


def test_a_degree_that_gains_a_twentieth_is_not_worth_it(
    bare: TracedRoom, furnished: TracedRoom
) -> None:
    """A bare dome with a tenth of the light of a furnished one."""
    both = [[room.scatter_sample(lit, 0.0) for lit in parts()] for room in (bare, furnished)]
    mixed = [
        replace(a, scattered=0.9 * a.scattered + 0.1 * b.scattered)
        for a, b in zip(*both, strict=True)
    ]
    (empty, white), (full, _) = bare.known(), furnished.known()
    fit = fit_scatter(mixed, 0.9 * empty + 0.1 * full, cell_basis().T @ white)
    assert 0.93 < fit.held_out[1] / fit.held_out[0] < 0.98
    assert fit.kernel.degree == 0


def test_pictures_that_miss_the_dome_are_left_out(furnished: TracedRoom) -> None:
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.003) for lit in parts()]
    dark = replace(found[0], direct=1e-4 * found[0].direct, scattered=1e-4 * found[0].scattered)
    moment = cell_basis().T @ white
    chosen = fit_scatter([*found, dark], per_flux, moment)
    assert chosen.kernel.degree == fit_scatter(found, per_flux, moment).kernel.degree >= 1
    assert max(chosen.held_out.values()) < 0.2


def test_pictures_held_out_are_predicted_from_the_others_alone(furnished: TracedRoom) -> None:
    """The error at degree 1 is that of kernels fitted to four of five pictures, without the fifth.

    Kernels fitted to all five would miss each by a tenth less.
    """
    per_flux, white = furnished.known()
    samples = [furnished.scatter_sample(lit, 0.003) for lit in parts()[:5]]
    moment = cell_basis().T @ white
    missed = []
    for number, left_out in enumerate(samples):
        others = [x for i, x in enumerate(samples) if i != number]
        kernel = fit_scatter(others, per_flux, moment).kernel
        assert kernel.degree == 1
        seen = np.isfinite(left_out.scattered + per_flux)[:, 0] & (per_flux[:, 0] > 0)
        phi = cell_basis()[seen, :4]
        by_profile = per_flux[seen, 0] / (phi @ kernel.profile[0])
        expected = by_profile * (phi @ kernel.matrix[0] @ left_out.moment[:4, 0])
        error = left_out.scattered[seen, 0] - expected
        missed.append(np.mean(error**2) / np.mean(expected) ** 2)
    found = fit_scatter(samples, per_flux, moment).held_out[1]
    assert found == pytest.approx(np.sqrt(np.mean(missed)), rel=0.01)


@pytest.mark.parametrize(
    ("per_flux", "white", "message"),
    [
        (-1.0, 1.0, "no scattered light .+ glare or black_level"),
        (1.0, np.nan, "full white is unknown"),
    ],
)
def test_impossible_light_is_refused(
    per_flux: float, white: float, message: str, bare: TracedRoom
) -> None:
    found = [bare.scatter_sample(lit, 0.0) for lit in parts()[:2]]
    with pytest.raises(OutOfModelRange, match=message):
        fit_scatter(found, np.full((CELLS**2, 1), per_flux), np.full((9, 1), white))


def test_too_few_pictures_take_one_scalar(furnished: TracedRoom) -> None:
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()[:1]]
    fit = fit_scatter(found, per_flux, cell_basis().T @ white)
    assert fit.kernel.degree == 0 and not fit.held_out
    assert "too few pictures" in fit.summary()


class TestCells:
    def camera(self) -> ScatterCells:
        direction, inside = master_directions(4 * CELLS)
        self.inside = inside
        return ScatterCells(direction.astype(np.float32), inside * master_solid_angles(4 * CELLS))

    def test_means_and_flux(self) -> None:
        cells = self.camera()
        picture = np.full((4 * CELLS, 4 * CELLS, 3), 0.5, np.float32)
        found = cells.scatter_sample(picture, self.inside, 2 * picture)
        known = found.pixels > 0
        np.testing.assert_allclose(found.scattered[known], 0.5)
        np.testing.assert_allclose(found.direct.sum(axis=0), 2 * np.pi, rtol=2e-3)
        np.testing.assert_allclose(found.moment[0], found.direct.sum(axis=0))

    def test_cells_with_direct_light_in_them_are_unknown(self) -> None:
        cells = self.camera()
        picture = np.ones((4 * CELLS, 4 * CELLS, 3), np.float32)
        known = self.inside.copy()
        known[: 2 * CELLS + 2] = False  # half of a row of cells
        mean, pixels = cells.mean(picture, known)
        rows = np.isfinite(mean[:, 0]).reshape(CELLS, CELLS).any(axis=1)
        assert not rows[: CELLS // 2 + 1].any() and rows[CELLS // 2 + 1 :].any()
        assert (pixels[~np.isfinite(mean[:, 0])] == 0).all()
