"""Whether a projector or its lens moved a picture, or its electronics.

A turn of several degrees bends a picture a little, as a keystone correction does, so the terms of the
picture's motion alone do not tell the two apart; the projector's own model does (`explains_motion`). A lens
or a projector that moved takes the edge of its light along, seen in its full white (`edge_follows`). A
picture that is scaled or bent electronically moves inside an edge that stays.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array, Image
from procam.estimate.drift.displacement import Motion
from procam.estimate.drift.pictures import PanelGrid
from procam.estimate.geometry.model import project_to_camera
from procam.estimate.geometry.screen_points import intersect_screen
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.statistics import robust_sigma_2d
from procam.maths.warp import sample
from procam.model.optics import CameraModel, ProjectorModel

SHIFT_M = 0.1  # of a projector that somebody pushes
LEAST_PX, LEAST_SHARE = 0.03, 0.03  # misfit that is none: of a pixel, and of the motion
FEWEST = 8  # places
BAND = 12  # grid px outside and inside the edge
LEAST_LINES = 0.25  # of an edge that must be lit
LEAST_STEP = 0.5  # of the step of light at the edge before
LEAST_EXPECTED = 0.1  # grid px: less is within noise


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
    return replace(model, projector_from_dome=model.projector_from_dome.moved(x))


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


@dataclass(frozen=True, slots=True)
class EdgeBands:
    """Panel pixels (lines, 2 BAND, 2) across each edge, from outside to inside, and points on the screen."""

    pixel: list[Array]
    point: list[Array]

    @classmethod
    def of(cls, projector: ProjectorModel, shape: RoundShape, grid: PanelGrid) -> "EdgeBands":
        """The bands of the edges of a panel that are lit."""
        height, width = grid.shape
        across = np.arange(-BAND, BAND) + 0.5
        sides = (
            (grid.valid[:, 0], 0, across),
            (grid.valid[:, -1], 0, width - 1 - across),
            (grid.valid[0], 1, across),
            (grid.valid[-1], 1, height - 1 - across),
        )
        pixel, point = list[Array](), list[Array]()
        for lit, axis, place in sides:
            lines = np.flatnonzero(lit)
            if lit.mean() < LEAST_LINES:
                continue
            mesh = np.meshgrid(place, lines)
            own = np.stack(mesh if axis == 0 else mesh[::-1], axis=-1).astype(float) * grid.step
            pose = projector.projector_from_dome.inverse()
            rays = pose.rotate(unproject(own, projector.lens)).reshape(-1, 3)
            pixel.append(own)
            point.append(intersect_screen(shape, pose.translation, rays).reshape(*own.shape[:2], 3))
        return cls(pixel, point)


def edge_follows(
    bands: EdgeBands,
    grid: PanelGrid,
    before: tuple[CameraModel, Image],
    now: tuple[CameraModel, Image],
    motion: Motion,
) -> float | None:
    """Movement of the edges of light over that of the picture at the edges: 1 or 0; None if neither shows.

    `before` and `now` are a camera and its photograph (H, W, 3) of white.
    """
    moved, expected = list[float](), list[float]()
    for pixel, point in zip(bands.pixel, bands.point, strict=True):
        inner = pixel[:, BAND] / grid.step
        outward = (pixel[:, 0] - pixel[:, -1]) / np.linalg.norm(
            pixel[:, 0] - pixel[:, -1], axis=-1, keepdims=True
        )
        (old, old_step), (new, new_step) = (
            _lit_width(sample(image.sum(axis=-1), project_to_camera(camera, point)))
            for camera, image in (before, now)
        )
        # an edge that left the band leaves no step in it
        change = np.where(new_step > LEAST_STEP * old_step, new - old, np.nan)
        good = np.isfinite(change)
        if good.mean() < LEAST_LINES:
            continue
        moved.append(float(np.median(change[good])))
        expected.append(float(np.median(np.sum(motion.at(inner) * outward, axis=-1)[good])))
    wanted = np.array(expected)
    if not len(wanted) or np.abs(wanted).max() < LEAST_EXPECTED:
        return None
    # light that is cut off by a plate stays at one edge; at another it follows
    clear = np.abs(wanted) >= np.abs(wanted).max() / 2
    return float((np.array(moved)[clear] / wanted[clear]).max())


def _lit_width(profile: Image) -> tuple[Array, Array]:
    """Width (n,) [grid px] of the light in profiles (n, 2 BAND) across an edge, and its step (n,)."""
    inside = np.median(profile[:, -BAND // 2 :], axis=1)
    outside = np.median(profile[:, : BAND // 3], axis=1)
    step = inside - outside
    with np.errstate(divide="ignore", invalid="ignore"):
        width = ((profile - outside[:, None]) / step[:, None]).sum(axis=1)
    return np.asarray(width), np.asarray(step)
