"""Where a camera stands, told by tags that a media server shows at known directions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.boards.targets import find_tags
from procam.estimate.geometry.adjustment import (
    Adjustment,
    Intrinsics,
    RigProblem,
    prior_of,
    robust_sigma,
)
from procam.estimate.geometry.apriltags import detect_tags, tag_fiducials, toned
from procam.estimate.geometry.fiducials import seen_point
from procam.estimate.geometry.model import Observations, ParameterLayout, RigGeometry, points_seen
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.geometry.start import place_by_rays
from procam.estimate.media_server.dome_master import DomeMaster
from procam.estimate.media_server.tags import FAMILY, TAG_PICTURES, MasterTag, master_tags
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import angle_between, direction_from_angles, normalise
from procam.model.optics import CameraModel, Fiducial

Array = NDArray[np.float64]
Image = NDArray[np.float32]
FEWEST = 6  # tags; three would do, but would not show that the server is wrong
MOST_ARCMIN = 15.0  # of tags' errors: no server that is aligned is so far off
HOPELESS_ARCMIN = 300.0  # no lens that was a guess is so far off
ALIGNED_ARCMIN = 2.0  # a good server's error, before it is known
OUTLIER_SIGMAS = 6.0
MOST_LOST = 1 / 3  # of the tags, that the others may outvote
ROUNDS = 3  # each with the errors that the one before has left, and without what is far off
STRETCHES = np.linspace(0.6, 1.5, 31)  # of the field of view, tried where tags do not fit
SOME = 20  # tags, for that
BETTER = 0.3  # of the error, at most, that another explanation must leave
TURNED = np.radians(2.0)  # of a server's dome against the marks on it
ARCMIN = np.degrees(1) * 60


@dataclass(frozen=True, slots=True)
class PlacedCamera:
    """A camera placed by tags.

    Attributes
    ----------
    covariance : (P, P) of screen and camera, in the order of `ParameterLayout`.
    tags : those that agree. error_arcmin : (T,) between where they are and where they are seen; it
        holds the server's own misalignment.
    dropped : names of tags that the others outvote.
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
    """Marks by the tags that a camera sees in the pictures (H, W) [DN] of tags, in their order.

    Raises
    ------
    NotEnoughData
        If there are fewer than 6; says so if they are there as a mirror shows them.
    """
    sigma = ALIGNED_ARCMIN / ARCMIN
    found: list[Fiducial] = []
    for number in range(TAG_PICTURES):
        tags = [t.on_dome(master.model, sigma) for t in _tags(master, number)]
        look = detect_tags([pictures[number]], camera.lens, tags)
        marks = tag_fiducials(tags, {camera.name: look}, {camera.name: camera})
        found += [replace(m, name=f"{m.name}, picture {number + 1}") for m in marks]
    if len(found) < FEWEST:
        raise NotEnoughData(_too_few(camera.name, master, pictures, len(found)))
    return found


def place_camera(
    camera: CameraModel, intrinsics: Intrinsics, radius_m: float, tags: Sequence[Fiducial]
) -> PlacedCamera:
    """The camera's pose, and its lens as far as `intrinsics` leaves it free, by least squares.

    Tags that the others outvote are dropped. Their errors count as independent, though a server's
    are alike for neighbours: the covariance is a little too small.

    Raises
    ------
    CalibrationError
        If the tags do not fit an aligned dome; with what would make them fit, if that is found.
    """
    shape = RoundShape(radius_m)
    known = np.array([direction_from_angles(t.azimuth or 0.0, t.elevation or 0.0) for t in tags])
    placed = _started(camera, shape, known, np.array([t.pixel for t in tags]))
    for _ in range(ROUNDS):
        error = _errors(placed, shape, tags, known)
        good = error < OUTLIER_SIGMAS * max(robust_sigma(error), ALIGNED_ARCMIN)
        agree = good.sum() >= max(FEWEST, (1 - MOST_LOST) * len(tags))
        if not agree or np.median(error) > HOPELESS_ARCMIN:
            raise CalibrationError(_misfit(camera, shape, tags, known, error))
        sigma = float(np.sqrt(np.mean(error[good] ** 2) / 2)) / ARCMIN  # a direction errs two ways
        kept = [
            replace(t, sigma=max(sigma, 1e-6)) for t, use in zip(tags, good, strict=True) if use
        ]
        placed, covariance = _adjusted(placed, intrinsics, shape, kept)
    left = _errors(placed, shape, kept, known[good])
    found = PlacedCamera(placed, covariance, kept, left, _names(tags, ~good))
    if not found.rms_arcmin <= MOST_ARCMIN:
        raise CalibrationError(_misfit(camera, shape, kept, known[good], left))
    return found


def server_geometry(
    master: DomeMaster, radius_m: float, placed: Mapping[str, PlacedCamera]
) -> GeometrySolution:
    """The rig of placed cameras and a server whose directions are known, as the solver gives rigs."""
    model, shape = master.model, RoundShape(radius_m)
    cameras = {name: each.camera for name, each in placed.items()}
    rig = RigGeometry(shape, cameras, {master.name: model})
    layout = ParameterLayout.of(rig)
    covariance = np.zeros((layout.count, layout.count))
    seen, left, scale = {}, {}, {}
    for name, each in placed.items():
        alone = ParameterLayout.of(RigGeometry(shape, {name: each.camera}, {})).cameras[name]
        covariance[layout.cameras[name], layout.cameras[name]] = each.covariance[alone, alone]
        pixels = np.array([t.pixel for t in each.tags])
        arcmin_per_px = master.fov * ARCMIN / master.size
        sigma = np.full(len(pixels), each.rms_arcmin / arcmin_per_px / np.sqrt(2))
        shown = [_master_pixel(master, t) for t in each.tags]
        landed = points_seen(rig, name, pixels)
        meant = project(model.projector_from_dome.apply(landed), model.lens)
        pair = (name, master.name)
        seen[pair] = Observations(pixels, np.array(shown), sigma)
        left[pair], scale[pair] = meant - seen[pair].projector_px, 1.0
    worst = max(each.rms_arcmin for each in placed.values())
    freedoms = np.zeros((0, layout.count))
    given = {master.name: worst}
    return GeometrySolution(rig, covariance, seen, left, scale, freedoms, 1.0, given)


def check_turn(geometry: GeometrySolution, master: DomeMaster, marks: Sequence[Fiducial]) -> None:
    """Complain if marks on the dome say that the server shows it turned about the pole.

    Tags that a server shows cannot tell: turned with it, they look the same.
    """
    marks = [m for m in marks if m.device in geometry.rig.cameras and m.azimuth is not None]
    if not marks:
        return
    seen = normalise(np.array([seen_point(geometry.rig, m) for m in marks]))
    turns = []
    for mark, place in zip(marks, seen, strict=True):
        turns.append((mark.azimuth or 0.0) - float(np.arctan2(place[1], place[0])))
    middle = float(np.angle(np.exp(1j * np.array(turns)).mean()))
    if abs(middle) > TURNED:
        wanted = np.degrees(master.rotation + middle)
        wanted = (wanted + 180) % 360 - 180
        raise CalibrationError(
            f"projector {master.name}: got a picture that is turned by {np.degrees(middle):.0f} degrees "
            f"against {', '.join(m.name for m in marks)}, expected its bottom edge at azimuth "
            f"{np.degrees(master.rotation):g}; set rotation_deg = {wanted:.0f}, or turn it at the server"
        )


def _tags(master: DomeMaster, picture: int) -> list[MasterTag]:
    return master_tags(master.size, master.fov, picture)


def _started(camera: CameraModel, shape: RoundShape, known: Array, pixels: Array) -> CameraModel:
    pose = place_by_rays(unproject(pixels, camera.lens), shape.radius_m * known, shape.radius_m)
    return replace(camera, camera_from_dome=pose)


def _adjusted(
    camera: CameraModel, intrinsics: Intrinsics, shape: RoundShape, tags: Sequence[Fiducial]
) -> tuple[CameraModel, Array]:
    """The camera by least squares over tags, and the covariance (P, P) of screen and camera."""
    problem = RigProblem(
        shape, {camera.name: camera}, {}, {}, {camera.name: intrinsics}, tags, radius_known=True
    )
    rig = RigGeometry(shape, {camera.name: camera}, {})
    adjustment = Adjustment(problem, {}, prior_of(problem, rig))
    rig = adjustment.solve(rig, robust=False)
    return rig.cameras[camera.name], adjustment.certainty(rig)[0]


def _names(tags: Sequence[Fiducial], which: NDArray[np.bool_]) -> list[str]:
    return [tag.name for tag, named in zip(tags, which, strict=True) if named]


def _errors(
    camera: CameraModel, shape: RoundShape, tags: Sequence[Fiducial], known: Array
) -> Array:
    """Angles (T,) [arcmin] from the dome's centre between known places (T, 3) and those seen."""
    rig = RigGeometry(shape, {camera.name: camera}, {})
    seen = normalise(points_seen(rig, camera.name, np.array([t.pixel for t in tags])))
    return np.nan_to_num(angle_between(seen, known) * ARCMIN, nan=np.inf)


def _master_pixel(master: DomeMaster, tag: Fiducial) -> Array:
    direction = direction_from_angles(tag.azimuth or 0.0, tag.elevation or 0.0)
    model = master.model
    return project(model.projector_from_dome.rotate(direction), model.lens)


def _too_few(name: str, master: DomeMaster, pictures: Sequence[Image], count: int) -> str:
    """What to say of a camera that sees too few tags."""
    total = sum(len(_tags(master, number)) for number in range(TAG_PICTURES))
    flipped = (np.ascontiguousarray(picture[:, ::-1]) for picture in pictures)
    mirrored = sum(len(find_tags(toned(picture), FAMILY)) for picture in flipped)
    if mirrored >= FEWEST:
        return (
            f"projector {master.name}: camera {name} reads {mirrored} tags in a mirror and {count} as they "
            "are, expected them as they are; switch off the server's flip, or the photographs' mirroring"
        )
    return (
        f"projector {master.name}: camera {name} finds {count} of {total} tags, expected "
        f"{FEWEST} or more, spread over the dome; is the lens in focus, is the exposure right, does the "
        "camera see the dome with 5 pixels per degree, and does the server show the whole master?"
    )


def _misfit(
    camera: CameraModel, shape: RoundShape, tags: Sequence[Fiducial], known: Array, error: Array
) -> str:
    """What to say of tags that do not fit, with the cure if one is found."""
    middle, every = float(np.median(error)), max(1, len(tags) // SOME)
    some, places = tags[::every], known[::every]

    def left(stretch: float) -> float:
        stretched = _stretched(places, stretch)
        placed = _started(camera, shape, stretched, np.array([t.pixel for t in some]))
        return float(np.median(_errors(placed, shape, some, stretched)))

    each = [left(float(stretch)) for stretch in STRETCHES]
    best = int(np.argmin(each))
    told = (
        f"camera {camera.name}: got tags {middle:.0f} arcmin from where the server should show them, "
        f"expected {MOST_ARCMIN:g} at most; "
    )
    if each[best] < BETTER * middle:
        return told + (
            f"they would be {each[best]:.0f} off if the master spanned {STRETCHES[best]:.2f} times the "
            "angle: correct the projector's fov_deg, or the camera's f"
        )
    return told + (
        "is the server's picture an equidistant dome master, warped and blended as in the show, and are "
        "the camera's lens and the pictures' order right?"
    )


def _stretched(direction: Array, stretch: float) -> Array:
    """Directions (N, 3) whose angles from the pole are so many times as large."""
    horizontal = np.hypot(direction[:, 0], direction[:, 1])
    theta = stretch * np.arctan2(horizontal, direction[:, 2])
    flat = direction[:, :2] / np.maximum(horizontal, 1e-12)[:, None]
    return np.c_[flat * np.sin(theta)[:, None], np.cos(theta)]
