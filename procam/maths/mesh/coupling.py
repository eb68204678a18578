"""Irradiance of a mesh screen's faces per flux of projector pixels (van Baar et al. 2011, s. 3)."""

import numpy as np
from scipy.sparse import csr_array

from procam.arrays import Array
from procam.maths.geometry.lenses import Lens, unproject
from procam.maths.geometry.pose import Pose
from procam.maths.mesh.facets import Faces, face_areas
from procam.maths.mesh.raycast import MeshTracer


def projector_coupling(
    vertices: Array, faces: Faces, projector: tuple[Lens, Pose, tuple[int, int]], samples: int = 4
) -> csr_array:
    """Irradiance of faces per flux of pixels, (F, H W) [1/m^2]: E = coupling @ flux.

    Parameters
    ----------
    vertices : (V, 3) [m]. faces : (F, 3), counter-clockwise seen from inside.
    projector : its lens, `projector_from_mesh` and size (width, height) [px].
    samples : rays along each edge of a pixel; faces much smaller than a pixel need more.

    Notes
    -----
    Flux is uniform over a pixel's area on the panel; rays that miss the screen light nothing. Total
    light is `add_mesh_interreflection` of albedo times E. The transpose is the derivative of a
    weighted sum over faces by the flux of each pixel.

    Raises
    ------
    ProcamError
        If embreex is not installed.
    """
    lens, pose, (width, height) = projector
    tracer, back = MeshTracer(vertices, faces), pose.inverse()
    fine = (np.arange(samples) + 0.5) / samples - 0.5
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    index, face = [], []
    for down in fine:
        for across in fine:
            rays = back.rotate(unproject(pixels + np.array([across, down]), lens))
            met = tracer.first_hits(back.translation, rays).faces
            index.append(np.flatnonzero(met >= 0))
            face.append(met[met >= 0])
    rows, columns = np.concatenate(face), np.concatenate(index)
    share = 1 / samples**2 / face_areas(vertices, faces)[rows]
    return csr_array((share, (rows, columns)), shape=(len(faces), width * height))
