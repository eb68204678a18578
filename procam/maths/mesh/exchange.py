"""Exchange areas of pairs of faces: area times form factor (docs/theory/interreflection.md (I2)).

Pairs that touch or nearly do are integrated exactly round their contours, others by the kernel between a few
points of each face: the fewer, the farther they are apart. A ray between the centroids decides visibility;
a convex room needs none.
"""

import numpy as np

from procam.arrays import Array, Array32, BoolArray, IndexArray
from procam.maths.mesh.contours import exchange_areas
from procam.maths.mesh.facets import Faces, face_areas, face_normals
from procam.maths.mesh.raycast import MeshTracer

# distance of centroids [diameters of the larger face] from which each rule is right to 1e-3 of a pair
# (rms over the walls of a cube; of the nearest 6e-4), and its points (P, 3) in barycentric coordinates with
# weights (P,): Gauss rules of degree 4, 2 and 1 (Dunavant 1985, doi:10.1002/nme.1620210612)
CONTOUR_REACH = 1.0
A, B = 0.445948490915965, 0.091576213509771
SIX = [[1 - 2 * t if i == k else t for i in range(3)] for t in (A, B) for k in range(3)]
THREE = [[2 / 3 if i == k else 1 / 6 for i in range(3)] for k in range(3)]
RULES = (
    (CONTOUR_REACH, np.array(SIX), np.repeat([0.223381589678011, 0.109951743655322], 3)),
    (2.5, np.array(THREE), np.full(3, 1 / 3)),
    (12.0, np.full((1, 3), 1 / 3), np.ones(1)),
)
FACING = 1e-5  # sine of the angle above a face's plane: rounding of float32, with a margin
CONVEX = 1e-6  # of the extent: how far a corner may lie behind a face of a convex room
BLOCK = 256  # faces at a time
RAYS = 1 << 20  # at a time


class Exchange:
    """Exchange areas between the faces (N, 3) of a mesh, counter-clockwise seen from inside.

    Attributes
    ----------
    corners : (N, 3, 3) [m]. normal : (N, 3). area : (N,) [m^2]. convex : all faces see each other.

    Raises
    ------
    InputError
        If the mesh is not convex and embreex is not installed.
    """

    def __init__(self, vertices: Array, faces: Faces) -> None:
        self.corners, self.area = vertices[faces], face_areas(vertices, faces)
        self.middle = self.corners.mean(axis=1)
        to_corners = np.linalg.norm(self.corners - self.middle[:, None], axis=2)
        self._diameter = (2 * to_corners.max(axis=1)).astype(np.float32)
        self.normal = face_normals(vertices, faces).astype(np.float32)
        self._points = [
            np.einsum("pk,nki->npi", points, self.corners).astype(np.float32)
            for _, points, _ in RULES
        ]
        self.convex = is_convex(vertices, faces)
        self._tracer = None if self.convex else MeshTracer(vertices, faces)

    def __len__(self) -> int:
        return len(self.area)

    def between(self, first: IndexArray, second: IndexArray, *, trace: bool = True) -> Array32:
        """Exchange areas [m^2] of faces (...) and (...), broadcast; 0 where an index is -1.

        A pair has the same in either order, to the last bit. Without `trace` every pair that faces each other
        counts as visible.
        """
        first, second = np.minimum(first, second), np.maximum(first, second)
        value = np.zeros(first.shape, np.float32)
        real = first >= 0
        value[real] = self._of_pairs(first[real], second[real])
        if trace and self._tracer is not None:
            seen = value > 0
            value[seen] *= self.is_clear(first[seen], second[seen])
        return value

    def _of_pairs(self, first: IndexArray, second: IndexArray) -> Array32:
        """Exchange areas of pairs (P,) that nothing stands between."""
        line = self._points[-1][second, 0] - self._points[-1][first, 0]
        apart = np.sqrt(np.einsum("ni,ni->n", line, line))
        apart /= np.maximum(self._diameter[first], self._diameter[second])
        rule = np.searchsorted([reach for reach, *_ in RULES], apart, side="right") - 1
        value = np.empty(len(first), np.float32)
        value[rule < 0] = self._by_contours(first[rule < 0], second[rule < 0])
        for number in range(len(RULES)):
            use = np.flatnonzero(rule == number)
            value[use] = self._by_points(number, first[use], second[use])
        return value

    def _by_contours(self, first: IndexArray, second: IndexArray) -> Array32:
        """Exact exchange areas of pairs, 0 where one does not lie in front of the other."""
        line = self._points[-1][second, 0] - self._points[-1][first, 0]
        least = FACING * np.linalg.norm(line, axis=1)
        facing = np.einsum("ni,ni->n", line, self.normal[first]) > least
        facing &= np.einsum("ni,ni->n", line, self.normal[second]) < -least
        value = np.zeros(len(first), np.float32)
        value[facing] = exchange_areas(self.corners[first[facing]], self.corners[second[facing]])
        return value

    def _by_points(self, rule: int, first: IndexArray, second: IndexArray) -> Array32:
        """Exchange areas of pairs by the kernel between points of their faces."""
        points, weight = self._points[rule], RULES[rule][2].astype(np.float32)
        n, m = self.normal[first], self.normal[second]
        total = np.zeros(len(first), np.float32)
        for p, here in enumerate(weight):
            for q, there in enumerate(weight):
                line = points[second, q] - points[first, p]
                sent = np.einsum("ni,ni->n", line, n)
                met = np.einsum("ni,ni->n", line, m)
                apart2 = np.einsum("ni,ni->n", line, line)
                total += here * there * np.maximum(sent, 0) * np.maximum(-met, 0) / apart2**2
        return total * (self.area[first] * self.area[second] / np.pi).astype(np.float32)

    def is_clear(self, first: IndexArray, second: IndexArray) -> BoolArray:
        """Whether faces (P,) and (P,) see each other's centroid, if they face each other."""
        clear = np.ones(len(first), bool)
        if self._tracer is None:
            return clear
        for at in range(0, len(first), RAYS):
            some = slice(at, at + RAYS)
            clear[some] = self._tracer.is_clear(self.middle[first[some]], self.middle[second[some]])
        return clear


def is_convex(vertices: Array, faces: Faces) -> bool:
    """Whether no corner of the mesh lies behind a face, so that all faces see each other."""
    inward = face_normals(vertices, faces)
    depth = np.einsum("fi,fi->f", inward, vertices[faces[:, 0]])
    extent = float(np.ptp(vertices, axis=0).max())
    return all(
        (vertices @ inward[at : at + BLOCK].T - depth[at : at + BLOCK]).min() > -CONVEX * extent
        for at in range(0, len(faces), BLOCK)
    )
