"""Directions and solid angles of a camera's pixels."""

import numpy as np
import pytest
from domes import SimulatedDome

from procam.estimate.geometry.camera_view import ScreenView
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.sphere import cap_solid_angle
from procam.model.screen import Dome


def test_solid_angles_add_up_and_projector_pixels_light_what_is_seen() -> None:
    rig = SimulatedDome.build(4).rig()
    camera, dome = rig.cameras["zenith"], Dome(8.0, np.radians(60))
    step = 8
    line = np.arange(0, camera.size[0], step, dtype=float)
    rays = unproject(np.stack(np.meshgrid(line, line), axis=-1), camera.lens)
    view = ScreenView.of(camera, dome, rays, np.ones(rays.shape[:2], bool))
    assert view.weight.sum() == pytest.approx(cap_solid_angle(dome.half_angle), rel=0.01)
    projector = rig.projectors["south"]
    xy = view.projector_pixels(projector, dome)
    lit = np.isfinite(xy[..., 0])
    assert lit.any() and not lit[~view.on_screen].any()
    back = projector.projector_from_dome.inverse()
    rays = back.rotate(unproject(xy[lit].astype(float), projector.lens))
    points = rig.shape.intersect(np.broadcast_to(back.translation, rays.shape), rays)
    np.testing.assert_allclose(points / 8.0, view.direction[lit], atol=1e-4)
