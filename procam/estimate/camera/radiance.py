"""Raw counts to relative radiance: black level, exposure, vignetting, veiling glare."""

from copy import copy
from dataclasses import replace

import numpy as np

from procam.arrays import Image
from procam.estimate.camera.near_veil import near_veil
from procam.maths.geometry.lenses import project, unproject
from procam.model.frame import Frame
from procam.model.optics import CameraModel, Sensor

FOLD_PX = 1e-3  # of a pixel's ray, projected again; a lens has no ray for what lies beyond its fold


class Radiometer:
    """Converts frames of one camera to radiance [full scale per second], (H, W) or (H, W, 3).

    Saturated pixels become NaN. Pixels that are not `seen` are not valid: they lie outside the image
    circle, or beyond the radius at which the lens's polynomial has its maximum.
    """

    def __init__(self, camera: CameraModel) -> None:
        self.camera = camera
        width, height = camera.size
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
        self.rays = unproject(pixels, camera.lens)
        theta = np.arccos(np.clip(self.rays[..., 2], -1, 1))
        fall = np.ones_like(theta)
        for power, coefficient in enumerate(camera.sensor.vignetting, start=1):
            fall += coefficient * theta ** (2 * power)
        centre = camera.lens.centre
        off_axis = np.hypot(pixels[..., 0] - centre[0], pixels[..., 1] - centre[1])
        circle = camera.lens.kind == "brown" or off_axis <= min(camera.size) / 2
        away = np.linalg.norm(project(self.rays, camera.lens) - pixels, axis=-1)
        self.seen = np.asarray((fall > 0.05) & circle & (away < FOLD_PX))
        self._correction = np.where(self.seen, 1 / np.maximum(fall, 0.05), 0.0).astype(np.float32)
        # a matrix product is much faster than a sum over two axes
        self._mean_weight = (self.seen / self.seen.sum()).astype(np.float32).ravel()

    def with_glare(self, sensor: Sensor) -> "Radiometer":
        """The same camera, whose `sensor` differs in its glare; rays are not computed again."""
        same = copy(self)
        same.camera = replace(self.camera, sensor=sensor)
        return same

    def radiance(self, frame: Frame) -> Image:
        """Radiance of a frame; veiling glare is estimated from the frame's mean and subtracted."""
        sensor = self.camera.sensor
        shaped = (..., None) if frame.counts.ndim == 3 else (...,)
        scale = (sensor.full_scale * frame.settings.exposure_s) * (1 - sensor.glare)
        light = frame.counts.astype(np.float32)
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
            light[frame.counts >= saturated] = np.nan
        return light
