"""Triangles cut until their edges are short enough."""

import numpy as np

from procam.arrays import Array, IndexArray

# corners and middles of edges (3 + k: of the edge that leaves corner k) of the parts of a triangle, by which
# of its edges are cut, turned so that an edge that is cut comes first, and one that is not comes last
PARTS = {
    0: ((0, 1, 2),),
    1: ((0, 3, 2), (3, 1, 2)),
    2: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}


def subdivided(
    vertices: Array, faces: IndexArray, edge_m: float, most: int
) -> tuple[Array, IndexArray, IndexArray]:
    """A mesh without edges that are longer than `edge_m`, as far as `most` faces allow.

    An edge is halved or left on all its faces alike, so that no crack opens.

    Parameters
    ----------
    vertices : (V, 3 + N) [m], with N numbers more that are linear along edges. faces : (F, 3).

    Returns
    -------
    vertices (W, 3 + N), faces (G, 3), and the face (G,) that each was a part of.
    """
    origin = np.arange(len(faces))
    while True:
        ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
        length = np.linalg.norm(np.diff(vertices[ends][..., :3], axis=2)[:, :, 0], axis=-1)
        cut = length > edge_m
        if not cut.any() or len(faces) + cut.sum() > most:
            return vertices, faces, origin
        middles, number = np.unique(np.sort(ends[cut], axis=1), axis=0, return_inverse=True)
        middle = np.full(faces.shape, -1)
        middle[cut] = len(vertices) + number.ravel()
        vertices = np.concatenate([vertices, vertices[middles].mean(axis=1)])
        faces, part = _cut(np.concatenate([faces, middle], axis=1), cut)
        origin = origin[part]


def _cut(corners: IndexArray, cut: Array) -> tuple[IndexArray, IndexArray]:
    """Parts (G, 3) of faces whose corners and middles (F, 6) are given, and the face (G,) of each."""
    count = cut.sum(axis=1)
    first = np.where(count == 1, cut.argmax(axis=1), (np.argmin(cut, axis=1) + 1) % 3)
    turn = (first[:, None] + np.arange(3)) % 3
    turned = np.take_along_axis(corners, np.concatenate([turn, turn + 3], axis=1), axis=1)
    found = [(turned[count == n][:, list(p)], n) for n, parts in PARTS.items() for p in parts]
    faces = np.concatenate([part for part, _ in found])
    return faces, np.concatenate([np.flatnonzero(count == n) for _, n in found])
