"""New calibrations from what the closed loop has estimated: gains, and scattered light."""

from dataclasses import replace

import numpy as np

from procam.arrays import Array, FloatArray, Image
from procam.estimate.closed_loop.picture_loop import nodes_for_means
from procam.maths.geometry.sphere import cap_solid_angle, master_solid_angles
from procam.maths.light.radiosity import albedo_from_feedback, floor_return
from procam.maths.warp import pixel_places, sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.screen import RoomScreen
from procam.model.transport import Measured, ScreenMaps


def with_gains(calibration: Calibration, gain_factor: Array) -> Calibration:
    """The calibration with its gains multiplied by cell means (N, N, 3), as of `PictureLoop.gain_factor`."""
    factor, maps = nodes_for_means(gain_factor), calibration.maps
    where = pixel_places(maps.coverage.shape, maps.coverage.shape)
    hi = maps.lo + (maps.hi - maps.lo) * _factor_at(factor, where, maps)
    return replace(
        calibration,
        maps=replace(maps, hi=hi.astype(np.float32)),
        projectors={
            n: _regained(p, factor, calibration) for n, p in calibration.projectors.items()
        },
    )


def with_scatter(calibration: Calibration, factor: Array) -> Calibration:
    """The calibration with its scattered light multiplied by `factor` (3,), and all that follows from it."""
    maps, screen = calibration.maps, calibration.screen
    albedo_factor = _albedo_factor(calibration, factor)
    if isinstance(screen, RoomScreen):
        mean = float(albedo_factor.mean())
        others = ((n, min(mean * value, 1.0), mean * sigma) for n, value, sigma in screen.others)
        screen = screen.with_others(tuple(others))
    new = replace(
        maps,
        scatter_per_flux=(maps.scatter_per_flux * factor).astype(np.float32),
        albedo=(maps.albedo * albedo_factor).astype(np.float32),
    )
    return replace(
        calibration,
        screen=screen,
        maps=new,
        feedback=_times(calibration.feedback, factor),
        albedo=_times(calibration.albedo, albedo_factor),
        states={
            name: replace(state, feedback=_times(state.feedback, factor))
            for name, state in calibration.states.items()
        },
    )


def _regained(
    projector: ProjectorCalibration, factor: Array, calibration: Calibration
) -> ProjectorCalibration:
    direction, maps = np.nan_to_num(projector.surface.direction), calibration.maps
    where = calibration.screen.canvas.pixels(direction, maps.size)
    at = _factor_at(factor, where, maps)
    photometry = replace(projector.photometry, gain=projector.photometry.gain * at)
    return replace(projector, photometry=photometry)


def _factor_at(factor: Array, where: FloatArray, maps: ScreenMaps) -> Image:
    """The factor at positions (..., 2) of the maps [px]; 1 where the picture is protected."""
    cells, pixels = np.array(factor.shape[1::-1]), np.array(maps.coverage.shape[::-1])
    cell = (where + 0.5) * cells / pixels - 0.5
    inside = ((where > -1) & (where < pixels)).all(axis=-1, keepdims=True)
    cell = np.where(inside, np.clip(cell, 0, cells - 1), cell)
    at = sample(factor, cell, outside=1.0)
    at[maps.is_protected(where)] = 1.0
    return at


def _albedo_factor(calibration: Calibration, scatter: Array) -> Array:
    """Factor (C,) of the albedo that multiplies the feedback by `scatter` (C,).

    In a room light returns as in an enclosure of one albedo, m = x / (1 - x) for x in proportion to it.
    """
    if isinstance(calibration.screen, RoomScreen):
        m = calibration.feedback.value
        return np.asarray(scatter * (1 + m) / (1 + scatter * m))
    dome, maps, m = calibration.dome, calibration.maps, calibration.feedback.value
    screen_sr = cap_solid_angle(dome.half_angle)
    lit_sr = min(float((master_solid_angles(maps.size) * maps.coverage).sum()), screen_sr)
    returned = floor_return(dome.half_angle, dome.tilt, dome.floor_albedo)
    found, before = (albedo_from_feedback(f, lit_sr, screen_sr, returned) for f in (m * scatter, m))
    return found / before


def _times(measured: Measured, factor: Array) -> Measured:
    return Measured(measured.value * factor, measured.sigma * factor)
