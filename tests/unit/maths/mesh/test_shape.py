"""A mesh as the screen of the bundle adjustment."""

from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest

from procam.errors import InputError
from procam.kernels.bundle.reference import on_screen
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.raycast import MeshTracer, weights_of_corners
from procam.maths.mesh.rooms import Room, planned_room
from procam.maths.mesh.shape import MeshShape
from procam.model.screen import RoomScreen
from simulators.room_obj import L_LENGTHS
from simulators.walls import walls_of


def l_room() -> Room:
    """That of `simulators.room_obj`, by walls."""
    vertices, faces, part, names = [], [], [], []
    at = np.linspace(0, 1, 13)
    u, v = np.meshgrid(at, at)
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    for number, wall in enumerate(walls_of("L", L_LENGTHS)):
        vertices.append(wall.points(u, v).reshape(-1, 3))
        faces.append(triangles + number * u.size)
        part.append(np.full(len(triangles), number))
        names.append(wall.name)
    every = np.concatenate(vertices)
    places = np.full((len(every), 2), np.nan)
    return Room(
        tuple(names), every, np.concatenate(faces), np.concatenate(part), places, (6.0, 8.0)
    )


def test_a_mesh_that_the_origin_does_not_see_is_refused() -> None:
    vertices, faces = mesh_shapes.box((-8.5, -7.6, -2.0), (8.3, 7.9, 6.5))
    with pytest.raises(InputError, match="the origin sees 2 of 12 faces edge-on"):
        MeshShape.of(vertices + np.array([0, 0, 2.0]), faces)


class TestHemisphere:
    """A mesh of a sphere gives the same points and gradients as the sphere."""

    vertices, faces = mesh_shapes.hemisphere(6.0, 40)
    mesh = MeshShape.of(vertices, faces, smooth=True)
    sphere = RoundShape(6.0)

    def _rays(self) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(4)
        direction = normalise(rng.normal(size=(500, 3)) * [1, 1, 0.3] + [0, 0, 1.0])
        return rng.normal(0, 0.5, (500, 3)) + np.array([0, 0, 0.5]), direction

    def test_points_and_gradients(self) -> None:
        origin, direction = self._rays()
        found, known = self.mesh.hit(origin, direction), self.sphere.hit(origin, direction)
        assert np.abs(found.point - known.point).max() < 1e-5
        assert np.abs(normalise(found.outward) - known.outward).max() < 1e-4

    def test_radius(self) -> None:
        _, direction = self._rays()
        np.testing.assert_allclose(self.mesh.radius_at(direction), 6.0, atol=1e-5)

    def test_rays_that_miss_are_nan(self) -> None:
        down = np.array([[0.0, 0.6, -0.8]])
        assert np.isnan(self.mesh.intersect(np.zeros((1, 3)), down)).all()
        assert np.isnan(self.mesh.radius_at(down)).all()


class TestMovedWalls:
    """A box whose walls are not where they were drawn."""

    room = planned_room("box", (6.0, 5.0, 3.0), ("front", "left", "floor"), 600)
    drawn = MeshShape.of(
        room.vertices, room.faces, part=room.part, free={0: "left", 1: "front", 4: "floor"}
    )

    def _moved(self) -> MeshShape:
        shape = self.drawn.with_free_walls()
        moves = np.random.default_rng(2).normal(0, 0.004, shape.moves.size)
        return replace(shape, harmonic_coefficients=np.r_[1.0, moves])

    def _rays(self) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(4)
        return rng.normal(0, 0.4, (400, 3)), normalise(rng.normal(size=(400, 3)))

    def test_rays_meet_the_moved_mesh(self) -> None:
        moved, (origin, direction) = self._moved(), self._rays()
        vertices = moved.mesh.moved_vertices(moved.moves) * moved.radius_m
        exact = MeshTracer(vertices, self.room.faces).intersect(origin, direction)
        np.testing.assert_allclose(moved.intersect(origin, direction), exact, atol=1e-9)
        assert np.abs(exact - self.drawn.intersect(origin, direction)).max() > 0.01

    def test_derivatives_extrapolate_to_other_moves(self) -> None:
        moved, (origin, direction) = self._moved(), self._rays()
        step = np.random.default_rng(3).normal(0, 1e-4, moved.moves.size)
        coefficients = moved.harmonic_coefficients + np.r_[0.0, step]
        further = replace(moved, harmonic_coefficients=coefficients)
        known = moved.shape_derivatives(origin, direction)
        linear = on_screen(origin, direction, moved.radius_m, coefficients, known).point
        error = np.linalg.norm(linear - further.intersect(origin, direction), axis=1)
        travel = np.linalg.norm(linear - moved.intersect(origin, direction), axis=1)
        assert np.quantile(travel, 0.8) > 3e-4  # of rays that meet one of the three walls
        assert np.quantile(error, 0.9) < 0.01 * np.quantile(travel, 0.8)

    def test_a_moved_point_is_drawn_where_it_was(self) -> None:
        moved, (_, direction) = self._moved(), self._rays()
        point = self.drawn.intersect(np.zeros((1, 3)), direction)
        hits = self.drawn.tracer.first_hits(np.zeros(3), direction)
        corner = self.room.faces[hits.faces]
        share = weights_of_corners(self.room.vertices[corner], point)
        vertices = moved.mesh.moved_vertices(moved.moves) * moved.radius_m
        there = np.einsum("nk,nki->ni", share, vertices[corner])
        np.testing.assert_allclose(moved.drawn(there), point, atol=2e-5)

    def test_a_screen_has_the_walls_that_were_solved(self) -> None:
        moved = self._moved()
        screen = RoomScreen("box", (6.0, 5.0, 3.0), ("front", "left", "floor")).solved(moved)
        direction = self._rays()[1]
        np.testing.assert_allclose(
            screen.shape.intersect(np.zeros((1, 3)), direction),
            moved.intersect(np.zeros((1, 3)), direction),
            atol=1e-3,  # its mesh is finer, and so are the faces beside edges
        )
        assert RoomScreen("box", (6.0, 5.0, 3.0), ("front",)).solved(self.drawn).moved == ()


class TestRoomOfTheShapeOfAnL:
    """The inner corner, at (0.5, -0.5), hides parts of walls from who stands beside it."""

    screen = RoomScreen.of_mesh(l_room(), ("front", "inner-front", "floor"), ())

    def test_the_origin_sees_all(self) -> None:
        assert self.screen.shape.mesh.seen.all()

    def test_what_the_corner_hides(self) -> None:
        """From (-1, -2) the front wall at x = 2.5 ends at y = 1: the line through the corner."""
        eye, y = np.array([-1.0, -2.0, 0.0]), np.linspace(-0.4, 2.9, 34)
        wall = np.stack([np.full_like(y, 2.5), y, np.zeros_like(y)], axis=-1)
        corner = -2.0 + 3.5 * 1.5 / 1.5
        np.testing.assert_array_equal(self.screen.shape.sees(eye, wall), y > corner)
        assert MeshShape.of(*mesh_shapes.box((-3, -3, -1), (3, 3, 1))).sees(eye, wall).all()

    def test_what_the_origin_does_not_see_has_no_place(self) -> None:
        """A seat hides the floor behind it, and its own back."""
        room = l_room()
        seat, faces = mesh_shapes.box((1.0, 1.0, -1.5), (1.5, 1.5, 0.5))
        vertices = np.concatenate([room.vertices, seat])
        faces = np.concatenate([room.faces, faces[:, ::-1] + len(room.vertices)])
        shape = MeshShape.of(vertices, faces, convex=False)
        down = np.array([[2.0, 2.0, -1.0], [0.5, 2.0, -1.0]]), np.array([[0.0, 0, -1], [0, 0, -1]])
        found = shape.intersect(*down)
        assert np.isnan(found[0]).all()
        np.testing.assert_allclose(found[1], [0.5, 2.0, -1.5], atol=1e-9)
