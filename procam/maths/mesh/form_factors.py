"""Form factors between the faces of a mesh (docs/theory/interreflection.md (I2)).

F_ij is the share of the diffuse light that leaves face i and arrives at face j. Distant pairs use
the kernel between their centroids, near ones the exact contour integral. Rays between the centroids
decide visibility; a convex room needs none. Reciprocity is exact, and the rows of a closed room are
scaled to sum to 1.
"""

import numpy as np

from procam.arrays import Array, Array32, BoolArray
from procam.maths.mesh.contours import exchange_areas
from procam.maths.mesh.exchange import is_convex
from procam.maths.mesh.facets import Faces, face_areas, face_normals, shared_edges
from procam.maths.mesh.raycast import MeshTracer

NEAR = 3.0  # diameters between centroids, below which the kernel between them is off by a percent
BLOCK = 256  # rows at a time
RAYS = 1 << 20  # at a time
CLOSED = 1e-6  # relative error of a row's sum in a closed room
BALANCES = 100


def form_factors(vertices: Array, faces: Faces) -> Array32:
    """Form factors (N, N) between the faces (N, 3) of a mesh, counter-clockwise seen from inside.

    F_ij >= 0 and area_i F_ij = area_j F_ji; rows of a closed mesh sum to 1. Between the walls of a
    cube with 1,700 faces the error is 1e-3; it is proportional to the faces' area.

    Raises
    ------
    InputError
        If the mesh is not convex and embreex is not installed.
    """
    middle, normal = vertices[faces].mean(axis=1), face_normals(vertices, faces)
    area, convex = face_areas(vertices, faces), is_convex(vertices, faces)
    size = np.linalg.norm(vertices[faces] - middle[:, None], axis=2).max(axis=1)
    exchange = np.empty((len(faces), len(faces)), np.float32)
    tracer = None if convex else MeshTracer(vertices, faces)
    for at in range(0, len(faces), BLOCK):
        rows = slice(at, at + BLOCK)
        block, near = _centroid_kernel(middle, normal, area, size, rows)
        i, j = np.nonzero(near)
        corners = vertices[faces]
        block[i, j] = exchange_areas(corners[at + i], corners[at + j])
        if tracer is not None:
            _remove_occluded(block, tracer, middle, at)
        square = block[:, : len(block)]
        square[:] = np.triu(square) + np.triu(square, 1).T
        exchange[rows, at:] = block
        exchange[at:, rows] = block.T
    if _is_closed(faces):
        exchange = _balanced(exchange, area)
    exchange /= area[:, None].astype(np.float32)
    return exchange


def _centroid_kernel(
    middle: Array, normal: Array, area: Array, size: Array, rows: slice
) -> tuple[Array32, BoolArray]:
    """Area times form factor (R, N - first) [m^2] of a block of rows with the faces from it on.

    By the kernel between their centroids; also the pairs that are too near for it.
    """
    here, there = slice(rows.start, min(rows.stop, len(area))), slice(rows.start, None)
    a, b = (middle[s].astype(np.float32) for s in (here, there))
    n, m = (normal[s].astype(np.float32) for s in (here, there))
    apart2 = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1) - 2 * (a @ b.T)
    sent = n @ b.T - np.sum(n * a, axis=1)[:, None]
    met = a @ m.T - np.sum(m * b, axis=1)
    facing = (sent > 0) & (met > 0)
    reach = (NEAR * 2 * np.maximum(size[here, None], size[there])).astype(np.float32)
    near = facing & (apart2 < reach * reach)
    weight = np.outer(area[here], area[there] / np.pi).astype(np.float32)
    kernel = sent * met * weight / np.maximum(apart2 * apart2, np.float32(1e-30))
    kernel[~facing] = 0
    return kernel, near


def _remove_occluded(block: Array32, tracer: MeshTracer, middle: Array, first: int) -> None:
    """Set pairs that do not see each other to 0."""
    i, j = np.nonzero(block)
    for at in range(0, len(i), RAYS):
        here, there = i[at : at + RAYS], j[at : at + RAYS]
        clear = tracer.is_clear(middle[first + here], middle[first + there])
        block[here[~clear], there[~clear]] = 0


def _is_closed(faces: Faces) -> bool:
    return 2 * len(shared_edges(faces)) == 3 * len(faces)


def _balanced(exchange: Array32, area: Array) -> Array32:
    """Rows that sum to the areas: each pair scaled by a factor of both faces."""
    scale = np.ones(len(area))
    for _ in range(BALANCES):
        sums = scale * (exchange @ scale.astype(np.float32)).astype(float)
        sums = np.where(sums > 0, sums, area)  # a face that coincides with another sees nothing
        if np.abs(sums / area - 1).max() < CLOSED:
            break
        scale *= np.sqrt(area / sums)
    exchange *= scale.astype(np.float32)
    exchange *= scale.astype(np.float32)[:, None]
    return exchange
