"""Raw counts to relative radiance: black level, exposure, vignetting, veiling glare."""

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyval

from procam.arrays import Array, Array32, BoolArray, Image
from procam.estimate.camera.binning import Binning
from procam.estimate.camera.veil import near_veil
from procam.maths.geometry.lenses import project, unproject
from procam.model.frame import Frame
from procam.model.optics import CameraModel, Sensor

BAND = 256  # rows at a time: in double precision whole pictures would take gigabytes
LEAST_LIGHT = 0.05  # that vignetting may leave
FOLD_PX = 1e-3  # of a pixel's ray, projected again; a lens has no ray for what lies beyond its fold


class Radiometer:
    """Converts frames of one camera to radiance [full scale per second], (H, W) or (H, W, 3).

    Saturated pixels become NaN. Pixels that are not `seen` are not valid: they lie outside the image
    circle, or beyond the radius at which the lens's polynomial has its maximum.

    Parameters
    ----------
    photographed : the camera.
    binning : joins pixels of its photographs; none by default.

    Attributes
    ----------
    camera : whose pixels are those of the radiance. seen : (H, W).
    """

    def __init__(self, photographed: CameraModel, binning: Binning | None = None) -> None:
        self.photographed = photographed
        self.binning = binning or Binning.none(photographed.size)
        self.camera = self.binning.camera(photographed)
        width, height = self.camera.size
        self.seen = np.empty((height, width), bool)
        for rows in self._bands():
            self.seen[rows] = self._has_light(rows)

    @cached_property
    def rays(self) -> Array:
        """Unit vectors (H, W, 3) of the pixels, in the camera's frame."""
        return unproject(self._pixels(slice(0, self.camera.size[1])), self.camera.lens)

    @cached_property
    def _correction(self) -> Array32:
        """Factor (H, W) against vignetting; 0 where nothing is seen."""
        found = np.empty(self.seen.shape, np.float32)
        for rows in self._bands():
            fall = self.fall(unproject(self._pixels(rows), self.camera.lens))
            found[rows] = np.where(self.seen[rows], 1 / np.maximum(fall, LEAST_LIGHT), 0.0)
        return found

    @cached_property
    def _mean_weight(self) -> Array32:
        # a matrix product is much faster than a sum over two axes
        return (self.seen / self.seen.sum()).astype(np.float32).ravel()

    def _bands(self) -> Iterator[slice]:
        height = self.camera.size[1]
        return (slice(top, min(top + BAND, height)) for top in range(0, height, BAND))

    def _pixels(self, rows: slice) -> Array:
        columns = np.arange(self.camera.size[0])
        return np.stack(np.meshgrid(columns, np.arange(rows.start, rows.stop)), -1).astype(float)

    def fall(self, rays: Array) -> Array:
        """Light (H, W) that vignetting leaves of rays (H, W, 3)."""
        theta2 = np.arccos(np.clip(rays[..., 2], -1, 1)) ** 2
        return np.asarray(polyval(theta2, [1.0, *self.camera.sensor.vignetting]))

    def _has_light(self, rows: slice) -> BoolArray:
        """Which pixels of some rows do."""
        pixels, lens = self._pixels(rows), self.camera.lens
        rays = unproject(pixels, lens)
        off_axis = np.hypot(*np.moveaxis(pixels - lens.centre, -1, 0))
        radius = min(self.photographed.size) / 2 / self.binning.factor
        circle = lens.kind == "brown" or off_axis <= radius
        away = np.linalg.norm(project(rays, lens) - pixels, axis=-1)
        return np.asarray((self.fall(rays) > LEAST_LIGHT) & circle & (away < FOLD_PX))

    def with_glare(self, sensor: Sensor) -> "Radiometer":
        """The same camera, whose `sensor` differs in its glare; rays are not computed again."""
        same = copy(self)
        same.camera = replace(self.camera, sensor=sensor)
        same.photographed = replace(self.photographed, sensor=sensor)
        return same

    def radiance(self, frame: Frame) -> Image:
        """Radiance of a frame; veiling glare is estimated from the frame's mean and subtracted."""
        sensor = self.camera.sensor
        shaped = (..., None) if frame.counts.ndim == 3 else (...,)
        scale = (sensor.full_scale * frame.settings.exposure_s) * (1 - sensor.glare)
        light = self.binning.means(frame.counts)
        light -= np.float32(sensor.black_level)
        light *= (self._correction / np.float32(scale))[shaped]
        # observed = (1 - g) true + (g - l) mean(true) + near veil: the mean over the circle is unchanged
        near, share = sensor.near_glare, sensor.near_share
        veil = near_veil(light, near) if near else np.float32(0)
        if sensor.glare > share:
            mean = self._mean_weight @ light.reshape(self._mean_weight.size, -1)
            veil = veil + np.float32(sensor.glare - share) * mean
        light -= veil
        saturated = 2**sensor.bits - 1
        if frame.counts.max() >= saturated:
            light[self.binning.largest(frame.counts) >= saturated] = np.nan
        return light
