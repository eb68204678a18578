"""Camera pixels that see a projector's lens instead of the screen."""

import numpy as np

from procam.arrays import Array, BoolArray
from procam.estimate.geometry.model import RigGeometry, camera_rays
from procam.maths.geometry.sphere import normalise
from procam.model.optics import CameraModel

HOUSING_RADIUS_M = (
    0.15  # of a lens; also how far behind the screen a lens still shines through its hole
)
GLARE_PX = 3.0  # of glare around a lens's rim


def lens_glints(rig: RigGeometry, model: CameraModel, rays: Array) -> BoolArray:
    """Pixels (H, W) at which a camera of the rig sees a projector's lens, given their rays (H, W, 3).

    A disc around every lens in front of the screen. A lens behind it, as for rear projection, is
    invisible.
    """
    assert model.camera_from_dome is not None
    lenses = np.array([p.projector_from_dome.origin for p in rig.projectors.values()])
    towards = model.camera_from_dome.apply(lenses)
    distance = np.linalg.norm(towards, axis=1)
    towards = normalise(towards)
    origin, line = camera_rays(model, towards)
    screen = np.linalg.norm(rig.shape.intersect(origin, line) - origin, axis=1)
    before = ~(distance > screen + HOUSING_RADIUS_M)  # true as well where the ray misses the screen
    radius = np.arcsin(np.minimum(HOUSING_RADIUS_M / distance, 1.0))
    radius += GLARE_PX / float(model.lens.focal.mean())
    covered = np.zeros(rays.shape[:2], bool)
    for ahead, angle in zip(towards[before], radius[before], strict=True):
        covered |= rays @ ahead > np.cos(angle)
    return covered
