"""A camera's pose from tags that a media server shows at known directions.

The tags are fiducials: a start pose comes from their rays alone, then the bundle adjustment solves
for pose and lens. Rounds alternate between estimating the tags' error from their residuals and
dropping outliers. If too many tags disagree, the message tests other fields of view as the cause.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, Image
from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.geometry.adjustment import (
    Adjustment,
    Intrinsics,
    RigProblem,
    prior_sigmas,
)
from procam.estimate.geometry.apriltags import detect_tags, tag_fiducials, to_8_bit
from procam.estimate.geometry.fiducials import fiducial_point
from procam.estimate.geometry.model import Observations, ParameterLayout, RigGeometry, points_seen
from procam.estimate.geometry.solve import GeometrySolution, by_most_seen
from procam.estimate.geometry.start import resect_by_rays
from procam.estimate.media_server.dome_master import DomeMaster
from procam.estimate.media_server.tags import FAMILY, TAG_PICTURES, MasterTag, master_tags
from procam.maths.codes.april_tags import find_tags
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import ARCMIN, angle_between, direction_from_angles, normalise
from procam.maths.statistics import robust_sigma_2d
from procam.model.optics import CameraModel, Fiducial

MIN_TAGS = 6  # three determine a pose, but do not reveal errors of the server
MOST_ARCMIN = 15.0  # rms error of tags; an aligned server is better
HOPELESS_ARCMIN = 300.0  # median error of tags, larger than a guessed lens causes
ALIGNED_ARCMIN = 2.0  # assumed error of tags at first
OUTLIER_SIGMAS = 6.0
MOST_DROPPED = 1 / 3  # of the tags
ROUNDS = 3  # of estimating the tags' error and dropping outliers
STRETCHES = np.linspace(0.6, 1.5, 31)  # of the field of view, tried if tags do not fit
TRIED_TAGS = 20  # tags, for that
BETTER = 0.3  # share to which another field of view must reduce the error
MOST_ROTATION = np.radians(2.0)  # of the server's picture against fiducials on the dome


@dataclass(frozen=True, slots=True)
class PlacedCamera:
    """A camera with its pose from tags.

    Attributes
    ----------
    covariance : (P, P) of screen and camera, in the order of `ParameterLayout`.
    tags : those that agree.
    error_arcmin : (T,) between their known and observed directions, with the server's misalignment.
    dropped : names of the outliers.
    """

    camera: CameraModel
    covariance: Array
    tags: Sequence[Fiducial]
    error_arcmin: Array
    dropped: Sequence[str]

    @property
    def rms_arcmin(self) -> float:
        """Root mean square of the tags' errors [arcmin]."""
        return float(np.sqrt(np.mean(self.error_arcmin**2)))


def find_master_tags(
    camera: CameraModel, master: DomeMaster, pictures: Sequence[Image]
) -> list[Fiducial]:
    """Fiducials from the tags that a camera sees in the server's tag pictures (H, W) [DN], in order.

    Raises
    ------
    NotEnoughData
        If there are fewer than `MIN_TAGS`; the message names mirrored tags as the cause.
    """
    sigma = ALIGNED_ARCMIN / ARCMIN
    found: list[Fiducial] = []
    for number in range(TAG_PICTURES):
        tags = [t.on_dome(master.model, sigma) for t in _tags(master, number)]
        seen = detect_tags([pictures[number]], camera.lens, tags)
        marks = tag_fiducials(tags, {camera.name: seen}, {camera.name: camera})
        found += [replace(m, name=f"{m.name}, picture {number + 1}") for m in marks]
    if len(found) < MIN_TAGS:
        raise NotEnoughData(_too_few(camera.name, master, pictures, len(found)))
    return found


def place_camera(
    camera: CameraModel, intrinsics: Intrinsics, radius_m: float, tags: Sequence[Fiducial]
) -> PlacedCamera:
    """The camera's pose and, unless `intrinsics` fixes it, its lens, by least squares.

    Outliers are dropped. The tags' errors are taken as independent although a server's errors are
    similar for neighbours, so the covariance is a little too small.

    Raises
    ------
    CalibrationError
        If the tags do not fit an aligned dome; with the field of view that would fit, if there is one.
    """
    shape = RoundShape(radius_m)
    known = np.array([direction_from_angles(t.azimuth or 0.0, t.elevation or 0.0) for t in tags])
    placed = _started(camera, shape, known, np.array([t.pixel for t in tags]))
    for _ in range(ROUNDS):
        error = _errors(placed, shape, tags, known)
        good = error < OUTLIER_SIGMAS * max(robust_sigma_2d(error), ALIGNED_ARCMIN)
        agree = good.sum() >= max(MIN_TAGS, (1 - MOST_DROPPED) * len(tags))
        if not agree or np.median(error) > HOPELESS_ARCMIN:
            raise CalibrationError(_misfit(camera, shape, tags, known, error))
        sigma = float(np.sqrt(np.mean(error[good] ** 2) / 2)) / ARCMIN  # two components
        kept = [
            replace(t, sigma=max(sigma, 1e-6)) for t, use in zip(tags, good, strict=True) if use
        ]
        placed, covariance = _adjusted(placed, intrinsics, shape, kept)
    error = _errors(placed, shape, kept, known[good])
    dropped = [tag.name for tag, use in zip(tags, good, strict=True) if not use]
    found = PlacedCamera(placed, covariance, kept, error, dropped)
    if not found.rms_arcmin <= MOST_ARCMIN:
        raise CalibrationError(_misfit(camera, shape, kept, known[good], error))
    return found


def server_geometry(
    master: DomeMaster, radius_m: float, placed: Mapping[str, PlacedCamera]
) -> GeometrySolution:
    """The solution for cameras with poses and a server whose directions are known."""
    model, shape = master.model, RoundShape(radius_m)
    cameras = {name: each.camera for name, each in placed.items()}
    rig = RigGeometry(shape, cameras, {master.name: model})
    layout = ParameterLayout.of(rig)
    covariance = np.zeros((layout.count, layout.count))
    seen, residual_px, scale = {}, {}, {}
    for name, each in placed.items():
        alone = ParameterLayout.of(RigGeometry(shape, {name: each.camera}, {})).cameras[name]
        covariance[layout.cameras[name], layout.cameras[name]] = each.covariance[alone, alone]
        pixels = np.array([t.pixel for t in each.tags])
        arcmin_per_px = master.fov * ARCMIN / master.size
        sigma = np.full(len(pixels), each.rms_arcmin / arcmin_per_px / np.sqrt(2))
        shown = [_master_pixel(master, t) for t in each.tags]
        points = points_seen(rig, name, pixels)
        predicted = project(model.projector_from_dome.apply(points), model.lens)
        pair = (name, master.name)
        seen[pair] = Observations(pixels, np.array(shown), sigma)
        residual_px[pair], scale[pair] = predicted - seen[pair].projector_px, 1.0
    worst = max(each.rms_arcmin for each in placed.values())
    freedoms = np.zeros((0, layout.count))
    given = {master.name: worst}
    main = by_most_seen(cameras, seen)[0]
    return GeometrySolution(rig, covariance, seen, residual_px, scale, freedoms, 1.0, main, given)


def check_rotation(
    geometry: GeometrySolution, master: DomeMaster, marks: Sequence[Fiducial]
) -> None:
    """Refuse a server whose picture is rotated about the pole against fiducials on the dome.

    The server's own tags rotate with its picture and do not reveal that.
    """
    marks = [m for m in marks if m.device in geometry.rig.cameras and m.azimuth is not None]
    if not marks:
        return
    seen = normalise(np.array([fiducial_point(geometry.rig, m) for m in marks]))
    known = np.array([m.azimuth for m in marks], float)
    turns = known - np.arctan2(seen[:, 1], seen[:, 0])
    mean = float(np.angle(np.exp(1j * turns).mean()))
    if abs(mean) > MOST_ROTATION:
        wanted = (np.degrees(master.rotation + mean) + 180) % 360 - 180
        raise CalibrationError(
            f"projector {master.name}: its picture is rotated by {np.degrees(mean):.0f} degrees against "
            f"{', '.join(m.name for m in marks)}, with rotation_deg = {np.degrees(master.rotation):g}. "
            f"Set rotation_deg = {wanted:.0f}, or turn the picture at the server."
        )


def _tags(master: DomeMaster, picture: int) -> list[MasterTag]:
    return master_tags(master.size, master.fov, picture)


def _started(camera: CameraModel, shape: RoundShape, known: Array, pixels: Array) -> CameraModel:
    pose = resect_by_rays(unproject(pixels, camera.lens), shape.radius_m * known, shape.radius_m)
    return replace(camera, camera_from_dome=pose)


def _adjusted(
    camera: CameraModel, intrinsics: Intrinsics, shape: RoundShape, tags: Sequence[Fiducial]
) -> tuple[CameraModel, Array]:
    """The camera by least squares over tags, and the covariance (P, P) of screen and camera."""
    problem = RigProblem(
        shape, {camera.name: camera}, {}, {}, {camera.name: intrinsics}, tags, radius_known=True
    )
    rig = RigGeometry(shape, {camera.name: camera}, {})
    adjustment = Adjustment(problem, {}, prior_sigmas(problem, rig))
    rig = adjustment.solve(rig, robust=False)
    return rig.cameras[camera.name], adjustment.uncertainty(rig)[0]


def _errors(
    camera: CameraModel, shape: RoundShape, tags: Sequence[Fiducial], known: Array
) -> Array:
    """Angles (T,) [arcmin] between known directions (T, 3) and observed ones."""
    rig = RigGeometry(shape, {camera.name: camera}, {})
    seen = normalise(points_seen(rig, camera.name, np.array([t.pixel for t in tags])))
    return np.nan_to_num(angle_between(seen, known) * ARCMIN, nan=np.inf)


def _master_pixel(master: DomeMaster, tag: Fiducial) -> Array:
    direction = direction_from_angles(tag.azimuth or 0.0, tag.elevation or 0.0)
    model = master.model
    return project(model.projector_from_dome.rotate(direction), model.lens)


def _too_few(name: str, master: DomeMaster, pictures: Sequence[Image], count: int) -> str:
    """The message on a camera that sees too few tags."""
    total = sum(len(_tags(master, number)) for number in range(TAG_PICTURES))
    flipped = (np.ascontiguousarray(picture[:, ::-1]) for picture in pictures)
    mirrored = sum(len(find_tags(to_8_bit(picture), FAMILY)) for picture in flipped)
    if mirrored >= MIN_TAGS:
        return (
            f"projector {master.name}: camera {name} reads {mirrored} tags in a mirror and {count} as they "
            "are. Switch off the server's flip, or the photographs' mirroring."
        )
    return (
        f"projector {master.name}: camera {name} finds {count} of {total} tags, and {MIN_TAGS} or more, "
        "spread over the dome, are needed. Check focus and exposure, that the camera sees the dome with 5 "
        "pixels per degree, and that the server shows the whole master."
    )


def _misfit(
    camera: CameraModel, shape: RoundShape, tags: Sequence[Fiducial], known: Array, error: Array
) -> str:
    """The message on tags that do not fit, with the field of view that would fit, if one does."""
    median, every = float(np.median(error)), max(1, len(tags) // TRIED_TAGS)
    some, places = tags[::every], known[::every]

    def error_with(stretch: float) -> float:
        stretched = _stretched(places, stretch)
        placed = _started(camera, shape, stretched, np.array([t.pixel for t in some]))
        return float(np.median(_errors(placed, shape, some, stretched)))

    each = [error_with(float(stretch)) for stretch in STRETCHES]
    best = int(np.argmin(each))
    found = (
        f"camera {camera.name}: tags are {median:.0f} arcmin from where the server should show them, more "
        f"than {MOST_ARCMIN:g}. "
    )
    if each[best] < BETTER * median:
        return found + (
            f"They would be {each[best]:.0f} off if the master spanned {STRETCHES[best]:.2f} times the "
            "angle: correct the projector's fov_deg, or the camera's f."
        )
    return found + (
        "Check that the server's picture is an equidistant dome master, warped and blended as in the "
        "show, and that the camera's lens and the pictures' order are right."
    )


def _stretched(direction: Array, stretch: float) -> Array:
    """Directions (N, 3) with their angles from the pole multiplied by `stretch`."""
    horizontal = np.hypot(direction[:, 0], direction[:, 1])
    theta = stretch * np.arctan2(horizontal, direction[:, 2])
    flat = direction[:, :2] / np.maximum(horizontal, 1e-12)[:, None]
    return np.c_[flat * np.sin(theta)[:, None], np.cos(theta)]
