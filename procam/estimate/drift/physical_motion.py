"""Tests whether a nudged projector, or a shifted or zoomed lens, explains where its picture went.

A turn of several degrees bends a picture a little, as a keystone correction does, so the terms of the
picture's motion alone do not tell the two apart; the projector's own model does.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array
from procam.estimate.geometry.model import moved_pose
from procam.maths.geometry.lenses import project
from procam.maths.statistics import robust_sigma_2d
from procam.model.optics import ProjectorModel

SHIFT_M = 0.1  # of a projector that somebody pushes
LEAST_PX, LEAST_SHARE = 0.03, 0.03  # misfit that is none: of a pixel, and of the motion
FEWEST = 8  # places


def explains_motion(model: ProjectorModel, point: Array, pixel: Array) -> bool:
    """Whether the pixels (n, 2), whose light falls on points (n, 3) [m], fit the model moved or refocused."""
    known = np.isfinite(point).all(axis=1) & np.isfinite(pixel).all(axis=1)
    if known.sum() < FEWEST:
        return False
    point, pixel = point[known], pixel[known]
    moved = float(np.sqrt(np.mean(np.sum((_pixels(model, point) - pixel) ** 2, axis=1))))
    limit = max(LEAST_PX, LEAST_SHARE * moved)
    fits = (_turned, 6, SHIFT_M / np.sqrt(len(point))), (_lens_moved, 3, np.inf)
    return any(
        _misfit(change, model, point, pixel, n, prior, limit) < limit for change, n, prior in fits
    )


def _pixels(model: ProjectorModel, point: Array) -> Array:
    return project(model.projector_from_dome.apply(point), model.lens)


def _turned(model: ProjectorModel, x: Array) -> ProjectorModel:
    return replace(model, projector_from_dome=moved_pose(model.projector_from_dome, x))


def _lens_moved(model: ProjectorModel, x: Array) -> ProjectorModel:
    lens = replace(
        model.lens, focal=model.lens.focal * np.exp(x[0]), centre=model.lens.centre + 100 * x[1:]
    )
    return replace(model, lens=lens)


def _misfit(
    change: Callable[[ProjectorModel, Array], ProjectorModel],
    model: ProjectorModel,
    point: Array,
    pixel: Array,
    count: int,
    shift_m: float,
    limit: float,
) -> float:
    """Robust misfit [px] of the model, changed by `count` numbers, with a prior of the shift."""

    def off(x: Array) -> Array:
        away = np.nan_to_num(_pixels(change(model, x), point) - pixel, nan=1e3) / limit
        return np.r_[away.ravel(), x[3:] / shift_m]

    found = least_squares(off, np.zeros(count), loss="soft_l1")
    away = _pixels(change(model, found.x), point) - pixel
    return robust_sigma_2d(np.nan_to_num(np.linalg.norm(away, axis=1), nan=1e3))
