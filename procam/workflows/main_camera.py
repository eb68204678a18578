"""The camera that a calibration's light is measured with, and what it sees of the screen."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Image
from procam.estimate.camera.binning import Binning
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.geometry.camera_view import ScreenView
from procam.files.venue.load import Venue
from procam.files.venue.masks import camera_masks, screen_mask
from procam.model.calibration import Calibration
from procam.model.optics import CameraModel
from procam.model.screen import ContentCanvas, Screen


@dataclass(frozen=True, slots=True)
class MainCamera:
    """The main camera of a calibration.

    Attributes
    ----------
    radiometer : makes radiance of its photographs.
    view : of the screen, without the manual masks.
    content_matrix : (3, 3) from its channels to content channels. canvas : of the calibration's maps.
    """

    radiometer: Radiometer
    view: ScreenView
    content_matrix: Image
    canvas: ContentCanvas

    @classmethod
    def of(cls, venue: Venue, calibration: Calibration) -> "MainCamera":
        """The main camera of a venue's calibration."""
        radiometer = light_radiometer(calibration.camera)
        view = screen_view(venue, calibration.screen, radiometer)
        content_matrix = calibration.content_from_camera.astype(np.float32)
        return cls(radiometer, view, content_matrix, calibration.screen.canvas)

    @property
    def name(self) -> str:
        """Of the camera."""
        return self.radiometer.camera.name

    def content(self, radiance: Image) -> Image:
        """Content light (H, W, 3) of radiance (H, W, 3)."""
        return np.asarray(radiance @ self.content_matrix.T)


def light_radiometer(camera: CameraModel, stated: CameraModel | None = None) -> Radiometer:
    """Of a camera that measures light; pixels of a large one are joined, as those of its `stated` model."""
    return Radiometer(camera, Binning.of(stated or camera))


def screen_view(venue: Venue, screen: Screen, radiometer: Radiometer) -> ScreenView:
    """A camera's view of the screen, without the manual masks of both."""
    masks, binning = camera_masks(venue), radiometer.binning
    seen = radiometer.seen & ~binning.largest(masks[radiometer.camera.name].covered)
    view = ScreenView.of(radiometer.camera, screen, radiometer.rays, seen)
    size = venue.table.screen.map_size
    places = screen.canvas.pixels(np.nan_to_num(view.direction), size)
    return view.without(screen_mask(venue, size).at(places))
