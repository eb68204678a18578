"""Why a rig does not fit: what crews get wrong, tried one after the other, told by name."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from procam.errors import CalibrationError
from procam.estimate.geometry.adjustment import RigProblem
from procam.estimate.geometry.model import (
    POSE,
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    residual_slopes,
)
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.maths.geometry.lenses import unproject

Array = NDArray[np.float64]
FLAT_SHARE = 0.004  # of the panel's width that a flat picture may be bent by lenses
WHOLE = 0.5  # of a panel's width and height that a view must reach over
SQUARE = 0.01  # by which a projector's two focal lengths may differ: its pixels are square
FORMATS = (
    16 / 10 / (16 / 9),
    4 / 3 / (16 / 10),
    4 / 3 / (16 / 9),
    5 / 4 / (4 / 3),
    5 / 4 / (16 / 10),
)
FORMAT_OFF = 0.004
DOUBTFUL = 2.0  # excess of the residuals on a sphere from which on a cause is looked for
BETTER = 0.5  # of the excess, at most, that a cause must leave
ALIKE = 1.2  # two excesses of which neither is better
MOVED = 0.5  # of a camera's misfit that two poses remove: panels of a dome are below .1
MOST = 100.0  # excess of a rig of which nothing fits
SOME = 600  # observations of each pair that are tried


def causes(problem: RigProblem, found: GeometrySolution | None) -> list[str]:
    """Sentences on what is probably wrong; `found` is None where there was no solution at all.

    Each cause is put right by calculation, and told only if the rig then fits much better.
    """
    if found is None or found.sphere_excess > DOUBTFUL:
        told = _flat(problem)
        if told:
            return told
    told = []
    if found is not None:
        told = [line for name in found.projectors if (line := _stretched(found, name))]
        if found.sphere_excess < DOUBTFUL:
            return told
    trial = _small(problem)
    free = _solution(replace(trial, fiducials=()))
    excess = np.inf if free is None else free.sphere_excess
    if excess < DOUBTFUL:  # nothing is wrong but the fiducials
        return told + _exchanged(trial, ALIKE * excess)
    wanted = BETTER * min(excess, MOST)
    return told + (_exchanged(trial, wanted) or _bumped(trial, free, wanted))


def _flat(problem: RigProblem) -> list[str]:
    """Cameras that see all pictures as a flat screen would show them.

    A small part of a dome is flat: only views of much of a panel count.
    """
    lines = []
    for name, camera in problem.cameras.items():
        bent = {}
        for (c, projector), seen in problem.observations.items():
            extent = np.ptp(seen.projector_px, axis=0) / problem.hung[projector].size
            if c == name and extent.min() > WHOLE:
                off = _off_a_plane(unproject(seen.camera_px, camera.lens), seen.projector_px)
                bent[projector] = off / problem.hung[projector].size[0]
        if bent and max(bent.values()) < FLAT_SHARE:
            lines.append(
                f"camera {name} sees {', '.join(bent)} on a flat screen (bent by "
                f"{max(bent.values()):.2%} of the picture's width); turn it to the dome"
            )
    return lines


def _off_a_plane(ray: Array, pixels: Array) -> float:
    """Middle distance [px] of pixels (N, 2) from a homography of rays (N, 3)."""
    scale = np.abs(pixels).max()
    xy, zero = pixels / scale, np.zeros_like(ray)
    rows = np.r_[np.c_[ray, zero, -xy[:, :1] * ray], np.c_[zero, ray, -xy[:, 1:] * ray]]
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    shown = ray @ matrix.T
    off = shown[:, :2] / shown[:, 2:] - xy
    return float(np.median(np.linalg.norm(off, axis=1)) * scale)


def _stretched(found: GeometrySolution, name: str) -> str:
    """What a projector does to its picture before it shows it; "" if nothing."""
    lens = found.projectors[name].lens
    sigma = np.sqrt(np.diag(found.covariance)[ParameterLayout.of(found.rig).projectors[name]])[
        POSE : POSE + 2
    ]
    aspect = float(lens.focal[0] / lens.focal[1])
    if abs(aspect - 1) < SQUARE + 4 * float(np.linalg.norm(sigma / lens.focal)):
        return ""
    wide = max(aspect, 1 / aspect)
    cause = (
        "keystone correction or corner pinning is on in its menu or in the player; switch it off"
    )
    if min(abs(wide * ratio - 1) for ratio in FORMATS) < FORMAT_OFF:
        cause = (
            "it is fed another format than its panel has; feed it its native resolution, unscaled"
        )
    return f"projector {name} stretches its picture by {wide:.3f}, expected square pixels: {cause}"


def _exchanged(trial: RigProblem, wanted: float) -> list[str]:
    """Two cameras whose photographs are each filed under the other's name."""
    for a, b in combinations(trial.cameras, 2):
        if trial.cameras[a].size != trial.cameras[b].size:
            continue
        other = {a: b, b: a}
        seen = {(other.get(c, c), p): o for (c, p), o in trial.observations.items()}
        if _excess(replace(trial, observations=seen)) < wanted:
            return [
                f"cameras {a} and {b} seem exchanged: each one's photographs fit the other's lens and "
                "marks; exchange their cables, or their names in venue.toml"
            ]
    return []


def _bumped(trial: RigProblem, free: GeometrySolution | None, wanted: float) -> list[str]:
    """A camera that moved between the pictures of two projectors."""
    order = list(trial.hung)
    if len(trial.cameras) == 1:
        cut, excess = _cut_alone(trial)
    else:
        cut, excess = _cut_among(trial, free)
    best = min(excess.values(), default=np.inf)
    if best >= wanted:
        return []
    named = " or ".join(name for name, left in excess.items() if left < ALIKE * best)
    moment = f"between the pictures of {order[cut - 1]} and {order[cut]}"
    return [f"camera {named} moved {moment}; fix it and capture again"]


def _cut_alone(trial: RigProblem) -> tuple[int, dict[str, float]]:
    """When the only camera moved, and what is left if each part of its pictures is solved alone."""
    order = list(trial.hung)
    left = [
        max(_excess(_only(trial, some)) for some in (order[:cut], order[cut:]))
        for cut in range(1, len(order))
    ]
    if not left:
        return 0, {}
    return 1 + int(np.argmin(left)), dict.fromkeys(trial.cameras, min(left))


def _cut_among(trial: RigProblem, free: GeometrySolution | None) -> tuple[int, dict[str, float]]:
    """When one of several cameras moved, and what is left if it was that or another one.

    Residuals tell the moment, but may sit in another camera's pictures: so all are tried there.
    """
    if free is None:
        return 0, {}
    cut, share = max((_best_cut(free, trial, name) for name in trial.cameras), key=lambda c: c[1])
    if share < MOVED:
        return 0, {}
    later = list(trial.hung)[cut:]
    return cut, {name: _excess(_cut(trial, name, later)) for name in trial.cameras}


@dataclass(frozen=True, slots=True)
class _OwnPose:
    """What one pair's residuals want its camera's pose to be: normal matrix (6, 6), gradient (6,)."""

    matrix: Array
    gradient: Array
    cost: float


NO_WISH = _OwnPose(np.zeros((POSE, POSE)), np.zeros(POSE), 0.0)


def _own_pose(rig: RigGeometry, pair: Pair, seen: Observations) -> _OwnPose:
    error, slopes = residual_slopes(rig, pair, seen)
    start = 1 + rig.shape.bumps.size
    rows = slopes[..., start : start + POSE].reshape(-1, POSE)
    error = error.ravel()
    good = np.isfinite(rows).all(axis=1) & np.isfinite(error)
    return _OwnPose(
        rows[good].T @ rows[good], rows[good].T @ error[good], float(np.sum(error[good] ** 2))
    )


def _best_cut(found: GeometrySolution, trial: RigProblem, name: str) -> tuple[int, float]:
    """Before which projector a camera moved, if it did, and the share of its misfit that explains."""
    seen = {p: o for (c, p), o in trial.observations.items() if c == name}
    poses = [_own_pose(found.rig, (name, p), seen[p]) if p in seen else NO_WISH for p in trial.hung]
    gains = [_gain(poses[:cut]) + _gain(poses[cut:]) for cut in range(1, len(poses))]
    cost = sum(p.cost for p in poses)
    return 1 + int(np.argmax([*gains, 0.0])), max(gains, default=0.0) / max(cost, 1e-30)


def _gain(poses: Sequence[_OwnPose]) -> float:
    """By how much one pose for some pairs lowers the sum of their squares."""
    matrix = sum((p.matrix for p in poses), 1e-9 * np.eye(POSE))
    gradient = sum((p.gradient for p in poses), np.zeros(POSE))
    return float(gradient @ np.linalg.solve(matrix, gradient))


def _cut(trial: RigProblem, name: str, later: Sequence[str]) -> RigProblem:
    """The problem with a camera counted as two, the other for the projectors shot later."""
    other = f"{name} later"
    camera = replace(trial.cameras[name], name=other)
    seen = {
        (other if (c, p) in {(name, q) for q in later} else c, p): o
        for (c, p), o in trial.observations.items()
    }
    return replace(
        trial,
        fiducials=(),  # nobody knows when they were clicked
        cameras={**trial.cameras, other: camera},
        intrinsics={**trial.intrinsics, other: trial.intrinsics[name]},
        observations=seen,
    )


def _only(trial: RigProblem, names: Sequence[str]) -> RigProblem:
    """The problem with some of its projectors."""
    hung = {name: trial.hung[name] for name in names}
    seen = {(c, p): o for (c, p), o in trial.observations.items() if p in hung}
    return replace(trial, fiducials=(), hung=hung, observations=seen)


def _small(problem: RigProblem) -> RigProblem:
    """An exact sphere, fewer observations: enough to tell a blunder."""
    few = {p: o.thinned(SOME) for p, o in problem.observations.items()}
    return replace(problem, observations=few, distances=(), most_degree=0)


def _solution(trial: RigProblem) -> GeometrySolution | None:
    """The solved rig; None where it cannot be solved."""
    try:
        return solve_geometry(trial)
    except CalibrationError:
        return None


def _excess(trial: RigProblem) -> float:
    """By how much residuals exceed their errors; infinite where the rig cannot be solved."""
    found = _solution(trial)
    return np.inf if found is None else found.sphere_excess
