"""New calibrations from what the closed loop has estimated: gains, and scattered light."""

from dataclasses import replace

import numpy as np

from procam.arrays import Array, FloatArray, Image
from procam.estimate.closed_loop.dome import nodes_for_means
from procam.maths.geometry.sphere import (
    cap_solid_angle,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.light.radiosity import albedo_from_feedback, floor_return
from procam.maths.warp import sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.transport import Measured, ScreenMaps


def with_gains(calibration: Calibration, gain_factor: Array) -> Calibration:
    """The calibration with its gains multiplied by cell means (N, N, 3), as of `DomeLoop.gain_factor`."""
    factor, maps = nodes_for_means(gain_factor), calibration.maps
    where = master_pixels(master_directions(maps.size)[0], maps.size)
    hi = maps.lo + (maps.hi - maps.lo) * _factor_at(factor, where, maps)
    return replace(
        calibration,
        maps=replace(maps, hi=hi.astype(np.float32)),
        projectors={n: _regained(p, factor, maps) for n, p in calibration.projectors.items()},
    )


def with_scatter(calibration: Calibration, factor: Array) -> Calibration:
    """The calibration with its scattered light multiplied by `factor` (3,), and all that follows from it."""
    maps, albedo_factor = calibration.maps, _albedo_factor(calibration, factor)
    new = replace(
        maps,
        scatter_per_flux=(maps.scatter_per_flux * factor).astype(np.float32),
        albedo=(maps.albedo * albedo_factor).astype(np.float32),
    )
    return replace(
        calibration,
        maps=new,
        feedback=_times(calibration.feedback, factor),
        albedo=_times(calibration.albedo, albedo_factor),
        states={
            name: replace(state, feedback=_times(state.feedback, factor))
            for name, state in calibration.states.items()
        },
    )


def _regained(
    projector: ProjectorCalibration, factor: Array, maps: ScreenMaps
) -> ProjectorCalibration:
    direction = np.nan_to_num(projector.surface.direction)
    at = _factor_at(factor, master_pixels(direction, maps.size), maps)
    photometry = replace(projector.photometry, gain=projector.photometry.gain * at)
    return replace(projector, photometry=photometry)


def _factor_at(factor: Array, where: FloatArray, maps: ScreenMaps) -> Image:
    """The factor at positions (..., 2) of the maps [px]; 1 where the picture is protected."""
    cell = (where + 0.5) * (len(factor) / maps.size) - 0.5
    at = sample(factor, cell, outside=1.0)
    at[maps.is_protected(where)] = 1.0
    return at


def _albedo_factor(calibration: Calibration, scatter: Array) -> Array:
    """Factor (C,) of the albedo that multiplies the feedback by `scatter` (C,)."""
    dome, maps, m = calibration.dome, calibration.maps, calibration.feedback.value
    screen_sr = cap_solid_angle(dome.half_angle)
    lit_sr = min(float((master_solid_angles(maps.size) * maps.coverage).sum()), screen_sr)
    returned = floor_return(dome.half_angle, dome.tilt, dome.floor_albedo)
    found, before = (albedo_from_feedback(f, lit_sr, screen_sr, returned) for f in (m * scatter, m))
    return found / before


def _times(measured: Measured, factor: Array) -> Measured:
    return Measured(measured.value * factor, measured.sigma * factor)
