"""What was seen across an edge of walls has larger standard errors."""

import mesh_shapes
import numpy as np
from domes import SimulatedDome

from procam.estimate.geometry.creases import CREASE_PX, JUMP_PX, REACH, widened_at_creases
from procam.estimate.geometry.model import Observations, RigGeometry
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import ProjectorModel

SIZE, FOCAL = (640, 400), 400.0
PATCH_PX = 8.0
AHEAD = Pose(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))


def _rig(shape: MeshShape) -> RigGeometry:
    """One projector in the origin, which looks along x, its panel's rows to the right."""
    centre = (np.array(SIZE) - 1) / 2
    lens = Lens("brown", np.full(2, FOCAL), centre, np.zeros(5))
    return RigGeometry(shape, {}, {"p": ProjectorModel("p", SIZE, lens, AHEAD)})


def _patches(patch_px: float) -> Observations:
    x, y = np.meshgrid(np.arange(4, 640, 8.0), np.arange(4, 400, 8.0))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    return Observations(pixels, pixels, np.full(len(pixels), 0.1), patch_px)


def test_patches_beside_an_edge_count_less() -> None:
    """The front wall at x = 3 meets the right one at y = -1, so at column 319.5 + 400 / 3."""
    box = MeshShape.of(*mesh_shapes.box((-3.0, -1.0, -9.0), (3.0, 9.0, 9.0)))
    every = _patches(PATCH_PX)
    found = widened_at_creases(_rig(box), {("c", "p"): every})["c", "p"]
    edge = (SIZE[0] - 1) / 2 + FOCAL / 3
    away = np.abs(every.projector_px[:, 0] - edge)
    expected = np.where(away <= REACH * PATCH_PX, np.hypot(0.1, CREASE_PX), 0.1)
    np.testing.assert_allclose(found.sigma_px, expected)


def test_patches_across_a_jump_count_less() -> None:
    """Two walls of one normal: the edge of the nearer one is at column 319.5 + 400 / 3."""
    (near, faces), far = (
        mesh_shapes.box((-3.0, -9.0, -9.0), (3.0, 9.0, 9.0)),
        [[0, 1, 2], [0, 2, 3]],
    )
    panel = np.array([[2.0, -2 / 3, -8], [2, 8, -8], [2, 8, 8], [2, -2 / 3, 8]])
    vertices = np.concatenate([near, panel])
    shape = MeshShape.of(
        vertices, np.concatenate([faces, np.array(far)[:, ::-1] + 8]), convex=False
    )
    every = _patches(PATCH_PX)
    found = widened_at_creases(_rig(shape), {("c", "p"): every})["c", "p"]
    edge = (SIZE[0] - 1) / 2 + FOCAL / 3
    away = np.abs(every.projector_px[:, 0] - edge)
    beside = away <= REACH * PATCH_PX
    assert (found.sigma_px[beside] > CREASE_PX).all()
    well_beside = np.abs(away - REACH * PATCH_PX / 2) < REACH * PATCH_PX / 4
    assert (found.sigma_px[well_beside] > JUMP_PX).all()
    np.testing.assert_array_equal(found.sigma_px[~beside & (away < 60)], 0.1)


def test_places_and_round_walls_have_no_edge() -> None:
    box = MeshShape.of(*mesh_shapes.box((-3.0, -1.0, -9.0), (3.0, 9.0, 9.0)))
    vertices, faces = mesh_shapes.cylinder(3.0, 18.0, 720, closed=True)
    drum = MeshShape.of(vertices - [0, 0, 9.0], faces, smooth=True)
    for shape, patch_px in ((box, 0.0), (drum, PATCH_PX)):
        every = _patches(patch_px)
        found = widened_at_creases(_rig(shape), {("c", "p"): every})["c", "p"]
        np.testing.assert_array_equal(found.sigma_px, every.sigma_px)


def test_a_sphere_is_left_as_it_is() -> None:
    dome = SimulatedDome.build(3)
    seen = dome.observations(10, 0.0)
    assert widened_at_creases(RigGeometry(dome.problem(seen).shape, {}, {}), seen) == seen
