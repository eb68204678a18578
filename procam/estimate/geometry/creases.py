"""Widens standard errors of what was seen across creases of a mesh: edges of walls, where a map has kinks.

The pixel that sees a patch's centre comes from a smooth fit to the patch, which is wrong across a kink. Such
patches are not left out: where a projector lights little beside one wall, they are what ties its lens.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from procam.arrays import Array, BoolArray
from procam.estimate.geometry.model import Observations, Pair, RigGeometry
from procam.maths.geometry.lenses import unproject
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import ProjectorModel

REACH = 4.0  # of a patch, from its centre: those of a block have one curvature
CREASE_PX = 0.5  # error that a kink makes of a patch's place
SAME_PLANE = np.cos(np.radians(20))  # of normals, on a smooth surface


def widened_at_creases(
    rig: RigGeometry, seen: Mapping[Pair, Observations]
) -> dict[Pair, Observations]:
    """Observations, with `CREASE_PX` more in the errors of patches across edges of the rig's mesh."""
    shape = rig.shape
    if not isinstance(shape, MeshShape):
        return dict(seen)
    return {pair: _widened(shape, rig.projectors[pair[1]], some) for pair, some in seen.items()}


def _widened(shape: MeshShape, projector: ProjectorModel, some: Observations) -> Observations:
    added = np.where(_is_clear(shape, projector, some), 0.0, CREASE_PX)
    return replace(some, sigma_px=np.hypot(some.sigma_px, added))


def _is_clear(shape: MeshShape, projector: ProjectorModel, some: Observations) -> BoolArray:
    """Whether patches (N,) have one normal, at their centres and corners."""
    centre = _normals(shape, projector, some.projector_px)
    clear = np.ones(len(centre), bool)
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        at = some.projector_px + REACH * some.patch_px * np.array(corner)
        alike = np.einsum("ni,ni->n", centre, _normals(shape, projector, at))
        clear &= np.nan_to_num(alike) > SAME_PLANE
    return clear


def _normals(shape: MeshShape, projector: ProjectorModel, pixels: Array) -> Array:
    """Normals (N, 3) where pixels (N, 2) of a panel land; NaN where they miss."""
    pose = projector.projector_from_dome
    rays = pose.inverse().rotate(unproject(pixels, projector.lens))
    return shape.tracer.first_hits(pose.origin / shape.radius_m, rays).normals
