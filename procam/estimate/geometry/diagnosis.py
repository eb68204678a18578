"""Why a rig does not fit: the usual mistakes of an installation, each tested by name.

Every test undoes one mistake numerically (a flat screen, a stretched picture, exchanged cameras, a
camera that moved during the capture) and reports it only if the corrected rig fits much better. Fits
are judged by the systematic ratio on an exact sphere; few observations are enough for that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from procam.arrays import Array
from procam.errors import CalibrationError, InputError
from procam.estimate.boards.projector_corners import direct_linear_transform
from procam.estimate.geometry.adjustment import SQUARE, RigProblem, square_rows
from procam.estimate.geometry.model import (
    POSE,
    Observations,
    Pair,
    RigGeometry,
    residual_slopes,
)
from procam.estimate.geometry.solve import NOT_SQUARE, GeometrySolution, solve_geometry
from procam.maths.geometry.lenses import Lens, unproject

FLAT_SHARE = 0.004  # of the panel's width: distortion by lenses of a picture on a flat screen
MIN_EXTENT = 0.5  # of a panel's width and height, for a test whether the screen is flat
STRETCHED = 0.01  # relative difference of a projector's two focal lengths, as its pixels are square
FORMATS = (  # ratios of two usual aspect ratios
    16 / 10 / (16 / 9),
    4 / 3 / (16 / 10),
    4 / 3 / (16 / 9),
    5 / 4 / (4 / 3),
    5 / 4 / (16 / 10),
)
FORMAT_TOLERANCE = 0.004
SUSPICIOUS = 2.0  # systematic ratio from which a cause is sought
BETTER = 0.5  # share of the systematic ratio that must remain at most, once a cause is corrected
EQUAL = 1.2  # factor between two systematic ratios of which neither is better
MOVED = 0.5  # share of a camera's misfit that two poses must remove; panelled domes give below 0.1
MOST = 100.0  # limit of the systematic ratio of a rig that does not fit at all
RESCALED = 0.01  # share by which a focal length is off; boards give it to 0.0005
THINNED = 600  # observations of each pair that the tests use


def find_causes(problem: RigProblem, found: GeometrySolution | None) -> list[str]:
    """Sentences on probable causes of a misfit; `found` is None if the solve failed."""
    if found is None or found.sphere_systematic_ratio > SUSPICIOUS:
        flat = _flat(problem)
        if flat:
            return flat
    lines = []
    if found is not None:
        lines = [line for name in found.projectors if (line := _stretched(found, name))]
        if found.sphere_systematic_ratio < SUSPICIOUS:
            return lines
    trial = _small(problem)
    free = _solution(replace(trial, fiducials=()))
    ratio = np.inf if free is None else free.sphere_systematic_ratio
    if ratio < SUSPICIOUS:  # only the fiducials do not fit
        return lines + _exchanged(trial, EQUAL * ratio)
    wanted = BETTER * min(ratio, MOST)
    return lines + (
        _exchanged(trial, wanted)
        or _moved_camera(trial, free, wanted)
        or _rescaled(trial, wanted)  # last, as a free lens explains much of a movement too
    )


def _flat(problem: RigProblem) -> list[str]:
    """Cameras that see all pictures as on a flat screen.

    Only views of a large part of a panel count, because a small part of a dome is nearly flat.
    """
    lines = []
    for name, camera in problem.cameras.items():
        deviations = {}
        for (c, projector), seen in problem.observations.items():
            extent = np.ptp(seen.projector_px, axis=0) / problem.projectors[projector].size
            if c == name and extent.min() > MIN_EXTENT:
                error = _plane_error(unproject(seen.camera_px, camera.lens), seen.projector_px)
                deviations[projector] = error / problem.projectors[projector].size[0]
        if deviations and max(deviations.values()) < FLAT_SHARE:
            lines.append(
                f"camera {name} sees {', '.join(deviations)} on a flat screen (it deviates by "
                f"{max(deviations.values()):.2%} of the picture's width); turn it to the dome"
            )
    return lines


def _plane_error(ray: Array, pixels: Array) -> float:
    """Median distance [px] of pixels (N, 2) from the best homography of rays (N, 3)."""
    scale = np.abs(pixels).max()
    xy = pixels / scale
    mapped = ray @ direct_linear_transform(ray, xy, np.ones(len(ray))).T
    error = mapped[:, :2] / mapped[:, 2:] - xy
    return float(np.median(np.linalg.norm(error, axis=1)) * scale)


def pixel_aspect(rig: RigGeometry, covariance: Array, name: str) -> tuple[float, float]:
    """Ratio of a projector's focal lengths, and its standard error; `covariance` (P, P) of the rig."""
    across, down = rig.projectors[name].lens.focal
    _, (slope,) = square_rows(rig, [name])
    return float(across / down), SQUARE * float(np.sqrt(slope @ covariance @ slope))


def _stretched(found: GeometrySolution, name: str) -> str:
    """A sentence on a projector that distorts its picture electronically; "" if it does not."""
    aspect, sigma = pixel_aspect(found.rig, found.covariance, name)
    if abs(aspect - 1) < STRETCHED + NOT_SQUARE * sigma:
        return ""
    wide = max(aspect, 1 / aspect)
    cause = (
        "keystone correction or corner pinning is on in its menu or in the player; switch it off"
    )
    if min(abs(wide * ratio - 1) for ratio in FORMATS) < FORMAT_TOLERANCE:
        cause = (
            "its input has another format than its panel; feed it its native resolution, unscaled"
        )
    return f"projector {name} stretches its picture by {wide:.3f}, so its pixels are not square: {cause}"


def rescaled_by(name: str, share: float) -> str:
    """What is said of a camera whose focal length is not the one of venue.toml, by a relative `share`."""
    return (
        f"camera {name}: its pictures need a focal length {share:+.1%} from f in venue.toml, as if they "
        "were cropped or scaled since the lens was measured. Switch off stabilisation, lens correction "
        "and digital zoom, photograph in the format in which the lens was measured"
    )


def _rescaled(trial: RigProblem, wanted: float) -> list[str]:
    """Cameras whose pictures were cropped or scaled: with a free lens of another focal length they fit."""
    found = _solution(
        replace(trial, fiducials=(), intrinsics=dict.fromkeys(trial.cameras, "solve"))
    )
    if found is None or found.sphere_systematic_ratio >= min(wanted, SUSPICIOUS):
        return []
    shares = {n: focal_share(c.lens, found.rig.cameras[n].lens) for n, c in trial.cameras.items()}
    return [rescaled_by(n, share) for n, share in shares.items() if abs(share) > RESCALED]


def focal_share(given: Lens, solved: Lens) -> float:
    """By which share a solved focal length differs from the given one."""
    return float(np.mean(solved.focal / given.focal)) - 1


def _exchanged(trial: RigProblem, wanted: float) -> list[str]:
    """Two cameras whose photographs are stored under each other's names."""
    for a, b in combinations(trial.cameras, 2):
        if trial.cameras[a].size != trial.cameras[b].size:
            continue
        other = {a: b, b: a}
        seen = {(other.get(c, c), p): o for (c, p), o in trial.observations.items()}
        if _ratio(replace(trial, observations=seen)) < wanted:
            return [
                f"cameras {a} and {b} seem exchanged: each one's photographs fit the other's lens and "
                "fiducials; exchange their cables, or their names in venue.toml"
            ]
    return []


def _moved_camera(trial: RigProblem, free: GeometrySolution | None, wanted: float) -> list[str]:
    """A camera that moved between the pictures of two projectors."""
    order = list(trial.projectors)
    if len(trial.cameras) == 1:
        cut, ratios = _cut_of_only_camera(trial)
    else:
        cut, ratios = _cut_of_one_camera(trial, free)
    best = min(ratios.values(), default=np.inf)
    if best >= wanted:
        return []
    named = " or ".join(name for name, ratio in ratios.items() if ratio < EQUAL * best)
    moment = f"between the pictures of {order[cut - 1]} and {order[cut]}"
    return [f"camera {named} moved {moment}; fix it and capture again"]


def _cut_of_only_camera(trial: RigProblem) -> tuple[int, dict[str, float]]:
    """The projector before which the only camera moved, and the ratio with both parts solved apart."""
    order = list(trial.projectors)
    ratios = [
        max(_ratio(_only(trial, some)) for some in (order[:cut], order[cut:]))
        for cut in range(1, len(order))
    ]
    if not ratios:
        return 0, {}
    return 1 + int(np.argmin(ratios)), dict.fromkeys(trial.cameras, min(ratios))


def _cut_of_one_camera(
    trial: RigProblem, free: GeometrySolution | None
) -> tuple[int, dict[str, float]]:
    """The projector before which one of several cameras moved, and the ratio for each camera.

    The residuals determine the moment, but may appear in another camera's pictures; so the moment is
    tried for every camera.
    """
    if free is None:
        return 0, {}
    cut, share = max((_best_cut(free, trial, name) for name in trial.cameras), key=lambda c: c[1])
    if share < MOVED:
        return 0, {}
    later = list(trial.projectors)[cut:]
    return cut, {name: _ratio(_split(trial, name, later)) for name in trial.cameras}


@dataclass(frozen=True, slots=True)
class _OwnPose:
    """Normal equations (6, 6), (6,) of one pair for its camera's pose, and the sum of squares."""

    matrix: Array
    gradient: Array
    cost: float


NO_DATA = _OwnPose(np.zeros((POSE, POSE)), np.zeros(POSE), 0.0)


def _own_pose(rig: RigGeometry, pair: Pair, seen: Observations) -> _OwnPose:
    error, slopes = residual_slopes(rig, pair, seen)
    start = 1 + rig.shape.harmonic_coefficients.size
    rows = slopes[..., start : start + POSE].reshape(-1, POSE)
    error = error.ravel()
    good = np.isfinite(rows).all(axis=1) & np.isfinite(error)
    return _OwnPose(
        rows[good].T @ rows[good], rows[good].T @ error[good], float(np.sum(error[good] ** 2))
    )


def _best_cut(found: GeometrySolution, trial: RigProblem, name: str) -> tuple[int, float]:
    """The projector before which a camera moved, and the share of its misfit that this explains."""
    seen = {p: o for (c, p), o in trial.observations.items() if c == name}
    poses = [
        _own_pose(found.rig, (name, p), seen[p]) if p in seen else NO_DATA for p in trial.projectors
    ]
    gains = [_gain(poses[:cut]) + _gain(poses[cut:]) for cut in range(1, len(poses))]
    cost = sum(p.cost for p in poses)
    return 1 + int(np.argmax([*gains, 0.0])), max(gains, default=0.0) / max(cost, 1e-30)


def _gain(poses: Sequence[_OwnPose]) -> float:
    """Decrease of the sum of squares of some pairs if they get a pose of their own."""
    matrix = sum((p.matrix for p in poses), 1e-9 * np.eye(POSE))
    gradient = sum((p.gradient for p in poses), np.zeros(POSE))
    return float(gradient @ np.linalg.solve(matrix, gradient))


def _split(trial: RigProblem, name: str, later: Sequence[str]) -> RigProblem:
    """The problem with a camera as two, the second one for the projectors captured later."""
    other = f"{name} later"
    camera = replace(trial.cameras[name], name=other)
    seen = {
        (other if (c, p) in {(name, q) for q in later} else c, p): o
        for (c, p), o in trial.observations.items()
    }
    return replace(
        trial,
        fiducials=(),  # clicked before or after the move, which is not recorded
        cameras={**trial.cameras, other: camera},
        intrinsics={**trial.intrinsics, other: trial.intrinsics[name]},
        observations=seen,
    )


def _only(trial: RigProblem, names: Sequence[str]) -> RigProblem:
    """The problem with some of its projectors."""
    projectors = {name: trial.projectors[name] for name in names}
    seen = {(c, p): o for (c, p), o in trial.observations.items() if p in projectors}
    return replace(trial, fiducials=(), projectors=projectors, observations=seen)


def _small(problem: RigProblem) -> RigProblem:
    """The problem on an exact sphere with fewer observations."""
    few = {p: o.thinned(THINNED) for p, o in problem.observations.items()}
    return replace(problem, observations=few, distances=(), most_degree=0)


def _solution(trial: RigProblem) -> GeometrySolution | None:
    """The solved rig; None where it cannot be solved."""
    try:
        return solve_geometry(trial)
    except (CalibrationError, InputError):  # a trial that leaves all lenses, where it does not fit
        return None


def _ratio(trial: RigProblem) -> float:
    """Systematic ratio of the solved rig; infinite where it cannot be solved."""
    found = _solution(trial)
    return np.inf if found is None else found.sphere_systematic_ratio
