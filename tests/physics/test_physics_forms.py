"""Every form of adding and removing inter-reflection, against matrix solves and traced rays."""

from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest
from tolerances import CLOSED_FORM, SOLVER

from procam.errors import InputError
from procam.maths.geometry.sphere import normalise
from procam.maths.light.radiosity import add_interreflection, sphere_scatter
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.form_factors import form_factors
from procam.maths.mesh.radiosity import (
    add_mesh_interreflection,
    check_gain,
    remove_mesh_interreflection,
)
from simulators.presets import REALISTIC
from simulators.surface import Surface
from simulators.transport import DOME_RINGS, DOME_SECTORS, Deck, Room
from studies.closed_forms import (
    add_interreflection_paper,
    add_zoned_interreflection,
    bounce,
    bounce_paper,
    remove_interreflection_paper,
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

    def test_a_round_trip_does_not_show_that(self) -> None:
        room = Sphere(0.5, 0.3, 0.5)
        lit = room.lit
        estimate = add_interreflection_paper(room.direct[lit], 0.5, room.solid[lit])
        back = remove_interreflection_paper(estimate, np.full((lit.sum(), 1), 0.5), room.solid[lit])
        np.testing.assert_allclose(back, room.direct[lit], atol=1e-12)

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

    def test_two_level_contrast_is_not_changed_by_compensation(self) -> None:
        """Black of a checkerboard is what white scatters: (1 - rho f (1 - p)) / (rho f p)."""
        room, share, albedo = Sphere(0.5, 0.5 - 1e-9, 0.6), 0.5, 0.6
        white = np.cumsum(room.solid) < share * room.solid.sum()
        share = room.solid[white].sum() / room.solid.sum()
        u = sphere_scatter(room.albedo, room.solid)
        shown = np.where(white[:, None], 1.0, 0.0)
        expected = (1 - albedo * 0.5 * (1 - share)) / (albedo * 0.5 * share)
        for drive in (1.0, 0.7):  # compensation can only dim white uniformly
            total = add_interreflection(drive * shown, u, room.solid)
            assert total[white].mean() / total[~white].mean() == pytest.approx(expected, rel=1e-6)

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

    def test_zones_hold_what_one_scalar_cannot(self) -> None:
        """A traced dome over a grey deck, left half lit: one u errs, one per sector does not."""
        surface = Surface.build(replace(REALISTIC, floor_albedo=0.2, pod=False, tilt_deg=0.0))
        room = Room.trace(surface, 256)
        dome = DOME_RINGS * DOME_SECTORS
        area, albedo = room.area_m2[:dome, None], room.albedo[:dome, None]
        sector = np.arange(dome) % DOME_SECTORS // (DOME_SECTORS // 6)
        ring = np.arange(dome) // DOME_SECTORS // (DOME_RINGS // 3)
        zone = (sector + 6 * ring)[None] == np.arange(18)[:, None]

        def scattered(direct: np.ndarray) -> np.ndarray:
            flux = np.zeros((len(room.albedo), 1))
            flux[:dome] = direct * area
            return albedo * room.irradiance(flux)[:dome]

        per_zone = np.stack([scattered(z[:, None] * 1.0) / area[z].sum() for z in zone])
        whole = scattered(np.ones((dome, 1))) / area.sum()
        half = (np.arange(dome) % DOME_SECTORS < DOME_SECTORS // 2)[:, None] * 1.0
        true = scattered(half)
        one = add_interreflection(half, whole, area[:, 0]) - half
        many = add_zoned_interreflection(half, per_zone, zone * area.T) - half
        errors = [
            np.sqrt(np.mean((estimate - true) ** 2)) / true.mean() for estimate in (one, many)
        ]
        assert errors[0] > 0.02
        assert errors[1] < 0.003


class TestMesh:
    def test_a_box_keeps_its_balance(self) -> None:
        """The walls absorb all light that is sent in: sum a b0 = sum a (1 - rho) E."""
        vertices, faces = mesh_shapes.fine_box((0, 0, 0), (3, 2, 1.5), 8)
        factors, area = form_factors(vertices, faces), face_areas(vertices, faces)
        rng = np.random.default_rng(2)
        direct, albedo = rng.uniform(size=(len(faces), 3)), rng.uniform(0.2, 0.8, (len(faces), 3))
        total = add_mesh_interreflection(direct, albedo, factors)
        arriving = factors.astype(float) @ total
        np.testing.assert_allclose(area @ direct, area @ ((1 - albedo) * arriving), rtol=1e-5)
        np.testing.assert_allclose(
            remove_mesh_interreflection(total, albedo, factors), direct, atol=2e-6
        )

    def test_against_a_dense_solve(self) -> None:
        vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 5)
        factors = form_factors(vertices, faces)
        rng = np.random.default_rng(2)
        direct, albedo = rng.uniform(size=(len(faces), 2)), rng.uniform(0.2, 0.9, (len(faces), 2))
        found = add_mesh_interreflection(direct, albedo, factors)
        for c in range(2):
            system = np.eye(len(faces)) - albedo[:, c : c + 1] * factors
            np.testing.assert_allclose(
                found[:, c], np.linalg.solve(system, direct[:, c]), rtol=2e-6
            )

    def test_a_furnished_dome_against_traced_rays(self) -> None:
        """A tilted dome over its deck: mesh and form factors here, rays and counts there."""
        preset = replace(
            REALISTIC, floor_albedo=0.3, tilt_deg=0.0, ovality=0.0, panel_step_m=0.0, pod=False
        )
        surface = Surface.build(preset)
        room = Room.trace(surface, 512)
        vertices, faces, on_dome = _dome_and_deck(preset.radius_m, Deck.under(preset).radius_m)
        factors, middle = form_factors(vertices, faces), vertices[faces].mean(axis=1)
        paint = surface.albedo(normalise(middle))
        albedo = np.where(on_dome, paint, 0.3)[:, None]
        direct = np.where(on_dome & (middle[:, 1] > 0), 1.0, 0.0)[:, None]
        arriving = factors @ add_mesh_interreflection(direct, albedo, factors)

        dome = DOME_RINGS * DOME_SECTORS
        half = np.arange(dome) % DOME_SECTORS < DOME_SECTORS // 2
        flux = np.zeros((len(room.albedo), 1))
        flux[:dome, 0] = np.where(half, room.area_m2[:dome], 0)
        true = room.irradiance(flux)[:dome, 0]
        cell = room.dome_image_coordinates(normalise(middle[on_dome]))
        index = np.clip(np.floor(cell[:, 1] + 0.5), 0, DOME_RINGS - 1).astype(int) * DOME_SECTORS
        index += np.floor(cell[:, 0] - 0.5).astype(int) % DOME_SECTORS
        area = face_areas(vertices, faces)[on_dome]
        estimate = np.bincount(index, area * arriving[on_dome, 0], dome)
        estimate = estimate / np.maximum(np.bincount(index, area, dome), 1e-9)
        there = np.bincount(index, minlength=dome) > 0
        assert estimate[there].mean() == pytest.approx(true[there].mean(), rel=0.01)
        off = np.sqrt(np.mean((estimate - true)[there] ** 2)) / true[there].mean()
        assert off < 0.02

    def test_a_closed_white_room_is_refused(self) -> None:
        vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 2)
        factors = form_factors(vertices, faces)
        white = np.ones((len(faces), 1))
        with pytest.raises(InputError, match="the room returns 1 of its light at every bounce"):
            add_mesh_interreflection(white, white, factors)
        check_gain(0.99 * white, factors)

    def test_a_white_wall_in_a_grey_room_is_no_furnace(self) -> None:
        vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 2)
        factors, albedo = form_factors(vertices, faces), np.full((len(faces), 1), 0.5)
        albedo[:8] = 1.0
        check_gain(albedo, factors)


def _dome_and_deck(radius: float, deck: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A hemisphere closed by a disc, and which faces are the dome's."""
    vertices, faces = mesh_shapes.hemisphere(radius, 22)
    rings, sectors = 10, 88
    angle = np.arange(sectors) * 2 * np.pi / sectors
    points = [
        deck * r / rings * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        for r in range(1, rings + 1)
    ]
    floor = np.concatenate([np.zeros((1, 3)), *points])
    n = np.arange(sectors)
    m = (n + 1) % sectors
    parts = [np.stack([0 * n, 1 + n, 1 + m], axis=1)]
    for r in range(rings - 1):
        a, b = 1 + r * sectors, 1 + (r + 1) * sectors
        parts += [np.stack([a + n, b + n, b + m], 1), np.stack([a + n, b + m, a + m], 1)]
    deck_faces = np.concatenate(parts) + len(vertices)
    whole, every = mesh_shapes.welded(
        np.concatenate([vertices, floor]), np.concatenate([faces, deck_faces])
    )
    return whole, every, np.arange(len(every)) < len(faces)
