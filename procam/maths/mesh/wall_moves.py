"""Parts of a mesh that are not where its drawing has them: offsets and turns of walls.

A part moves by seven numbers: an offset outwards [m], a translation [m] and a rotation [rad] about the
origin. Only what they do along its normals counts: of a flat wall three are independent, its offset and two
tilts; of a cylinder five. Where parts meet, their edge moves so that it stays on both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, IndexArray
from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.facets import Faces, corner_normals, places

NUMBERS = 7
INDEPENDENT = 1e-2  # of the largest singular value, from which a way to move counts
PARALLEL = 0.05  # of normals at an edge: parts that continue each other

Normals = dict[int, tuple[IndexArray, Array]]  # vertices of parts, and normals there


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
        normals = _outward_normals(vertices, faces, part)
        found = [(p, row) for p in free for row in _independent(vertices, *normals[p])]
        numbers = np.array([row for _, row in found])
        fields = [_moved(vertices, normals, {p: row}) for p, row in found]
        return cls(np.array([p for p, _ in found]), numbers, np.array(fields))


def outwards(vertices: Array, faces: Faces, numbers: Array) -> Array:
    """Displacements (N,) of a part's vertices away from the room, by seven numbers (7,) or (K, 7) of it."""
    own, normal = _outward_normals(vertices, faces, np.zeros(len(faces), np.intp))[0]
    return np.asarray(numbers @ _rows(vertices[own], normal).T)


def moved_by(vertices: Array, faces: Faces, part: IndexArray, moves: Mapping[int, Array]) -> Array:
    """Displacements (V, 3) of a mesh's vertices by seven numbers of some of its parts."""
    if not moves:
        return np.zeros_like(vertices)
    return _moved(vertices, _outward_normals(vertices, faces, part), moves)


def _moved(vertices: Array, normals: Normals, moves: Mapping[int, Array]) -> Array:
    """See `moved_by`. A place is moved by the least that satisfies all parts that meet there."""
    place = places(vertices)
    rows: list[list[Array]] = [[] for _ in range(place.max() + 1)]
    by: list[list[float]] = [[] for _ in rows]
    for number, (own, normal) in normals.items():
        along = _rows(vertices[own], normal) @ moves.get(number, np.zeros(NUMBERS))
        for vertex, n, outwards in zip(own, normal, along, strict=True):
            rows[place[vertex]].append(n)
            by[place[vertex]].append(outwards)
    moved = np.zeros((len(rows), 3))
    for number, (own_normals, amounts) in enumerate(zip(rows, by, strict=True)):
        if np.any(amounts):
            moved[number] = np.linalg.pinv(np.array(own_normals), rcond=PARALLEL) @ amounts
    return moved[place]


def _independent(vertices: Array, own: IndexArray, normal: Array) -> Array:
    """Independent moves (K, 7) of a part, each with a root mean square displacement of 1."""
    _, size, way = np.linalg.svd(_rows(vertices[own], normal), full_matrices=False)
    kept = size > INDEPENDENT * size[0]
    return np.asarray(way[kept] / size[kept, None] * np.sqrt(len(own)))


def _rows(points: Array, normal: Array) -> Array:
    """Displacements (N, 7) along outward normals (N, 3) at points (N, 3), per unit of the seven numbers."""
    return np.c_[np.ones(len(points)), normal, np.cross(points, normal)]


def _outward_normals(vertices: Array, faces: Faces, part: IndexArray) -> Normals:
    """Vertices (N,) of each part, and the unit normals (N, 3) of its surface there, away from the room."""
    found = {}
    for number in np.unique(part):
        own = faces[part == number]
        inwards = np.zeros_like(vertices)
        np.add.at(inwards, own.ravel(), corner_normals(vertices, own).reshape(-1, 3))
        used = np.unique(own)
        found[int(number)] = used, -normalise(inwards[used])
    return found
