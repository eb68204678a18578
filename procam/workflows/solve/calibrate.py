"""From stored captures to a calibration; needs no device and repeats to the last bit."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from procam.estimate.calibration import assemble
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.geometry.apriltags import TagObservations
from procam.estimate.geometry.model import Observations, Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.media_server.camera_pose import PlacedCamera
from procam.estimate.media_server.dome_master import DomeMaster
from procam.files.calibration import save_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import (
    nudges,
    projector_masks,
    protected_mask,
)
from procam.files.versions import calibration_in_use, list_calibrations, next_directory
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.model.screen import Dome
from procam.workflows.capture.decoded import with_decoded_bits
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.capture.session_plan import plan_of, server_of
from procam.workflows.events import Event, Steps
from procam.workflows.main_camera import light_radiometer, screen_view
from procam.workflows.solve.apriltags import detect_tags, tag_marks, tag_notes
from procam.workflows.solve.decode import Decoded, decode_bytes, decode_projector
from procam.workflows.solve.geometry import rig_problem, solve_rig
from procam.workflows.solve.glare import with_bounded_glare
from procam.workflows.solve.light import light_of, server_light_of
from procam.workflows.solve.long_exposure import with_long_exposure
from procam.workflows.solve.measurements import MeasurementsOnDisk
from procam.workflows.solve.media_server import (
    placed_by_server,
    server_figures,
    server_notes,
    server_rig,
)
from procam.workflows.solve.near_veil import with_near_veil
from procam.workflows.solve.plausible import check_calibration, check_on_screen
from procam.workflows.solve.predecessor import compare_with_predecessor
from procam.workflows.solve.provenance import provenance
from procam.workflows.solve.shared_black import with_shared_black
from procam.workflows.solve.side_by_side import side_by_side
from procam.workflows.solve.sight import sight_bytes

SHAPE_FIGURES = ("sphere_variance_ratio", "shape_degree")


@dataclass(frozen=True, slots=True)
class _SolvedRig:
    """A solved rig, and what else of a session its light is read with.

    `found` is what cameras saw of projectors that were decoded; `images` those of the camera that
    was read last; `notes` and `figures` those of the solve.
    """

    geometry: GeometrySolution
    images: SessionImages
    verdict: str
    notes: list[str]
    found: Mapping[Pair, Decoded] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Solved:
    """A new calibration's folder, and lines on what differs from the one that was in use."""

    directory: Path
    compared: list[str]


def solve(venue: Venue, session: Session) -> Steps[Solved]:
    """Decode, solve the geometry, split the light, fit the projectors, write a calibration.

    Geometry from all cameras; light from the one that sees most. Of a media server only the cameras
    are solved. Warnings are in the calibration's provenance as "notes".
    """
    with recorded(venue.directory, "session solve"):
        return (yield from _solve(venue, session))


def _solve(venue: Venue, session: Session) -> Steps[Solved]:
    origin = provenance(venue, session)  # first of all, for it finds what is wrong with masks
    venue = with_decoded_bits(venue, session)
    before = list_calibrations(venue.directory)
    used = calibration_in_use(venue.directory) if before else None
    names, server, tags_seen = list(venue.table.projectors), server_of(venue), len(venue.cameras)
    total = len(names) * (tags_seen + 1) + 3
    rig = yield from (
        _rig_by_server(venue, session, server, total)
        if server
        else _rig_by_codes(venue, session, total)
    )
    yield Event("solve", total - len(names) - 2, total, f"geometry solved; {rig.verdict}")
    geometry = rig.geometry
    images, exposure_notes = with_long_exposure(_of_main(venue, rig))
    geometry, glare_notes = with_bounded_glare(images, geometry)
    images = _with_glare(images, geometry)
    dome = _solved_screen(venue, geometry)
    view = screen_view(venue, dome, images.radiometer)
    beyond_rim = check_on_screen(view, rig.found)
    origin["notes"] = [*rig.notes, *exposure_notes, *glare_notes, *beyond_rim]
    if not server:
        geometry = with_near_veil(dome, images, view, geometry, rig.found)
        images = _with_glare(images, geometry)
        view = replace(view, camera=images.radiometer.camera)
    work = partial(light_of, dome, images, view, geometry, rig.found, projector_masks(venue))
    if server:
        mask = projector_masks(venue)[server.name]
        work = partial(server_light_of, dome, images, view, geometry, (server, mask))
    with MeasurementsOnDisk(venue.directory) as measured:
        for i, (name, measured[name]) in enumerate(
            side_by_side(work, names, sight_bytes(geometry.camera))
        ):
            done = total - len(names) - 1 + i
            yield Event("solve", done, total, f"{name} light split, response fitted")
        falloff = venue.table.blend.falloff_per_rad
        black = with_shared_black(venue, images, view, measured)
        origin["notes"] += black.notes
        calibration = assemble(dome, geometry, view, measured, nudges(venue), origin, falloff)
    if server:  # content is drawn as the server plays it
        calibration = replace(calibration, canvas=server.canvas)
    quality = _quality(calibration, rig) | black.figures(calibration)
    calibration = _noted(replace(calibration, quality=quality))
    yield Event("solve", total - 1, total, "maps assembled")
    directory = next_directory(venue.directory)
    save_calibration(_protecting(venue, calibration), directory)
    lines = compare_with_predecessor(venue.directory, used, directory, calibration)
    yield Event("solve", total, total, f"calibration {directory} written")
    return Solved(directory, lines)


def _noted(calibration: Calibration) -> Calibration:
    """The calibration with what its own picture says of it."""
    known = calibration.provenance
    notes = [*known["notes"], *check_calibration(calibration)]
    return replace(calibration, provenance={**known, "notes": notes})


def _quality(calibration: Calibration, rig: _SolvedRig) -> dict[str, Figure]:
    """Figures of a solve; tags cannot separate a dome's shape from a server's alignment."""
    undetermined = SHAPE_FIGURES if rig.geometry.given else ()
    kept = {n: figure for n, figure in calibration.quality.items() if n not in undetermined}
    return {**kept, **rig.figures}


def _rig_by_codes(venue: Venue, session: Session, total: int) -> Steps[_SolvedRig]:
    """Cameras and projectors, from what cameras decode."""
    plan, cameras = plan_of(venue, session), venue.cameras
    found: dict[Pair, Decoded] = {}
    gathered: dict[Pair, Observations] = {}
    tags_seen: dict[str, TagObservations] = {}
    odd = list[str]()
    for camera in cameras:
        images = SessionImages(session, plan, Radiometer(cameras[camera]))
        tags_seen[camera] = detect_tags(venue, images)
        work = partial(decode_projector, venue, images)
        for name, (seen, patches, lines) in side_by_side(
            work, venue.table.projectors, decode_bytes(cameras[camera])
        ):
            found[camera, name], gathered[camera, name] = seen, patches
            odd += lines
            text = f"{name} decoded, {seen.share:.0%} of what {camera} sees"
            yield Event("solve", len(found), total, text)
    marks = [*venue.fiducials, *tag_marks(venue, tags_seen)]
    geometry, verdict, notes = solve_rig(rig_problem(venue, gathered, marks))
    return _SolvedRig(
        geometry, images, verdict, [*odd, *tag_notes(venue, plan, tags_seen), *notes], found
    )


def _rig_by_server(
    venue: Venue, session: Session, server: DomeMaster, total: int
) -> Steps[_SolvedRig]:
    """Cameras, from the tags that a media server showed."""
    plan, cameras = plan_of(venue, session), venue.cameras
    placed: dict[str, PlacedCamera] = {}
    tags_seen: dict[str, TagObservations] = {}
    for camera in cameras:
        images = SessionImages(session, plan, Radiometer(cameras[camera]))
        tags_seen[camera] = detect_tags(venue, images)
        placed[camera] = placed_by_server(venue, server, camera, images)
        text = f"{camera} placed by {len(placed[camera].tags)} tags"
        yield Event("solve", len(placed), total, text)
    marks = [*venue.fiducials, *tag_marks(venue, tags_seen)]
    geometry = server_rig(venue, server, placed, marks)
    figures = server_figures(placed)
    worst = figures["server_misalignment_rms_arcmin"].value
    notes = [*tag_notes(venue, plan, tags_seen), *server_notes(venue, server, placed)]
    verdict = f"tags are {worst:.1f} arcmin off"
    return _SolvedRig(geometry, images, verdict, notes, figures=figures)


def _of_main(venue: Venue, rig: _SolvedRig) -> SessionImages:
    """The session's images of the main camera, the one that sees most, through its solved lens.

    venue.toml's lens is where the solve started: directions, solid angles and vignetting read with
    it would be wrong by as much as it is.
    """
    images, camera = rig.images, rig.geometry.camera
    stated = venue.cameras[camera.name]  # as its pixels were joined when it was decoded
    return replace(images, radiometer=light_radiometer(camera, stated))


def _with_glare(images: SessionImages, geometry: GeometrySolution) -> SessionImages:
    """The images of the main camera, whose glare is known better now."""
    return replace(images, radiometer=images.radiometer.with_glare(geometry.camera.sensor))


def _solved_screen(venue: Venue, geometry: GeometrySolution) -> Dome:
    shape = geometry.rig.shape
    coefficients = tuple(float(b) for b in shape.harmonic_coefficients)
    return replace(venue.screen, radius_m=shape.radius_m, bumps=coefficients, degree=shape.degree)


def _protecting(venue: Venue, calibration: Calibration) -> Calibration:
    """The calibration with the parts of the dome that a person protects, if there are any."""
    mask, maps = protected_mask(venue, calibration.maps.size), calibration.maps
    protected = mask if mask.covered.any() else None
    return replace(calibration, maps=replace(maps, protected=protected))
