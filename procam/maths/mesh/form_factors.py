"""Form factors between the faces of a mesh (docs/theory/interreflection.md (I2)).

F_ij is the share of the diffuse light that leaves face i and arrives at face j. All pairs are kept, which is
for meshes of some thousand faces; `compressed` is for larger ones, and is tested against this.
"""

import numpy as np

from procam.arrays import Array, Array32
from procam.maths.mesh.exchange import Exchange
from procam.maths.mesh.facets import Faces

BLOCK = 256  # rows at a time


def form_factors(vertices: Array, faces: Faces) -> Array32:
    """Form factors (N, N) between the faces (N, 3) of a mesh, counter-clockwise seen from inside.

    F_ij >= 0 and area_i F_ij = area_j F_ji. Rows of a closed mesh sum to 1 as far as the quadrature allows,
    1e-3 for a box; they are not scaled.

    Raises
    ------
    InputError
        If the mesh is not convex and embreex is not installed.
    """
    found, every = Exchange(vertices, faces), np.arange(len(faces))
    rows = [every[at : at + BLOCK, None] for at in range(0, len(faces), BLOCK)]
    exchange = np.concatenate([found.between(some, every) for some in rows])
    exchange /= found.area[:, None].astype(np.float32)
    return exchange
