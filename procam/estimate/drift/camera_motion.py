"""Finds whether the camera moved, and where it is now, from where it sees the pictures of all projectors.

A camera that moved shifts the pictures of all projectors together; a projector that moved shifts its own
alone. The pose is taken under which most projectors are where they were.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array
from procam.estimate.geometry.model import project_to_camera
from procam.maths.geometry.pose import rotation_vector
from procam.maths.statistics import robust_sigma_2d
from procam.model.optics import CameraModel

LEAST_SEEN = 6  # windows that determine a pose
# camera px: a projector that is where it was; wide where a picture is seen through a wrong pose, which bends
# it, and close once the pose is nearly right
WIDE_PX, CLOSE_PX = 0.5, 0.03
SAME_SIGMAS = 4.0
ALIKE = 1.1  # factor on the pose's standard error: errors of neighbouring windows are alike


@dataclass(frozen=True, slots=True)
class Seen:
    """Points (n, 3) of the screen [m], the camera pixels (n, 2) that see them now, and sigma (n,) [px]."""

    point: Array
    pixel: Array
    sigma: Array


@dataclass(frozen=True, slots=True)
class CameraMotion:
    """How a camera moved.

    Attributes
    ----------
    camera : with its pose now. moved : whether that is another one.
    turned_deg, shifted_mm : by how much, and their standard errors.
    unmoved : projectors that are where they were.
    """

    camera: CameraModel
    moved: bool
    turned_deg: float = 0.0
    turned_sigma: float = 0.0
    shifted_mm: float = 0.0
    shifted_sigma: float = 0.0
    unmoved: tuple[str, ...] = ()


def find_camera_motion(
    camera: CameraModel, seen: Mapping[str, Seen], same_px: float = CLOSE_PX
) -> CameraMotion:
    """The pose of the camera now, by the places of pictures of projectors.

    A projector whose picture is within `same_px` [camera px] of its place, or within what noise explains, is
    where it was.
    """
    names = [name for name in seen if len(seen[name].point) >= LEAST_SEEN]
    still = _agreeing(camera, seen, names, same_px)
    best, agreeing, misfit = camera, still, np.inf
    for name in names if len(still) < len(names) else ():
        trial, residual = _resected(camera, seen, [name])
        agree = _agreeing(trial, seen, names, same_px)
        if agree:
            trial, residual = _resected(camera, seen, agree)
            agree = _agreeing(trial, seen, names, same_px)
        more, same = len(agree) > len(agreeing), len(agree) == len(agreeing) and best is not camera
        if more or (same and residual < misfit):
            best, agreeing, misfit = trial, agree, residual
    # a pose also bends a little towards a projector whose own picture is slightly off
    worse = _off(best, seen, still) > _off(camera, seen, still)
    many = 2 * len(still) >= len(agreeing)
    bent = (many and worse) or not _shifted(camera, best, seen, agreeing, same_px)
    if bent or len(agreeing) < min(2, len(names)):
        return CameraMotion(camera, False, unmoved=tuple(still))
    return _described(camera, best, seen, agreeing)


def _offsets(camera: CameraModel, seen: Seen) -> Array:
    return np.asarray(seen.pixel - project_to_camera(camera, seen.point), float)


def _agreeing(
    camera: CameraModel, seen: Mapping[str, Seen], names: list[str], same_px: float
) -> list[str]:
    """Projectors whose picture is where it was, for a camera with this pose."""
    return [n for n in names if _away(_offsets(camera, seen[n])) < _same(seen[n], same_px)]


def _shifted(
    before: CameraModel,
    now: CameraModel,
    seen: Mapping[str, Seen],
    names: list[str],
    same_px: float,
) -> bool:
    """Whether another pose moves the picture of any projector by more than counts as the same."""
    return any(
        _away(_offsets(before, seen[n]) - _offsets(now, seen[n])) > _same(seen[n], same_px)
        for n in names
    )


def _off(camera: CameraModel, seen: Mapping[str, Seen], names: list[str]) -> float:
    return sum(_away(_offsets(camera, seen[n])) for n in names)


def _away(offsets: Array) -> float:
    return float(np.median(np.linalg.norm(offsets, axis=1)))


def _same(seen: Seen, same_px: float) -> float:
    """Distance [camera px] within which a picture is where it was."""
    return max(same_px, SAME_SIGMAS * float(np.median(seen.sigma)))


def _placed(camera: CameraModel, x: Array) -> CameraModel:
    assert camera.camera_from_dome is not None
    return replace(camera, camera_from_dome=camera.camera_from_dome.moved(x))


def _resected(
    camera: CameraModel, seen: Mapping[str, Seen], names: list[str]
) -> tuple[CameraModel, float]:
    """The camera where it fits the pictures of some projectors, and the misfit of one coordinate [px]."""

    def off(x: Array) -> Array:
        return np.concatenate([_offsets(_placed(camera, x), seen[n]).ravel() for n in names])

    found = least_squares(off, np.zeros(6), loss="soft_l1", f_scale=0.1)
    trial = _placed(camera, found.x)
    away = np.concatenate([np.linalg.norm(_offsets(trial, seen[n]), axis=1) for n in names])
    return trial, robust_sigma_2d(away)


def _described(
    before: CameraModel, now: CameraModel, seen: Mapping[str, Seen], names: list[str]
) -> CameraMotion:
    """Angle and shift between two poses, with standard errors by the misfit."""
    points = Seen(
        *(np.concatenate([getattr(seen[n], f) for n in names]) for f in ("point", "pixel", "sigma"))
    )
    step = 1e-5
    base = _offsets(now, points).ravel()
    slopes = np.stack(
        [(_offsets(_placed(now, step * e), points).ravel() - base) / step for e in np.eye(6)],
        axis=1,
    )
    sigma = ALIKE * max(robust_sigma_2d(np.linalg.norm(base.reshape(-1, 2), axis=1)), 1e-4)
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes) * sigma**2, float)
    assert before.camera_from_dome is not None and now.camera_from_dome is not None
    turn = rotation_vector(now.camera_from_dome.rotation @ before.camera_from_dome.rotation.T)
    shift = now.camera_from_dome.origin - before.camera_from_dome.origin
    (turned, turned_sigma), (shifted, shifted_sigma) = (
        _length(turn, covariance[:3, :3]),
        _length(now.camera_from_dome.rotation @ shift, covariance[3:, 3:]),
    )
    return CameraMotion(
        now,
        True,
        float(np.degrees(turned)),
        float(np.degrees(turned_sigma)),
        1e3 * shifted,
        1e3 * shifted_sigma,
        tuple(names),
    )


def _length(vector: Array, covariance: Array) -> tuple[float, float]:
    length = float(np.linalg.norm(vector))
    along = vector / max(length, 1e-12)
    return length, float(np.sqrt(along @ covariance @ along))
