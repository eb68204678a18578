"""The dome as one camera sees it: direction and solid angle of every pixel, and lenses that it looks into."""

from dataclasses import dataclass, field, replace

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.model import RigGeometry, camera_rays, project_to_camera
from procam.estimate.geometry.screen_points import intersect_screen, round_shape, screen_points
from procam.maths.geometry.lenses import project_before_fold
from procam.maths.geometry.sphere import normalise
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.screen import Dome

BAND = 256  # rows at a time, in double precision
HOUSING_RADIUS_M = (
    0.15  # of a lens; also how far behind the screen a lens still shines through its hole
)
GLARE_PX = 3.0  # of glare around a lens's rim


@dataclass(frozen=True)
class DomeView:
    """The dome as one camera sees it.

    Attributes
    ----------
    direction : (H, W, 3) from the dome's centre to the point that the pixel sees.
    on_screen : (H, W) whether the pixel sees the cap.
    solid_angle_sr : (H, W) of that part of the cap from the centre [sr].
    """

    camera: CameraModel
    direction: Image
    on_screen: BoolArray
    solid_angle_sr: Array
    _points: dict[Dome, Image] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, camera: CameraModel, dome: Dome, rays: Array, seen: BoolArray) -> "DomeView":
        """The view of a camera with a pose, whose pixels have the `rays` (H, W, 3) and are `seen`."""
        origin, lines = camera_rays(camera, rays.reshape(-1, 3))
        direction = normalise(intersect_screen(round_shape(dome), origin, lines)).reshape(
            rays.shape
        )
        on_screen = seen & (direction[..., 2] >= np.cos(dome.half_angle))
        across = np.gradient(direction, axis=1)
        down = np.gradient(direction, axis=0)
        size = np.linalg.norm(np.cross(across, down), axis=-1)
        return cls(camera, direction.astype(np.float32), on_screen, np.where(on_screen, size, 0.0))

    def without(self, covered: BoolArray) -> "DomeView":
        """The view without the pixels of a mask (H, W)."""
        solid = np.where(covered, 0.0, self.solid_angle_sr)
        return replace(self, on_screen=self.on_screen & ~covered, solid_angle_sr=solid)

    def points(self, dome: Dome) -> Image:
        """Points (H, W, 3) that the pixels see [m]; computed once, for harmonics of a picture are slow."""
        if dome not in self._points:
            points = screen_points(round_shape(dome), self.direction)
            self._points[dome] = points.astype(np.float32)
        return self._points[dome]

    def camera_pixels(self, dome: Dome, direction: FloatArray) -> Array:
        """Pixel (..., 2) of the camera that sees the screen in directions (..., 3) from its centre."""
        return project_to_camera(self.camera, screen_points(round_shape(dome), direction))

    def projector_pixels(self, projector: ProjectorModel, dome: Dome) -> Image:
        """Projector pixel (H, W, 2) that lights the point each camera pixel sees; NaN if none does."""
        found = np.full((*self.on_screen.shape, 2), np.nan, np.float32)
        points, (width, height) = self.points(dome), projector.size
        for top in range(0, len(points), BAND):
            rows = slice(top, top + BAND)
            local = projector.projector_from_dome.apply(points[rows].astype(float))
            xy = project_before_fold(local, projector.lens)
            inside = (xy[..., 0] > -0.5) & (xy[..., 0] < width - 0.5)
            inside &= (xy[..., 1] > -0.5) & (xy[..., 1] < height - 0.5) & self.on_screen[rows]
            found[rows][inside] = xy[inside]
        return found


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
