"""Irradiance by projectors on the faces of a mesh."""

import numpy as np
from mesh_shapes import box, fine_box, hemisphere

from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.maths.mesh.coupling import projector_coupling
from procam.maths.mesh.facets import face_areas
from simulators.solid_angles import triangle_solid_angles

SIZE = (64, 48)
FORWARD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # +x ahead, z up
UP = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def projector(focal: float, turn: np.ndarray = FORWARD) -> tuple[Lens, Pose, tuple[int, int]]:
    """At the origin."""
    lens = Lens("brown", np.full(2, focal), (np.array(SIZE) - 1) / 2, np.zeros(5))
    return lens, Pose(turn, np.zeros(3)), SIZE


def test_all_light_arrives_in_a_closed_room() -> None:
    vertices, faces = box((-1, -2, -1), (3, 2, 1))
    coupling = projector_coupling(vertices, faces, projector(20.0))
    flux = np.random.default_rng(0).uniform(size=SIZE[0] * SIZE[1])
    landed = face_areas(vertices, faces) @ (coupling @ flux)
    np.testing.assert_allclose(landed, flux.sum(), rtol=1e-9)


def test_light_beyond_an_open_screen_is_lost() -> None:
    vertices, faces = hemisphere(3.0, 12)
    coupling = projector_coupling(
        vertices, faces, projector(20.0)
    )  # half of it points below the rim
    landed = face_areas(vertices, faces) @ coupling.toarray()
    rows = landed.reshape(SIZE[1], SIZE[0])
    np.testing.assert_allclose(rows[: SIZE[1] // 2 - 1], 1, rtol=1e-9)
    np.testing.assert_allclose(rows[SIZE[1] // 2 + 1 :], 0)


def test_irradiance_on_a_wall_is_the_panels_magnified() -> None:
    """A plane wall at distance d gets (f / d)^2 of each pixel's light per square metre."""
    vertices, faces = fine_box((-1, -4, -4), (2, 4, 4), 4)
    coupling = projector_coupling(vertices, faces, projector(20.0), samples=16)
    lit = coupling @ np.ones(SIZE[0] * SIZE[1])
    corners = vertices[faces]
    wide, high = (np.array(SIZE) / 2 - 1) / 20 * 2
    inside = (np.abs(corners[..., 1]) < wide) & (np.abs(corners[..., 2]) < high)
    whole = inside.all(axis=1) & (corners[..., 0] == 2).all(axis=1)
    assert whole.sum() >= 4
    np.testing.assert_allclose(lit[whole], (20 / 2) ** 2, rtol=5e-3)


def test_a_fisheye_in_a_spheres_middle_lights_by_solid_angle() -> None:
    """An equidistant lens spreads equal flux over equal angles: theta / sin(theta) per solid angle."""
    vertices, faces = hemisphere(2.0, 6)
    focal = 15.0
    lens = Lens("kannala-brandt", np.full(2, focal), np.array([23.5, 23.5]), np.zeros(4))
    room = (lens, Pose(UP, np.zeros(3)), (48, 48))
    lit = projector_coupling(vertices, faces, room, samples=16) @ np.ones(48 * 48)
    flux = lit * face_areas(vertices, faces)
    corners = vertices[faces] / 2.0
    solid = np.abs(triangle_solid_angles(*np.moveaxis(corners, 1, 0)))
    middle = corners.mean(axis=1)
    theta = np.arccos(middle[:, 2] / np.linalg.norm(middle, axis=1))
    near = theta < 1.2
    expected = focal**2 * (theta / np.sin(theta)) * solid
    np.testing.assert_allclose(flux[near], expected[near], rtol=0.03)
    np.testing.assert_allclose(flux[near].sum(), expected[near].sum(), rtol=3e-3)
