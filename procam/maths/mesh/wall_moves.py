"""Parts of a mesh that are not where its drawing has them: offsets and turns of walls.

A part moves by seven numbers: an offset outwards [m], a translation [m] and a rotation [rad] about the
origin. Only what they do along its normals counts: of a flat wall three are independent, its offset and two
tilts; of a cylinder six. Where parts meet, their edge moves so that it stays on both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, IndexArray
from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.facets import Faces

NUMBERS = 7
INDEPENDENT = 1e-3  # of the largest singular value, from which a way to move counts
PARALLEL = 1e-3  # of normals at an edge: parts that continue each other
TOGETHER = 1e-6  # of the extent: distance of vertices that are one


@dataclass(frozen=True, eq=False)
class WallMoves:
    """Independent ways in which parts of a mesh move.

    Attributes
    ----------
    part : (K,) number of the part that each moves. numbers : (K, 7) of that part, in the mesh's unit, per
        unit of root mean square displacement of its vertices. fields : (K, V, 3) displacements of vertices.
    """

    part: IndexArray
    numbers: Array
    fields: Array

    @classmethod
    def of(
        cls, vertices: Array, faces: Faces, part: IndexArray, free: Sequence[int]
    ) -> "WallMoves":
        """Those of the `free` parts of a mesh (V, 3), (F, 3), (F,)."""
        found = [(p, row) for p in free for row in _independent(vertices, faces[part == p])]
        numbers = np.array([row for _, row in found])
        fields = [moved_by(vertices, faces, part, {p: row}) for p, row in found]
        return cls(np.array([p for p, _ in found]), numbers, np.array(fields))


def outwards(vertices: Array, faces: Faces, numbers: Array) -> Array:
    """Displacements (N,) of a part's vertices away from the room, by seven numbers (7,) or (K, 7) of it."""
    own, normal = _outward_normals(vertices, faces)
    return np.asarray(numbers @ _rows(vertices[own], normal).T)


def moved_by(vertices: Array, faces: Faces, part: IndexArray, moves: Mapping[int, Array]) -> Array:
    """Displacements (V, 3) of a mesh's vertices by seven numbers of some of its parts."""
    at, normal, outwards = _along_normals(vertices, faces, part, moves)
    extent = float(np.ptp(vertices, axis=0).max())
    _, place = np.unique(np.round(vertices / (TOGETHER * extent)), axis=0, return_inverse=True)
    place = place.ravel()
    rows: list[list[int]] = [[] for _ in range(place.max() + 1)]
    for row, vertex in enumerate(at):
        rows[place[vertex]].append(row)
    moved = np.zeros((len(rows), 3))
    for number, own in enumerate(rows):
        if np.any(outwards[own]):
            moved[number] = np.linalg.pinv(normal[own], rcond=PARALLEL) @ outwards[own]
    return moved[place]


def _along_normals(
    vertices: Array, faces: Faces, part: IndexArray, moves: Mapping[int, Array]
) -> tuple[IndexArray, Array, Array]:
    """Vertex (N,), outward unit normal (N, 3) and displacement along it (N,), of each part of each vertex."""
    at, normals, outwards = [], [], []
    for number in np.unique(part):
        own, normal = _outward_normals(vertices, faces[part == number])
        at.append(own)
        normals.append(normal)
        outwards.append(_rows(vertices[own], normal) @ moves.get(int(number), np.zeros(NUMBERS)))
    return np.concatenate(at), np.concatenate(normals), np.concatenate(outwards)


def _independent(vertices: Array, faces: Faces) -> Array:
    """Independent moves (K, 7) of a part, each with a root mean square displacement of 1."""
    own, normal = _outward_normals(vertices, faces)
    _, size, way = np.linalg.svd(_rows(vertices[own], normal), full_matrices=False)
    kept = size > INDEPENDENT * size[0]
    return np.asarray(way[kept] / size[kept, None] * np.sqrt(len(own)))


def _rows(points: Array, normal: Array) -> Array:
    """Displacements (N, 7) along outward normals (N, 3) at points (N, 3), per unit of the seven numbers."""
    return np.c_[np.ones(len(points)), normal, np.cross(points, normal)]


def _outward_normals(vertices: Array, faces: Faces) -> tuple[Faces, Array]:
    """Vertices (N,) of some faces, and the unit normals (N, 3) there, away from the room."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inwards = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(inwards, faces[:, corner], np.cross(b - a, c - a))
    own = np.unique(faces)
    return own, -normalise(inwards[own])
