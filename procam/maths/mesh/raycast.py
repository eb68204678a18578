"""Intersects rays with a screen that is a triangle mesh.

Embree finds the face in float32. The point on it is computed in float64: if it lies outside the
face, neighbours across the nearest edge are tried; on a smooth mesh Newton's method then moves it
from the flat face to the quadratic patch through its corners.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import InputError
from procam.maths.mesh.facets import (
    Faces,
    corner_normals,
    face_normals,
    patch_points,
    patches,
    places,
    shared_edges,
)

EXTRA = 'pip install "procam[geom]"'
BLOCK = 1 << 14  # rays at a time, so that the arrays stay in the cache
BEHIND = 0.5  # of the extent: how far behind a wall a device may be, as solved by what it lights on one plane
WALK = 5  # steps to neighbours of Embree's face; the corner of a room needs up to four
SINGLE = 1e-5  # of the extent: rounding of float32, with a margin
STEPS = 5  # of Newton's method at most; the first error is about 1e-3 of an edge
CONVERGED = 1e-9  # of an edge


class Hits(NamedTuple):
    """Where rays of shape (...) meet a mesh; NaN, -1 and NaN for rays that miss.

    `points` (..., 3) [m], indices `faces` (...) and unit `normals` (..., 3).
    """

    points: Array
    faces: NDArray[np.int32]
    normals: Array


class MeshTracer:
    """Traces rays against a mesh whose normals point to the side where the devices are.

    Parameters
    ----------
    vertices : (V, 3) float64 [m]; those at one place are one.
    faces : (F, 3) indices of vertices, counter-clockwise seen from the inside.
    smooth : the mesh samples a smooth surface, with creases where faces meet at more than 30
        degrees: points lie on quadratic patches through the vertices and normals are interpolated.
        Otherwise the faces are flat, as in a panelled dome.

    Raises
    ------
    InputError
        If embreex is not installed.
    """

    def __init__(self, vertices: Array, faces: Faces, *, smooth: bool = False) -> None:
        self._scene = _embree_scene(vertices, faces)
        self._corners = vertices[faces]
        self._flat = face_normals(vertices, faces)
        self._extent = float(np.ptp(vertices, axis=0).max())
        joined = places(vertices)[faces]
        self._beyond = _faces_beyond(joined)
        self._normals = corner_normals(vertices, joined) if smooth else None
        if self._normals is not None:
            self._patches = patches(vertices, faces, self._normals)

    def intersect(self, origin: Array, direction: Array) -> Array:
        """Points (..., 3) [m] where rays meet the screen; NaN where they miss."""
        return self.first_hits(origin, direction).points

    def first_hits(self, origin: Array, direction: Array) -> Hits:
        """Where rays first meet the inside of the screen.

        `origin` (..., 3) [m] and `direction` (..., 3) of any length broadcast. A ray that first meets
        the outside misses, unless that point is within half of the screen's extent of its origin, as
        for a device on the screen or behind a hole in it.
        """
        origins, directions = np.broadcast_arrays(origin, direction)
        shape = origins.shape[:-1]
        origins, directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        hits = Hits(
            np.full(origins.shape, np.nan),
            np.full(len(origins), -1, np.int32),
            np.full(origins.shape, np.nan),
        )
        for first in range(0, len(origins), BLOCK):
            block = slice(first, first + BLOCK)
            out = Hits(hits.points[block], hits.faces[block], hits.normals[block])
            self._trace(origins[block], directions[block], out)
        return Hits(
            hits.points.reshape(*shape, 3),
            hits.faces.reshape(shape),
            hits.normals.reshape(*shape, 3),
        )

    def points_on(self, face: IndexArray, u: Array, v: Array) -> Array:
        """Points (N, 3) of faces at barycentric (1 - u - v, u, v), on the patches of a smooth mesh."""
        if self._normals is not None:
            return patch_points(self._patches[face], u, v)[0]
        a, b, c = np.moveaxis(self._corners[face], 1, 0)
        return np.asarray(a + u[:, None] * (b - a) + v[:, None] * (c - a))

    def is_clear(self, start: Array, end: Array) -> BoolArray:
        """Whether nothing lies between points (N, 3) of the mesh and other points (N, 3) of it."""
        line = end - start
        reach = np.linalg.norm(line, axis=1)
        step = SINGLE * self._extent / reach[:, None] * line
        rays = (np.ascontiguousarray(part, np.float32) for part in (start + step, line))
        first = np.asarray(self._scene.run(*rays, query="DISTANCE"))
        return np.asarray(first > 1 - 3 * SINGLE * self._extent / reach)

    def _trace(self, origin: Array, direction: Array, out: Hits) -> None:
        """Write the hits of a block of rays (N, 3)."""
        face = self._faces_met(origin, direction)
        met = face >= 0
        face, origin, direction = face[met], origin[met], direction[met]
        face, point, u, v = self._settle(face, origin, direction)
        normal = self._flat[face]
        if self._normals is not None:
            point, u, v = self._smoothed(face, origin, direction, (point, u, v))
            normal = np.einsum("nk,nki->ni", np.stack([1 - u - v, u, v], 1), self._normals[face])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        out.points[met], out.faces[met], out.normals[met] = point, face, normal

    def _faces_met(self, origin: Array, direction: Array) -> IndexArray:
        """Faces (N,) whose inside the rays meet first; -1 for none."""
        face = self._query(origin, direction)
        back = np.flatnonzero(self._from_behind(face, direction))
        point = self._in_face(face[back], origin[back], direction[back])[0]
        ahead = direction[back] / np.linalg.norm(direction[back], axis=1, keepdims=True)
        near = np.linalg.norm(point - origin[back], axis=1) < BEHIND * self._extent
        again = point + SINGLE * self._extent * ahead
        face[back[~near]] = -1
        face[back[near]] = self._query(again[near], ahead[near])
        face[self._from_behind(face, direction)] = -1
        return face

    def _query(self, origin: Array, direction: Array) -> IndexArray:
        """Embree's first faces (N,); -1 for none."""
        if not len(origin):
            return np.empty(0, np.intp)
        rays = (np.ascontiguousarray(part, np.float32) for part in (origin, direction))
        return np.asarray(self._scene.run(*rays), np.intp)

    def _from_behind(self, face: IndexArray, direction: Array) -> BoolArray:
        """Whether rays (N, 3) meet the outside of faces (N,)."""
        return (face >= 0) & (np.einsum("ni,ni->n", self._flat[face], direction) >= 0)

    def _settle(
        self, face: IndexArray, origin: Array, direction: Array
    ) -> tuple[IndexArray, Array, Array, Array]:
        """Faces, points and barycentric u, v in float64.

        Near an edge Embree may return the neighbour; the ray then meets its plane outside the face.
        """
        point, u, v = self._in_face(face, origin, direction)
        (astray,) = np.nonzero(_inside(u, v) < -CONVERGED)
        if not len(astray):
            return face, point, u, v
        there = face[astray]
        for _ in range(WALK):
            _, s, t = self._in_face(there, origin[astray], direction[astray])
            apart = np.stack([t, 1 - s - t, s], axis=1)  # of the edges 01, 12, 20
            beyond = self._beyond[there, apart.argmin(axis=1)]
            there = np.where((apart.min(axis=1) < -CONVERGED) & (beyond >= 0), beyond, there)
        found, s, t = self._in_face(there, origin[astray], direction[astray])
        better = _inside(s, t) > _inside(u[astray], v[astray])
        astray = astray[better]
        face[astray], point[astray] = there[better], found[better]
        u[astray], v[astray] = s[better], t[better]
        return face, point, u, v

    def _in_face(
        self, face: IndexArray, origin: Array, direction: Array
    ) -> tuple[Array, Array, Array]:
        """Points where rays meet the planes of faces, and their barycentric u, v."""
        a, b, c = np.moveaxis(self._corners[face], 1, 0)
        point = _on_plane(origin, direction, a, self._flat[face])
        return point, *_components(point - a, b - a, c - a)

    def _smoothed(
        self, face: IndexArray, origin: Array, direction: Array, start: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Points and u, v on the smooth patches, by Newton's method from the flat faces.

        A grazing ray that does not meet the patch keeps its point on the flat face.
        """
        point, u, v = start
        coefficients = self._patches[face]
        for _ in range(STEPS):
            near, along_u, along_v = patch_points(coefficients, u, v)
            point = _on_plane(origin, direction, near, np.cross(along_u, along_v))
            du, dv = _components(point - near, along_u, along_v)
            u, v = u + du, v + dv
            settled = np.abs(du) + np.abs(dv) < CONVERGED
            if settled.all():
                break
        return (
            np.where(settled[:, None], point, start[0]),
            np.where(settled, u, start[1]),
            np.where(settled, v, start[2]),
        )


def _inside(u: Array, v: Array) -> Array:
    """Smallest barycentric coordinate; negative outside the face."""
    return np.minimum(np.minimum(u, v), 1 - u - v)


def _on_plane(origin: Array, direction: Array, point: Array, normal: Array) -> Array:
    """Points (N, 3) where rays meet planes."""
    height = np.einsum("ni,ni->n", point - origin, normal)
    slope = np.einsum("ni,ni->n", direction, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(origin + (height / slope)[:, None] * direction)


def _components(vector: Array, along_u: Array, along_v: Array) -> tuple[Array, Array]:
    """u, v of vector = u along_u + v along_v, (N, 3) each, all in one plane."""
    normal = np.cross(along_u, along_v)
    normal /= np.einsum("ni,ni->n", normal, normal)[:, None]
    u = np.einsum("ni,ni->n", np.cross(vector, along_v), normal)
    return u, np.einsum("ni,ni->n", np.cross(along_u, vector), normal)


def _faces_beyond(faces: Faces) -> IndexArray:
    """Neighbours (F, 3) over the edges 01, 12, 20; -1 where there is none."""
    beyond = np.full(3 * len(faces), -1, np.intp)
    one, other = shared_edges(faces).T
    beyond[one], beyond[other] = other // 3, one // 3
    return beyond.reshape(-1, 3)


def _embree_scene(vertices: Array, faces: Faces) -> Any:
    """An Embree scene in robust mode, so that no ray passes between two faces."""
    try:
        from embreex.mesh_construction import TriangleMesh  # noqa: PLC0415
        from embreex.rtcore_scene import EmbreeScene  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            f"mesh screen: tracing rays needs embreex, which is not installed. Run: {EXTRA}"
        ) from error
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))
    return scene


def weights_of_corners(corner: Array, points: Array) -> Array:
    """Weights (N, 3) of corners (N, 3, 3) at points (N, 3), as projected on their planes."""
    a, b, c = np.moveaxis(corner, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.einsum("ni,ni->n", normal, normal)[:, None]
    v = np.einsum("ni,ni->n", np.cross(points - a, c - a), normal)
    w = np.einsum("ni,ni->n", np.cross(b - a, points - a), normal)
    return np.stack([1 - v - w, v, w], axis=1)
