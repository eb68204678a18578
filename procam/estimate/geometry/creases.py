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
JUMP_PX = 10.0  # and a jump, whose fit is of no use
JUMP = 4.0  # of the steps on either side: a step from wall to wall
STEPS = 8  # from the centre of a patch to a corner of what is around it
CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
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
    added[_has_jump(shape, projector, some)] = JUMP_PX
    return replace(some, sigma_px=np.hypot(some.sigma_px, added))


def _has_jump(shape: MeshShape, projector: ProjectorModel, some: Observations) -> BoolArray:
    """Whether light around patches (N,) falls on two walls, one before the other.

    From the centre to the corners of what is around, points on walls that meet are as far from each other as
    on either side of the edge.
    """
    found = np.zeros(len(some.projector_px), bool)
    for corner in CORNERS:
        ways = np.linspace(0, 1, STEPS + 1)[:, None, None] * REACH * some.patch_px * corner
        points = np.stack([_met(shape, projector, some.projector_px + way)[0] for way in ways])
        step = np.linalg.norm(np.diff(points, axis=0), axis=-1)
        found |= (step[1:-1] > JUMP * np.maximum(step[:-2], step[2:])).any(axis=0)
    return found


def _is_clear(shape: MeshShape, projector: ProjectorModel, some: Observations) -> BoolArray:
    """Whether patches (N,) are on one surface, by points and normals at their centres and corners."""
    middle, normal = _met(shape, projector, some.projector_px)
    clear = np.ones(len(middle), bool)
    for corner in CORNERS:
        at = some.projector_px + REACH * some.patch_px * corner
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
