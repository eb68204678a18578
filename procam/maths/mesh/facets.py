"""Triangle meshes: shared edges, normals, and the smooth surface that a mesh samples.

A half-edge is an edge of one face: number 3 f + k runs from corner k of face f to the next corner.
Faces are counter-clockwise seen from the side that their normals point to.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from procam.arrays import Array, BoolArray, IndexArray
from procam.maths.geometry.sphere import normalise

Faces = NDArray[np.integer]
CREASE = np.radians(30.0)  # between faces of a smooth surface; a sharper edge is a crease
SWEEPS = 60  # each at least halves the error
TOGETHER = 1e-6  # of the extent: distance of vertices that are at one place


def shared_edges(faces: Faces) -> IndexArray:
    """Pairs (P, 2) of half-edges that coincide, for edges with exactly two faces."""
    edges = np.sort(half_edges(faces), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    lonely = same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False)
    return np.stack([order[:-1][lonely], order[1:][lonely]], axis=1)


def half_edges(faces: Faces) -> Faces:
    """Start and end vertices (3 F, 2) of all half-edges."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def places(vertices: Array) -> IndexArray:
    """The first vertex (V,) at the place of each (V, 3): meshes are split where parts and islands meet."""
    grid = np.round(vertices / (TOGETHER * float(np.ptp(vertices, axis=0).max())))
    _, first, place = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[place.ravel()])


def following(half_edge: IndexArray) -> IndexArray:
    """The next half-edges of the same faces."""
    return half_edge + np.where(half_edge % 3 == 2, -2, 1)


def face_normals(vertices: Array, faces: Faces) -> Array:
    """Unit normals (F, 3)."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return normalise(np.cross(b - a, c - a))


def face_areas(vertices: Array, faces: Faces) -> Array:
    """Areas (F,) of the faces."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def corner_normals(vertices: Array, faces: Faces) -> Array:
    """Unit normals (F, 3, 3) of the smooth surface at each corner of each face.

    Faces that meet at less than CREASE share normals. The weights of Max 1999,
    doi:10.1080/10867651.1999.10487501, are exact on a sphere at corners that faces surround. At
    rims and creases, where faces are missing, `_fitted_to_edges` corrects the normals.
    """
    pairs = _smooth_pairs(vertices, faces)
    fans = _fans(pairs, 3 * len(faces))
    ahead = (vertices[np.roll(faces, -1, axis=1)] - vertices[faces]).reshape(-1, 3)
    behind = (vertices[np.roll(faces, 1, axis=1)] - vertices[faces]).reshape(-1, 3)
    weights = np.sum(ahead**2, axis=1) * np.sum(behind**2, axis=1)
    normals = normalise(_sums(np.cross(ahead, behind) / weights[:, None], fans))
    alone = np.ones((len(faces), 3), bool)
    alone.reshape(-1)[pairs] = False
    beside = (alone | np.roll(alone, 1, axis=1)).reshape(
        -1
    )  # corners at an end of an edge without a neighbour
    rim = np.bincount(fans, beside) > 0
    ends = fans, fans[following(np.arange(3 * len(faces)))]
    return _fitted_to_edges(normals, rim, ends, normalise(ahead))[fans].reshape(-1, 3, 3)


def _fitted_to_edges(
    normals: Array, rim: BoolArray, ends: tuple[IndexArray, IndexArray], edge: Array
) -> Array:
    """Normals (K, 3), those at the `rim` rotated until (n_i + n_j).e_ij = 0 for every edge.

    That holds on spheres and cylinders, and to the third order of the edge length on other surfaces.
    `ends` are the indices of the normals at both ends of unit edges (E, 3).
    """
    used = rim[ends[0]] | rim[ends[1]]
    one, other, edge = ends[0][used], ends[1][used], edge[used]
    both = np.concatenate([one, other])
    count = np.bincount(both, minlength=len(normals))
    for _ in range(SWEEPS):
        lean = np.einsum("ei,ei->e", normals[one] + normals[other], edge)
        steps = _sums(np.tile(lean[:, None] * edge, (2, 1)), both, len(normals))
        normals = normalise(normals - np.where(rim, 1 / np.maximum(count, 1), 0)[:, None] * steps)
    return normals


def patches(vertices: Array, faces: Faces, normals: Array) -> Array:
    """Coefficients (F, 6, 3) [m] of smooth patches through the corners: see `patch_points`.

    Phong tessellation (Boubekeur & Alexa 2008, doi:10.1145/1409060.1409094) with weight 1/2:
    S = sum of b_i p_i + b_0 b_1 c_01 + b_1 b_2 c_12 + b_2 b_0 c_20 in barycentric coordinates
    (b_0, b_1, b_2). Its error on a quadric is of third order in the edge length. `normals`
    (F, 3, 3) are those at the corners.
    """
    corners = vertices[faces]
    edge = np.roll(corners, -1, axis=1) - corners
    there = np.roll(normals, -1, axis=1)
    rise = np.sum(edge * normals, axis=-1, keepdims=True)
    fall = np.sum(edge * there, axis=-1, keepdims=True)
    c, d, e = np.moveaxis((fall * there - rise * normals) / 2, 1, 0)
    along_u, along_v = edge[:, 0] + c, e - edge[:, 2]
    return np.stack([corners[:, 0], along_u, along_v, c, e, d - c - e], axis=1)


def patch_points(coefficients: Array, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Points (N, 3) of patches at barycentric (1 - u - v, u, v), and derivatives by u and v.

    S = p + u a + v b - u^2 c - v^2 e + u v g with the coefficients (N, 6, 3) p, a, b, c, e, g.
    """
    u, v = u[:, None], v[:, None]
    p, a, b, c, e, g = np.moveaxis(coefficients, 1, 0)
    uc, ve = u * c, v * e
    half = a - uc + v * g
    return p + u * half + v * (b - ve), half - uc, b - 2 * ve + u * g


def _smooth_pairs(vertices: Array, faces: Faces) -> IndexArray:
    """Shared edges that are not creases."""
    pairs = shared_edges(faces)
    first, second = np.moveaxis(face_normals(vertices, faces)[pairs // 3], 1, 0)
    return pairs[np.sum(first * second, axis=1) > np.cos(CREASE)]


def _fans(pairs: IndexArray, count: int) -> IndexArray:
    """Index of each corner's fan: the corners at one vertex that smooth edges connect."""
    one, other = pairs.T
    start = np.concatenate([one, following(one)])
    end = np.concatenate([following(other), other])
    graph = coo_array((np.ones(len(start), bool), (start, end)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def _sums(vectors: Array, group: IndexArray, count: int = 0) -> Array:
    """Sums (K, 3) of the vectors of each group; K is at least `count`."""
    return np.stack([np.bincount(group, v, minlength=count) for v in vectors.T], axis=1)
