"""Photographs of projectors, sampled at the points of their panels as the calibration places them.

A photograph from the session that was calibrated and one of today are sampled at the same points of a panel,
each through the camera's pose at its time. What differs then has changed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import project_to_camera
from procam.estimate.geometry.screen_points import screen_points
from procam.maths.warp import sample
from procam.model.calibration import ProjectorCalibration
from procam.model.optics import CameraModel
from procam.model.screen import Screen

MOST_ACROSS = 640  # points of a panel: about as many as a camera resolves of it
LEAST_WHITE = 0.02  # of the panel's usual white, below which a point is not lit


@dataclass(frozen=True)
class ProjectorPhotographs:
    """Radiance (H, W, 3) of what one projector shows alone; NaN where saturated.

    Attributes
    ----------
    white : its full white. black : its black. levels : tiles of several drives. All without the light of
        the dark room; white and levels without black too.
    again : white at the end of the run; None where it was not photographed twice.
    """

    white: Image
    black: Image
    levels: Image
    again: Image | None = None

    @cached_property
    def sums(self) -> Image:
        """Levels and white (H, W, 2), all channels together."""
        return np.stack([self.levels.sum(axis=-1), self.white.sum(axis=-1)], axis=-1)


@dataclass(frozen=True, slots=True)
class VenuePhotographs:
    """Photographs of one time, by a camera with a pose.

    `view` is what it sees of the screen, `dark` (H, W, 3) the radiance with all projectors dark.
    """

    view: ScreenView
    dark: Image
    projectors: Mapping[str, ProjectorPhotographs]

    @property
    def camera(self) -> CameraModel:
        """The camera."""
        return self.view.camera


@dataclass(frozen=True, slots=True)
class PanelGrid:
    """Points of a projector's panel, `step` [px] apart.

    Attributes
    ----------
    pixel : (h, w, 2) of the panel [px]. direction : (h, w, 3) where the calibration puts them on the dome.
    valid : (h, w) whether their light reaches the screen. solid_angle : (h, w) of their pixels [sr].
    """

    step: int
    pixel: Array
    direction: Image
    valid: BoolArray
    solid_angle: Image
    _points: Array

    @classmethod
    def of(cls, projector: ProjectorCalibration, screen: Screen) -> "PanelGrid":
        """The grid of a calibrated projector."""
        width, height = projector.model.size
        step = -(-width // MOST_ACROSS)
        pixel = np.stack(np.meshgrid(np.arange(0, width, step), np.arange(0, height, step)), -1)
        direction = projector.surface.direction[::step, ::step]
        valid = projector.surface.valid[::step, ::step] & np.isfinite(direction).all(axis=-1)
        points = screen_points(screen.shape, np.nan_to_num(direction, nan=0.577))
        solid = projector.surface.solid_angle_sr[::step, ::step]
        return cls(step, pixel.astype(float), direction, valid, solid, points)

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        return self.valid.shape[0], self.valid.shape[1]

    def places(self, camera: CameraModel) -> Array:
        """Camera pixels (h, w, 2) that see the points."""
        return project_to_camera(camera, self._points)

    def points(self) -> Array:
        """Points (h, w, 3) on the screen [m]."""
        return self._points


@dataclass(frozen=True, slots=True)
class PanelPictures:
    """One projector's photographs at the points of its panel, (h, w, 3); NaN where unknown.

    `texture` (h, w) is the light of the level tiles over that of white, all channels together, so that it
    depends neither on the lamp's colour nor on the paint.
    """

    white: Image
    black: Image
    levels: Image
    again: Image | None
    texture: Image

    @classmethod
    def of(
        cls, photographs: VenuePhotographs, name: str, places: FloatArray, lit: BoolArray
    ) -> "PanelPictures":
        """Sample photographs at `places` (h, w, 2) in the camera, where the panel is `lit` (h, w)."""
        shown, outside = photographs.projectors[name], np.float32(np.nan)
        known = lit & _known(photographs, places)

        def at(image: Image) -> Image:
            return np.where(known[..., None], sample(image, places, float(outside)), outside)

        white, levels = at(shown.white), at(shown.levels)
        again = None if shown.again is None else at(shown.again)
        return cls(white, at(shown.black), levels, again, texture(photographs, name, places, lit))


def texture(photographs: VenuePhotographs, name: str, places: FloatArray, lit: BoolArray) -> Image:
    """The texture (h, w) of `PanelPictures` alone, at `places` (h, w, 2) in the camera."""
    sums = photographs.projectors[name].sums
    levels, white = (sample(sums[..., i], places, float("nan")) for i in range(2))
    known = lit & _known(photographs, places)
    return _relative(levels, np.where(known, white, np.float32(np.nan)))


def _known(photographs: VenuePhotographs, places: FloatArray) -> BoolArray:
    return np.asarray(sample(photographs.view.on_screen.astype(np.float32), places) > 1 - 1e-3)


def _relative(light: Image, total: Image) -> Image:
    """Light over white (h, w); NaN where there is hardly any white."""
    finite = np.isfinite(total)
    usual = float(np.percentile(total[finite], 90)) if finite.any() else np.inf
    bright = finite & (total > LEAST_WHITE * usual) & (usual > 0)
    return np.where(bright, light / np.where(bright, total, 1), np.nan)
