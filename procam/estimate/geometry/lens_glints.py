"""Projector lenses that a camera looks into: what it sees there is no screen."""

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.model import RigGeometry, camera_rays
from procam.maths.geometry.sphere import normalise

Array = NDArray[np.float64]
HOUSING_RADIUS_M = 0.15  # of a lens; as far behind a hole in the screen it still shines
GLARE_PX = 3.0  # by which a lens flares beyond its rim


def lens_glints(rig: RigGeometry, camera: str, rays: Array) -> NDArray[np.bool_]:
    """Pixels (H, W) at which a camera sees a projector's lens, by their rays (H, W, 3) in its frame.

    A disc round every lens that stands before the screen. One behind it, as of a rear projector, is
    not seen.
    """
    model = rig.cameras[camera]
    assert model.camera_from_dome is not None
    lenses = np.array([p.projector_from_dome.origin for p in rig.projectors.values()])
    towards = model.camera_from_dome.apply(lenses)
    distance = np.linalg.norm(towards, axis=1)
    towards = normalise(towards)
    origin, line = camera_rays(model, towards)
    screen = np.linalg.norm(rig.shape.meet(origin, line) - origin, axis=1)
    before = ~(distance > screen + HOUSING_RADIUS_M)  # also where there is no screen behind it
    radius = np.arcsin(np.minimum(HOUSING_RADIUS_M / distance, 1.0))
    radius += GLARE_PX / float(model.lens.focal.mean())
    covered = np.zeros(rays.shape[:2], bool)
    for ahead, angle in zip(towards[before], radius[before], strict=True):
        covered |= rays @ ahead > np.cos(angle)
    return covered
