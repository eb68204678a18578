"""Form factors between the faces of a mesh (docs/theory/interreflection.md (I2)).

F_ij is the share of the diffuse light that leaves face i and arrives at face j. All pairs are kept, which is
for meshes of some thousand faces; rows of a closed room are scaled to sum to 1.
"""

import numpy as np

from procam.arrays import Array, Array32
from procam.maths.mesh.exchange import Exchange
from procam.maths.mesh.facets import Faces, shared_edges

BLOCK = 256  # rows at a time
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
    found, every = Exchange(vertices, faces), np.arange(len(faces))
    rows = [every[at : at + BLOCK, None] for at in range(0, len(faces), BLOCK)]
    exchange = np.concatenate([found.between(some, every) for some in rows])
    if _is_closed(faces):
        exchange = _balanced(exchange, found.area)
    exchange /= found.area[:, None].astype(np.float32)
    return exchange


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
