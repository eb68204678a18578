"""The screen as one camera sees it: direction and weight of every pixel, and lenses that it looks into."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.model import RigGeometry, camera_rays, project_to_camera
from procam.estimate.geometry.screen_points import (
    intersect_screen,
    panel_pixels,
    screen_points,
    seen_points,
)
from procam.maths.geometry.sphere import normalise
from procam.maths.warp import without_jumps
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.screen import RoomScreen, Screen

if TYPE_CHECKING:
    from procam.maths.mesh.canvas import MeshCanvas

BAND = 256  # rows at a time, in double precision
HOUSING_RADIUS_M = (
    0.15  # of a lens; also how far behind the screen a lens still shines through its hole
)
GLARE_PX = 3.0  # of glare around a lens's rim


@dataclass(frozen=True)
class ScreenView:
    """The screen as one camera sees it.

    Attributes
    ----------
    direction : (H, W, 3) from the screen's origin to the point that the pixel sees.
    on_screen : (H, W) whether the pixel sees the screen.
    weight : (H, W) of what it sees: solid angle from the centre of a dome [sr], area in a room [m^2].
    """

    camera: CameraModel
    direction: Image
    on_screen: BoolArray
    weight: Array
    _points: dict[Screen, Image] = field(default_factory=dict, repr=False, compare=False)
    _faces: "dict[Screen, MeshCanvas]" = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, camera: CameraModel, screen: Screen, rays: Array, seen: BoolArray) -> "ScreenView":
        """The view of a camera with a pose, whose pixels have the `rays` (H, W, 3) and are `seen`."""
        origin, lines = camera_rays(camera, rays.reshape(-1, 3))
        points = intersect_screen(screen.shape, origin, lines).reshape(rays.shape)
        direction, measured = normalise(points), screen.measure(points)
        on_screen = seen & screen.contains(direction)
        across, down = (_steps(measured, axis) for axis in (1, 0))
        size = np.where(on_screen, np.linalg.norm(np.cross(across, down), axis=-1), 0.0)
        if isinstance(screen, RoomScreen):
            size = without_jumps(size, on_screen)
        return cls(camera, direction.astype(np.float32), on_screen, size)

    def without(self, covered: BoolArray) -> "ScreenView":
        """The view without the pixels of a mask (H, W)."""
        weight = np.where(covered, 0.0, self.weight)
        return replace(self, on_screen=self.on_screen & ~covered, weight=weight, _faces={})

    def points(self, screen: Screen) -> Image:
        """Points (H, W, 3) that the pixels see [m]; computed once, for harmonics of a picture are slow."""
        if screen not in self._points:
            points = screen_points(screen.shape, self.direction)
            self._points[screen] = points.astype(np.float32)
        return self._points[screen]

    def faces(self, screen: RoomScreen) -> "MeshCanvas":
        """The room's faces that the pixels see; computed once."""
        if screen not in self._faces:
            direction = np.nan_to_num(self.direction)
            self._faces[screen] = screen.canvas.photograph(direction, self.weight)
        return self._faces[screen]

    def camera_pixels(self, screen: Screen, direction: FloatArray) -> Array:
        """Pixel (..., 2) of the camera that sees the screen in directions (..., 3) from its centre.

        NaN of places that something hides from it.
        """
        assert self.camera.camera_from_dome is not None
        points = screen_points(screen.shape, direction)
        pixels = project_to_camera(self.camera, points)
        pixels[~seen_points(screen.shape, self.camera.camera_from_dome.origin, points)] = np.nan
        return pixels

    def projector_pixels(self, projector: ProjectorModel, screen: Screen) -> Image:
        """Projector pixel (H, W, 2) that lights the point each camera pixel sees; NaN if none does."""
        found = np.full((*self.on_screen.shape, 2), np.nan, np.float32)
        points, (width, height) = self.points(screen), projector.size
        for top in range(0, len(points), BAND):
            rows = slice(top, top + BAND)
            xy = panel_pixels(screen.shape, projector, points[rows].astype(float))
            inside = (xy[..., 0] > -0.5) & (xy[..., 0] < width - 0.5)
            inside &= (xy[..., 1] > -0.5) & (xy[..., 1] < height - 0.5) & self.on_screen[rows]
            found[rows][inside] = xy[inside]
        return found


def _steps(measured: Array, axis: int) -> Array:
    """Change (H, W, 3) of points from pixel to pixel, 0 where no neighbour meets the screen."""
    central = np.gradient(measured, axis=axis)
    lost = np.isnan(central).any(axis=-1)
    if lost.any():  # at the edge of an open screen one neighbour does
        forward = np.diff(measured, axis=axis, append=np.nan)
        backward = np.diff(measured, axis=axis, prepend=np.nan)
        one_sided = np.where(np.isnan(forward), backward, forward)
        central[lost] = np.nan_to_num(one_sided[lost])
    return central


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
