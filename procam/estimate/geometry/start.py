"""Start values for the bundle adjustment, from nothing but rays and a sphere.

One camera is set at several positions about the dome's centre, and each projector that it sees is
resected: by the direct linear transform for a pinhole, by a search over focal lengths for a fisheye.
The best start leads; further cameras are resected from the projectors they share with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array
from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.boards.projector_corners import resect_pinhole
from procam.estimate.geometry.model import Observations, Pair, RigGeometry, points_seen, residuals
from procam.maths.geometry.lenses import Lens, LensKind, project, unproject
from procam.maths.geometry.pose import Pose, align_rotation, rotation_vector
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import direction_from_angles, normalise
from procam.model.optics import CameraModel, Fiducial, ProjectorModel

THINNED = 400  # observations of each pair that are used here
MIN_OBSERVATIONS = 40  # of a projector
MIN_FIDUCIALS = 4  # three leave up to four solutions for a position
OFFSETS = (0.25, 0.5)  # of the radius: distances of the first camera from the centre
FLAT, FLAT_SHARE, FLAT_ROUNDS = (
    0.02,
    0.7,
    3,
)  # of the points' extent; of the points; of a fit of the wall
FLAT_FOCAL_LENGTHS, FLAT_CENTRES = (0.5, 1.0, 2.0), (0.5, 0.0, 1.0)  # of the width; of the height
FOCAL_LENGTHS = (0.3, 0.45, 0.6, 0.8)  # over the panel's short side, tried for a fisheye projector


@dataclass(frozen=True, slots=True)
class ProjectorPrior:
    """What is known of a projector before the solve: size (width, height) [px], kind of lens."""

    name: str
    size: tuple[int, int]
    lens: LensKind = "brown"


def initial_rigs(
    camera: CameraModel,
    shape: RoundShape,
    priors: Mapping[str, ProjectorPrior],
    seen: Mapping[Pair, Observations],
) -> list[RigGeometry]:
    """Rigs of one camera at several positions and the projectors it sees; best first.

    The dome frame has the camera's axes. Positions from which a projector appears mirrored are
    dropped.

    Raises
    ------
    CalibrationError
        If a projector appears mirrored from every position.
    """
    few = {pair: some.thinned(THINNED) for pair, some in seen.items()}
    tried, failure = [], None
    for pose in _first_poses(shape):
        placed = replace(camera, camera_from_dome=pose)
        try:
            tried.append(
                _with_projectors(RigGeometry(shape, {camera.name: placed}, {}), priors, few)
            )
        except CalibrationError as error:
            failure = failure or error
    if not tried and failure is not None:
        raise failure
    return sorted(tried, key=lambda rig: _misfit(rig, few))


def resect_projectors(
    rig: RigGeometry, priors: Mapping[str, ProjectorPrior], seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with all projectors resected anew from its cameras."""
    few = {pair: some.thinned(THINNED) for pair, some in seen.items()}
    return _with_projectors(RigGeometry(rig.shape, rig.cameras, {}), priors, few)


def resect_camera(
    cameras: Mapping[str, CameraModel], shape: RoundShape, fiducials: Sequence[Fiducial]
) -> CameraModel:
    """The camera that sees most fiducials, with its pose from them; needed on a mesh screen."""
    full = [f for f in fiducials if f.azimuth is not None and f.elevation is not None]
    marks = {name: [f for f in full if f.device == name] for name in cameras}
    name = max(marks, key=lambda n: len(marks[n]))
    if len(marks[name]) < MIN_FIDUCIALS:
        raise NotEnoughData(
            f"fiducials: no camera sees more than {len(marks[name])} with both angles known. A screen "
            f"that is a mesh needs {MIN_FIDUCIALS} or more; list corners of it."
        )
    angles = np.array([(f.azimuth or 0.0, f.elevation or 0.0) for f in marks[name]])
    direction = np.array([direction_from_angles(*pair) for pair in angles])
    ray = unproject(np.array([f.pixel for f in marks[name]], float), cameras[name].lens)
    point = shape.radius_at(direction)[:, None] * direction
    pose = resect_by_rays(ray, point, shape.radius_m)
    return replace(cameras[name], camera_from_dome=pose)


def add_camera(
    rig: RigGeometry,
    camera: CameraModel,
    priors: Mapping[str, ProjectorPrior],
    seen: Mapping[Pair, Observations],
) -> RigGeometry:
    """The rig with one more camera, and the projectors that only this one sees."""
    few = {pair: some.thinned(THINNED) for pair, some in seen.items()}
    return _with_projectors(_placed(rig, camera, few), priors, few)


def check_projectors_placed(rig: RigGeometry, priors: Mapping[str, ProjectorPrior]) -> None:
    """Refuse a rig without one of the projectors."""
    if missing := set(priors) - set(rig.projectors):
        raise NotEnoughData(
            f"projector {min(missing)}: no camera with a pose sees {MIN_OBSERVATIONS} or more patches of "
            "it. Check that it is on and in focus, and that the cameras' views overlap."
        )


def _first_poses(shape: RoundShape) -> list[Pose]:
    """Poses at several positions about the centre, in the camera's own axes."""
    places = [np.zeros(3)]
    for offset in OFFSETS:
        for azimuth in np.arange(6) * np.pi / 3:
            places.append(offset * shape.radius_m * direction_from_angles(azimuth, 0.2))
    return [Pose(np.eye(3), -place) for place in places]


def _with_projectors(
    rig: RigGeometry, priors: Mapping[str, ProjectorPrior], seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with every projector that one of its cameras sees enough of."""
    found = dict(rig.projectors)
    for name, projector in priors.items():
        views = [(c, o) for (c, p), o in seen.items() if p == name and c in rig.cameras]
        if name in found or not views or max(len(o.sigma_px) for _, o in views) < MIN_OBSERVATIONS:
            continue
        camera, some = max(views, key=lambda view: len(view[1].sigma_px))
        points = points_seen(rig, camera, some.camera_px)
        good = np.isfinite(points).all(axis=1)
        if good.sum() >= MIN_OBSERVATIONS:
            fit = _resection if projector.lens == "brown" else _fisheye_resection
            found[name] = fit(projector, points[good], some.projector_px[good])
    return RigGeometry(rig.shape, rig.cameras, found)


def _placed(
    rig: RigGeometry, camera: CameraModel, seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with one more camera, resected from the projectors it sees."""
    views = [(p, o) for (c, p), o in seen.items() if c == camera.name and p in rig.projectors]
    rays, points = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for name, some in views:
        projector = rig.projectors[name]
        back = projector.projector_from_dome.inverse()
        out = back.rotate(unproject(some.projector_px, projector.lens))
        points.append(rig.shape.intersect(np.broadcast_to(back.translation, out.shape), out))
        rays.append(unproject(some.camera_px, camera.lens))
    ray, point = np.concatenate(rays), np.concatenate(points)
    good = np.isfinite(point).all(axis=1)
    if good.sum() < MIN_OBSERVATIONS:
        raise NotEnoughData(
            f"camera {camera.name}: it shares {int(good.sum())} patches of projectors with the other "
            f"cameras and needs {MIN_OBSERVATIONS} or more. Turn it so that the views overlap."
        )
    pose = resect_by_rays(ray[good], point[good], rig.shape.radius_m)
    placed = replace(camera, camera_from_dome=pose)
    return RigGeometry(rig.shape, {**rig.cameras, camera.name: placed}, rig.projectors)


def resect_by_rays(ray: Array, point: Array, radius_m: float) -> Pose:
    """The pose from which rays (N, 3) of the device point to known points (N, 3) [m].

    Only the position is searched; the best rotation for each has a closed form (Kabsch 1976).
    """

    def rotation(place: Array) -> Array:
        return align_rotation(normalise(point - place), ray)

    def error(place: Array) -> Array:
        return np.asarray((normalise(point - place) @ rotation(place).T - ray).ravel())

    scale = 0.1 * radius_m
    fits = [
        least_squares(error, place, x_scale=scale, loss="soft_l1", f_scale=0.01, max_nfev=40)
        for place in (np.zeros(3), np.array([0, 0, -0.4 * radius_m]))
    ]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    return Pose(rotation(best), -rotation(best) @ best)


def _misfit(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """Mean over pairs of the median residual [px]; a missing projector counts as 1000 px."""
    missing = {p for _, p in seen} - set(rig.projectors)
    medians = [1e3] * len(missing)
    for pair, some in seen.items():
        if pair[0] in rig.cameras and pair[1] in rig.projectors:
            error = np.linalg.norm(residuals(rig, pair, some), axis=1)
            medians.append(float(np.median(np.nan_to_num(error, nan=1e3))))
    return float(np.mean(medians)) if medians else np.inf


def _resection(prior: ProjectorPrior, points: Array, pixels: Array) -> ProjectorModel:
    """A pinhole projector by the direct linear transform; on a flat wall, with square pixels."""
    if _are_flat(points):
        return _flat_resection(prior, points, pixels)
    found = resect_pinhole(points, pixels, prior.size)
    if found is None:
        raise CalibrationError(
            f"projector {prior.name}: its picture arrives mirrored. Switch off rear projection or flip "
            "in its menu; if it is not mirrored, correct f and distortion of the camera in venue.toml."
        )
    return ProjectorModel(prior.name, prior.size, *found)


def _are_flat(points: Array) -> bool:
    """Whether most points (N, 3) lie on one wall, which does not determine all of a pinhole."""
    away = points - np.median(points, axis=0)
    normal = np.linalg.svd(away, full_matrices=False)[2][2]
    for _ in range(FLAT_ROUNDS):  # some light beside the wall must not tilt it
        off = np.abs(away @ normal - np.median(away @ normal))
        near = away[off <= np.quantile(off, FLAT_SHARE)]
        normal = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)[2][2]
    off = np.abs(away @ normal - np.median(away @ normal))
    return bool(np.quantile(off, FLAT_SHARE) < FLAT * np.ptp(away, axis=0).max())


def _flat_resection(prior: ProjectorPrior, points: Array, pixels: Array) -> ProjectorModel:
    """A pinhole with square pixels and its centre halfway across: what points of one wall determine."""
    (width, height), zero = prior.size, np.zeros(5)
    radius_m = float(np.linalg.norm(points, axis=1).max())

    def lens_of(x: Array) -> Lens:
        return Lens(
            "brown", np.full(2, width * np.exp(x[0])), np.array([width / 2, height * x[1]]), zero
        )

    def error(x: Array) -> Array:
        off = project(Pose.from_vectors(x[2:5], x[5:]).apply(points), lens_of(x)) - pixels
        return np.nan_to_num(off, nan=float(width)).ravel()

    fits = []
    for focal in FLAT_FOCAL_LENGTHS:
        for centre in FLAT_CENTRES:
            x = np.array([np.log(focal), centre])
            pose = resect_by_rays(unproject(pixels, lens_of(x)), points, radius_m)
            start = np.r_[x, rotation_vector(pose.rotation), pose.translation]
            fits.append(least_squares(error, start, loss="soft_l1", f_scale=2.0, max_nfev=60))
    best = min(fits, key=lambda fit: float(fit.cost)).x
    pose = Pose.from_vectors(best[2:5], best[5:])
    return ProjectorModel(prior.name, prior.size, lens_of(best), pose)


def _fisheye_resection(prior: ProjectorPrior, points: Array, pixels: Array) -> ProjectorModel:
    """A fisheye projector: the best pose over several focal lengths."""
    radius_m = float(np.linalg.norm(points, axis=1).mean())
    centre = (np.array(prior.size) - 1) / 2
    found = []
    for share in FOCAL_LENGTHS:
        lens = Lens("kannala-brandt", np.full(2, share * min(prior.size)), centre, np.zeros(4))
        pose = resect_by_rays(unproject(pixels, lens), points, radius_m)
        error = np.linalg.norm(project(pose.apply(points), lens) - pixels, axis=1)
        found.append((float(np.median(error)), lens, pose))
    _, lens, pose = min(found, key=lambda each: each[0])
    return ProjectorModel(prior.name, prior.size, lens, pose)
