"""The closed forms of a sphere against dense solves of (I - rho F) b = b0.

On a sphere F_ij = a_j / (4 pi) for every pair of patches, whatever their size (paper eq. 7), so a
dense solve over all that reflects, lit or not, is exact and shares no formula with the code.
"""

import numpy as np
import pytest
from tolerances import CLOSED_FORM, SOLVER

from procam.errors import InputError
from procam.maths.light.radiosity import (
    add_interreflection,
    albedo_from_feedback,
    remove_interreflection,
    sphere_scatter,
)
from studies.closed_forms import (
    add_interreflection_paper,
    add_zoned_interreflection,
    bounce,
    bounce_paper,
    remove_zoned_interreflection,
)

COUNT = 300


class Sphere:
    """Patches of a sphere of which some are open; light is solved with matrices."""

    def __init__(
        self, reflecting: float, lit: float, albedo: float, variation: float = 0.0
    ) -> None:
        rng = np.random.default_rng(3)
        self.solid = rng.uniform(0.3, 1, COUNT)
        self.lit = np.arange(COUNT) < COUNT // 2
        for group, share in ((self.lit, lit), (~self.lit, reflecting - lit)):
            self.solid[group] *= 4 * np.pi * share / self.solid[group].sum()
        self.albedo = albedo * (1 + variation * rng.uniform(-1, 1, (COUNT, 1)))
        self.direct = np.where(self.lit[:, None], rng.uniform(0, 1, (COUNT, 1)), 0)
        self.factors = np.broadcast_to(self.solid / (4 * np.pi), (COUNT, COUNT))

    def total(self) -> np.ndarray:
        return np.linalg.solve(np.eye(COUNT) - self.albedo * self.factors, self.direct)


class TestSphere:
    @pytest.mark.parametrize("albedo", [0.3, 0.8])
    def test_closed_form_from_the_albedo_of_all_that_reflects(self, albedo: float) -> None:
        room = Sphere(0.5, 0.3, albedo, variation=0.2)
        u = sphere_scatter(room.albedo, room.solid)
        found = add_interreflection(room.direct, u, room.solid)
        np.testing.assert_allclose(found, room.total(), atol=SOLVER)

    @pytest.mark.parametrize(
        ("reflecting", "lit", "albedo"), [(0.5, 0.45, 0.5), (0.5, 0.3, 0.8), (0.98, 0.6, 0.7)]
    )
    def test_scatter_measured_with_one_picture_serves_every_other(
        self, reflecting: float, lit: float, albedo: float
    ) -> None:
        """Of the lit part alone, whatever else reflects."""
        room = Sphere(reflecting, lit, albedo, variation=0.15)
        solid, first = room.solid[room.lit], room.direct[room.lit]
        u = (room.total()[room.lit] - first) / (solid @ first)
        room.direct = room.direct**3
        second, total = room.direct[room.lit], room.total()[room.lit]
        np.testing.assert_allclose(add_interreflection(second, u, solid), total, rtol=SOLVER)
        np.testing.assert_allclose(remove_interreflection(total, u, solid), second, atol=SOLVER)

    @pytest.mark.parametrize("albedo", [0.3, 0.55, 0.8])
    def test_albedo_from_the_feedback_of_a_partly_lit_cap(self, albedo: float) -> None:
        room = Sphere(0.5, 0.4, albedo)
        solid, first = room.solid[room.lit], room.direct[room.lit]
        feedback = solid @ (room.total()[room.lit] - first) / (solid @ first)
        found = albedo_from_feedback(feedback, float(solid.sum()), float(room.solid.sum()))
        np.testing.assert_allclose(found, albedo, rtol=SOLVER)

    def test_bounces_one_by_one(self) -> None:
        """Each is F times the one before; together they are all the light there is."""
        room = Sphere(0.6, 0.4, 0.5, variation=0.3)
        light, total = room.direct, room.direct
        for order in range(1, 80):
            light = room.albedo * (room.factors @ light)
            found = bounce(room.direct, room.albedo, room.solid, order)
            np.testing.assert_allclose(found, light, atol=1e-15, rtol=1e-10)
            total = total + found
        np.testing.assert_allclose(total, room.total(), atol=SOLVER)

    @pytest.mark.parametrize(("albedo", "short"), [(0.5, 0.12), (0.8, 0.21)])
    def test_the_paper_with_lit_area_alone_understates(self, albedo: float, short: float) -> None:
        """By (1 - rho f_R) / (1 - rho f_L), f_R = 0.5 and f_L = 0.3 (docs/theory/interreflection.md)."""
        room = Sphere(0.5, 0.3, albedo)
        lit = room.lit
        estimate = add_interreflection_paper(room.direct[lit], albedo, room.solid[lit])
        ratio = (estimate - room.direct[lit]) / (room.total() - room.direct)[lit]
        np.testing.assert_allclose(ratio, (1 - albedo * 0.5) / (1 - albedo * 0.3), rtol=1e-9)
        assert 1 - ratio.mean() == pytest.approx(short, abs=0.005)

    def test_the_paper_is_exact_where_all_that_reflects_is_given(self) -> None:
        room = Sphere(0.5, 0.3, 0.5)
        estimate = add_interreflection_paper(room.direct, 0.5, room.solid)
        np.testing.assert_allclose(estimate, room.total(), atol=SOLVER)
        for order in (1, 2, 5):
            np.testing.assert_allclose(
                bounce_paper(room.direct, 0.5, room.solid, order),
                bounce(room.direct, room.albedo, room.solid, order),
                rtol=CLOSED_FORM,
            )

    @pytest.mark.parametrize("port", [0.02, 0.4])
    def test_integrating_sphere(self, port: float) -> None:
        """Goebel 1967: M = rho / (1 - rho (1 - f_port)) of the light of a lamp on the wall."""
        room = Sphere(1 - port, 0.5, 0.9)
        u = sphere_scatter(room.albedo, room.solid)
        flux = room.solid @ room.direct
        multiplier = 4 * np.pi * u * flux / (flux * room.albedo) * room.albedo
        np.testing.assert_allclose(multiplier, 0.9 / (1 - 0.9 * (1 - port)), rtol=1e-9)

    def test_a_furnace_is_refused(self) -> None:
        room = Sphere(1.0, 0.5, 1.0)
        with pytest.raises(InputError, match="1 of its light at every bounce"):
            sphere_scatter(room.albedo, room.solid)


class TestZones:
    def test_one_zone_is_the_measured_form(self) -> None:
        room = Sphere(0.5, 0.3, 0.5, variation=0.3)
        u = sphere_scatter(room.albedo, room.solid)
        found = add_zoned_interreflection(room.direct, u[None], room.solid[None])
        np.testing.assert_allclose(found, add_interreflection(room.direct, u, room.solid))

    def test_removing_undoes_adding(self) -> None:
        rng = np.random.default_rng(5)
        scatter, direct = rng.uniform(0, 0.1, (7, 50, 3)), rng.uniform(0, 1, (50, 3))
        collect = rng.uniform(0, 0.2, (7, 50)) * (rng.random((7, 50)) < 0.3)
        total = add_zoned_interreflection(direct, scatter, collect)
        np.testing.assert_allclose(
            remove_zoned_interreflection(total, scatter, collect), direct, atol=SOLVER
        )
