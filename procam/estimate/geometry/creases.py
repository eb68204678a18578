"""Widens standard errors of what was seen across edges of a mesh's walls, where a map has kinks or jumps.

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
BEND = np.radians(20)  # between normals of a smooth surface, whose chords lean by half of it


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
    """Whether patches (N,) are on one surface, by points and normals at their centres and corners."""
    middle, normal = _met(shape, projector, some.projector_px)
    clear = np.ones(len(middle), bool)
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        at = some.projector_px + REACH * some.patch_px * np.array(corner)
        point, there = _met(shape, projector, at)
        chord = point - middle
        alike = np.einsum("ni,ni->n", normal, there)
        out = np.abs(np.einsum("ni,ni->n", normal, chord))
        clear &= alike > np.cos(BEND)  # NaN where a ray misses is not clear
        clear &= out <= np.sin(BEND / 2) * np.linalg.norm(chord, axis=1)
    return clear


def _met(shape: MeshShape, projector: ProjectorModel, pixels: Array) -> tuple[Array, Array]:
    """Points and normals (N, 3) where pixels (N, 2) of a panel land; NaN where they miss."""
    pose = projector.projector_from_dome
    rays = pose.inverse().rotate(unproject(pixels, projector.lens))
    hits = shape.tracer.first_hits(pose.origin / shape.radius_m, rays)
    return hits.points, hits.normals
