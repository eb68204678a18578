"""Predicted light of a full-panel picture of one projector at a place on the dome.

Direct light is the calibrated gain; scattered light follows from the scatter kernel
(docs/theory/interreflection.md, I16). Hand-meter readings are compared with it.
"""

import numpy as np

from procam.arrays import Array
from procam.errors import InputError
from procam.estimate.geometry.model import project_to_camera
from procam.estimate.geometry.screen_points import screen_points
from procam.maths.geometry.sphere import master_pixels
from procam.maths.light.scatter_kernel import basis, moments
from procam.maths.warp import sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.correspondence import ProjectorSurface
from procam.model.reading import PATCHES, MeterReading, Spot

ROWS = 64  # of a panel at a time, to bound the memory of the harmonics
NEAR_PX = 2.0  # largest extrapolation beyond a panel pixel
FULLY_LIT = 0.999


class PanelLight:
    """Predicts the light (3,) [rel] at the places of readings, of their projector alone, unblended."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._moments = dict[str, Array]()
        self._whites = dict[Spot, Array]()

    def patch(self, reading: MeterReading) -> Array:
        """Total light of the reading's patch, without black.

        It is proportional to the light that the patch sends into each channel, colour_mix @ drive.
        """
        mix = self._calibration.projectors[reading.projector].photometry.colour_mix
        return np.asarray(mix @ np.array(PATCHES[reading.patch]) * self._white(reading))

    def black(self, reading: MeterReading) -> Array:
        """Total light of the projector's black picture.

        The calibration has the black of all projectors together. It is divided in proportion to their
        white, which assumes the same contrast for all that reach the place.
        """
        own_white, direction, maps = self._white(reading), reading.direction, self._calibration.maps
        together = sample(maps.lo, master_pixels(direction[None], maps.size))[0].astype(float)
        projectors = self._calibration.projectors.values()
        all_white = np.sum([_gain(p, direction) for p in projectors], axis=0)
        return np.asarray(together / all_white * own_white)

    def _white(self, reading: MeterReading) -> Array:
        """Total light of full white."""
        if reading.spot not in self._whites:
            self._whites[reading.spot] = self._direct(reading) + self._scattered(reading)
        return self._whites[reading.spot]

    def _direct(self, reading: MeterReading) -> Array:
        """Direct light of full white.

        Raises
        ------
        InputError
            For a place that no camera sees or that the projector does not light.
        """
        calibration, direction = self._calibration, reading.direction
        projector = calibration.projectors[reading.projector]
        if not _is_seen(calibration, direction):
            raise InputError(
                f"{reading}: no camera sees this place, so the calibration has no light for it; read it "
                "elsewhere, or remove the line"
            )
        place = _panel_place(projector.surface, direction)
        if sample(projector.surface.valid.astype(np.float32), place[None])[0] < FULLY_LIT:
            raise InputError(
                f"{reading}: {reading.projector} does not light this place, or only in part; read it well "
                "inside its picture, or remove the line"
            )
        return _gain(projector, direction)

    def _scattered(self, reading: MeterReading) -> Array:
        """Scattered light of full white: u (phi.(B M)) / (phi.g)."""
        name, maps = reading.projector, self._calibration.maps
        kernel, where = maps.kernel, reading.direction[None]
        if name not in self._moments:
            self._moments[name] = _moments(self._calibration.projectors[name], kernel.degree)
        u = sample(maps.scatter_per_flux, master_pixels(where, maps.size))[0].astype(float)
        phi = basis(where, kernel.degree)[0]
        per_albedo = np.einsum("k,ckl,lc->c", phi, kernel.matrix, self._moments[name])
        return np.asarray(u * per_albedo / (kernel.profile @ phi))


def _moments(projector: ProjectorCalibration, degree: int) -> Array:
    """Moments (K, 3) [rel sr] of the direct light of a full white panel."""
    surface, gain = projector.surface, projector.photometry.gain
    total = np.zeros(((degree + 1) ** 2, 3))
    for first in range(0, len(gain), ROWS):
        part = slice(first, first + ROWS)
        lit = surface.valid[part]
        light, solid = (a[part][lit].astype(float) for a in (gain, surface.solid_angle_sr))
        total += moments(light, solid, basis(surface.direction[part][lit].astype(float), degree))
    return total


def _gain(projector: ProjectorCalibration, direction: Array) -> Array:
    """Direct light (3,) of full white in a direction; 0 where the panel does not reach."""
    place = _panel_place(projector.surface, direction)
    return sample(projector.photometry.gain, place[None])[0].astype(float)


def _panel_place(surface: ProjectorSurface, direction: Array) -> Array:
    """Panel pixel (2,) that lights a direction (3,), linearised at the nearest pixel; NaN if none."""
    along = np.nan_to_num(surface.direction) @ direction.astype(np.float32)
    height, width = along.shape
    found = np.unravel_index(int(np.argmax(along)), along.shape)
    row, column = np.clip(found, 1, (height - 2, width - 2))
    around = surface.direction[row - 1 : row + 2, column - 1 : column + 2].astype(float)
    slopes = np.stack([around[1, 2] - around[1, 0], around[2, 1] - around[0, 1]], axis=1) / 2
    away = direction - around[1, 1]
    # not ">": NaN, beyond the screen, has to pass
    if not np.linalg.norm(away) <= NEAR_PX * np.linalg.norm(slopes):
        return np.full(2, np.nan)
    return np.array([column, row]) + np.linalg.lstsq(slopes, away, rcond=None)[0]


def _is_seen(calibration: Calibration, direction: Array) -> bool:
    """Whether the direction is inside the picture of a camera."""
    points = screen_points(calibration.screen.shape, direction[None])
    return any(
        ((xy > -0.5) & (xy < np.array(camera.size) - 0.5)).all()
        for camera in calibration.cameras.values()
        for xy in project_to_camera(camera, points)
    )
