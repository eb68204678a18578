"""Start values for the bundle adjustment, from nothing but rays and a sphere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq
from scipy.optimize import least_squares

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.geometry.model import Observations, Pair, RigGeometry, camera_rays, residuals
from procam.maths.geometry.lenses import Lens, LensKind, project, unproject
from procam.maths.geometry.pose import Pose, align_rotation
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import direction_from_angles, normalise
from procam.model.optics import CameraModel, Fiducial, ProjectorModel

Array = NDArray[np.float64]
SOME = 400  # observations of each pair that a start looks at
FEWEST = 40
FEWEST_MARKS = 4  # three leave up to four places to choose from
OFFSETS = (0.25, 0.5)  # of the radius, by which a camera may stand off the centre
WIDE = (0.3, 0.45, 0.6, 0.8)  # focal lengths over width that are tried for a fisheye projector


@dataclass(frozen=True, slots=True)
class ProjectorPrior:
    """A projector before it is solved: size (width, height) [px] and kind of lens."""

    name: str
    size: tuple[int, int]
    lens: LensKind = "brown"


def first_rigs(
    camera: CameraModel,
    shape: RoundShape,
    hung: Mapping[str, ProjectorPrior],
    seen: Mapping[Pair, Observations],
) -> list[RigGeometry]:
    """One camera, set at several places about the centre, and the projectors it sees; best first.

    In the camera's own axes. From a wrong place a projector may seem mirrored: these are left out.
    """
    few = {pair: some.thinned(SOME) for pair, some in seen.items()}
    tried, complaint = [], None
    for pose in _first_poses(shape):
        placed = replace(camera, camera_from_dome=pose)
        try:
            tried.append(_with_projectors(RigGeometry(shape, {camera.name: placed}, {}), hung, few))
        except CalibrationError as error:
            complaint = complaint or error
    if not tried and complaint is not None:
        raise complaint
    return sorted(tried, key=lambda rig: _misfit(rig, few))


def resect_projectors(
    rig: RigGeometry, hung: Mapping[str, ProjectorPrior], seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with all projectors found anew from where its cameras are."""
    few = {pair: some.thinned(SOME) for pair, some in seen.items()}
    return _with_projectors(RigGeometry(rig.shape, rig.cameras, {}), hung, few)


def placed_by_marks(
    cameras: Mapping[str, CameraModel], shape: RoundShape, fiducials: Sequence[Fiducial]
) -> CameraModel:
    """The camera that sees most fiducials, placed by them: what a screen needs that is no sphere."""
    full = [f for f in fiducials if f.azimuth is not None and f.elevation is not None]
    marks = {name: [f for f in full if f.device == name] for name in cameras}
    name = max(marks, key=lambda n: len(marks[n]))
    if len(marks[name]) < FEWEST_MARKS:
        raise NotEnoughData(
            f"fiducials: got {len(marks[name])} that one camera sees and both angles of which are "
            f"known, expected {FEWEST_MARKS} or more on a screen that is a mesh; list corners of it"
        )
    angles = np.array([(f.azimuth or 0.0, f.elevation or 0.0) for f in marks[name]])
    direction = np.array([direction_from_angles(*pair) for pair in angles])
    ray = unproject(np.array([f.pixel for f in marks[name]], float), cameras[name].lens)
    point = shape.reach(direction)[:, None] * direction
    pose = place_by_rays(ray, point, shape.radius_m)
    return replace(cameras[name], camera_from_dome=pose)


def with_camera(
    rig: RigGeometry,
    camera: CameraModel,
    hung: Mapping[str, ProjectorPrior],
    seen: Mapping[Pair, Observations],
) -> RigGeometry:
    """The rig with one more camera, placed by what it shares, and the projectors only that sees."""
    few = {pair: some.thinned(SOME) for pair, some in seen.items()}
    return _with_projectors(_placed(rig, camera, few), hung, few)


def check_complete(rig: RigGeometry, hung: Mapping[str, ProjectorPrior]) -> None:
    """Complain of a projector that no camera sees enough of."""
    if missing := set(hung) - set(rig.projectors):
        raise NotEnoughData(
            f"projector {min(missing)}: no camera that is placed sees enough of it, expected {FEWEST} "
            "patches or more; is it on and in focus, and do the cameras' views overlap?"
        )


def _first_poses(shape: RoundShape) -> list[Pose]:
    """Poses at several places about the centre, in the camera's own axes."""
    places = [np.zeros(3)]
    for offset in OFFSETS:
        for azimuth in np.arange(6) * np.pi / 3:
            places.append(offset * shape.radius_m * direction_from_angles(azimuth, 0.2))
    return [Pose(np.eye(3), -place) for place in places]


def _with_projectors(
    rig: RigGeometry, hung: Mapping[str, ProjectorPrior], seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with every projector that its cameras see enough of."""
    found = dict(rig.projectors)
    for name, projector in hung.items():
        views = [(c, o) for (c, p), o in seen.items() if p == name and c in rig.cameras]
        if name in found or not views or max(len(o.sigma_px) for _, o in views) < FEWEST:
            continue
        camera, some = max(views, key=lambda view: len(view[1].sigma_px))
        model = rig.cameras[camera]
        points = rig.shape.meet(*camera_rays(model, unproject(some.camera_px, model.lens)))
        good = np.isfinite(points).all(axis=1)
        if good.sum() >= FEWEST:
            fit = _resection if projector.lens == "brown" else _fisheye_resection
            found[name] = fit(projector, points[good], some.projector_px[good])
    return RigGeometry(rig.shape, rig.cameras, found)


def _placed(
    rig: RigGeometry, camera: CameraModel, seen: Mapping[Pair, Observations]
) -> RigGeometry:
    """The rig with one more camera, placed by the projectors it sees."""
    views = [(p, o) for (c, p), o in seen.items() if c == camera.name and p in rig.projectors]
    rays, points = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for name, some in views:
        projector = rig.projectors[name]
        back = projector.projector_from_dome.inverse()
        out = back.rotate(unproject(some.projector_px, projector.lens))
        points.append(rig.shape.meet(np.broadcast_to(back.translation, out.shape), out))
        rays.append(unproject(some.camera_px, camera.lens))
    ray, point = np.concatenate(rays), np.concatenate(points)
    good = np.isfinite(point).all(axis=1)
    if good.sum() < FEWEST:
        raise NotEnoughData(
            f"camera {camera.name}: got {int(good.sum())} patches of projectors that another camera "
            f"sees too, expected {FEWEST} or more; turn it so that the views overlap"
        )
    pose = place_by_rays(ray[good], point[good], rig.shape.radius_m)
    placed = replace(camera, camera_from_dome=pose)
    return RigGeometry(rig.shape, {**rig.cameras, camera.name: placed}, rig.projectors)


def place_by_rays(ray: Array, point: Array, radius_m: float) -> Pose:
    """The pose from which rays (N, 3) of the device point to known points (N, 3) [m].

    Only the place is searched: for each, the best turn is known in closed form (Kabsch).
    """

    def turn(place: Array) -> Array:
        return align_rotation(normalise(point - place), ray)

    def miss(place: Array) -> Array:
        return np.asarray((normalise(point - place) @ turn(place).T - ray).ravel())

    scale = 0.1 * radius_m
    fits = [
        least_squares(miss, place, x_scale=scale, loss="soft_l1", f_scale=0.01, max_nfev=40)
        for place in (np.zeros(3), np.array([0, 0, -0.4 * radius_m]))
    ]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    return Pose(turn(best), -turn(best) @ best)


def _misfit(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """Middle distance [px] between what is seen and what a start predicts; projectors lost count."""
    lost = {p for _, p in seen} - set(rig.projectors)
    middles = [1e3] * len(lost)
    for pair, some in seen.items():
        if pair[0] in rig.cameras and pair[1] in rig.projectors:
            error = np.linalg.norm(residuals(rig, pair, some), axis=1)
            middles.append(float(np.median(np.nan_to_num(error, nan=1e3))))
    return float(np.mean(middles)) if middles else np.inf


def _resection(hung: ProjectorPrior, points: Array, pixels: Array) -> ProjectorModel:
    """A pinhole projector by the direct linear transform (Hartley & Zisserman, s. 7.1)."""
    size = float(np.linalg.norm(points, axis=1).mean())
    scaled = np.c_[points / size, np.ones(len(points))]
    xy = pixels / max(hung.size)
    zero = np.zeros_like(scaled)
    rows = np.r_[np.c_[scaled, zero, -xy[:, :1] * scaled], np.c_[zero, scaled, -xy[:, 1:] * scaled]]
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 4)
    if np.median(scaled @ matrix[2]) < 0:
        matrix = -matrix
    triangle, rotation = rq(matrix[:, :3])
    sign = np.diag(np.where(np.diag(triangle) < 0, -1.0, 1.0))
    triangle, rotation = triangle @ sign, sign @ rotation
    translation = np.linalg.solve(triangle, matrix[:, 3]) * size
    if np.linalg.det(rotation) < 0:
        raise CalibrationError(
            f"projector {hung.name}: its picture arrives mirrored, expected a right-reading one; "
            "switch off rear projection or flip in its menu"
        )
    triangle = triangle / triangle[2, 2] * max(hung.size)
    lens = Lens(
        "brown",
        np.array([triangle[0, 0], triangle[1, 1]]),
        np.array([triangle[0, 2], triangle[1, 2]]),
        np.zeros(5),
    )
    return ProjectorModel(hung.name, hung.size, lens, Pose(rotation, translation))


def _fisheye_resection(hung: ProjectorPrior, points: Array, pixels: Array) -> ProjectorModel:
    """A fisheye projector: place and turn for several focal lengths, the best of them."""
    radius_m = float(np.linalg.norm(points, axis=1).mean())
    centre = (np.array(hung.size) - 1) / 2
    found = []
    for share in WIDE:
        lens = Lens("kannala-brandt", np.full(2, share * min(hung.size)), centre, np.zeros(4))
        pose = place_by_rays(unproject(pixels, lens), points, radius_m)
        miss = np.linalg.norm(project(pose.apply(points), lens) - pixels, axis=1)
        found.append((float(np.median(miss)), lens, pose))
    _, lens, pose = min(found, key=lambda each: each[0])
    return ProjectorModel(hung.name, hung.size, lens, pose)
