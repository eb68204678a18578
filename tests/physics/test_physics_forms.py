"""Inter-reflection on meshes, against dense solves and traced rays."""

from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest

from procam.maths.geometry.sphere import normalise
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
