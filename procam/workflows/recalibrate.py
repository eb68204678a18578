"""Recalibrates some projectors: only they are photographed, and all else of the calibration stays."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Image
from procam.errors import InputError, OutOfModelRange
from procam.estimate.calibration import direct_black
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.drift.finding import Cause
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.known_rig import solve_projectors
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.screen_points import round_shape
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.recalibration import with_projector
from procam.files.calibration import load_calibration, save_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import MASTER_SIZE, camera_masks, nudges, projector_masks, screen_mask
from procam.files.versions import next_directory, use_calibration
from procam.maths.geometry.sphere import master_pixels
from procam.model.calibration import Calibration
from procam.model.correspondence import CorrespondenceMap
from procam.workflows.capture.capture import capture
from procam.workflows.capture.newest import next_session
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.capture.session_plan import server_of
from procam.workflows.events import Event
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.photographs.open import is_by_hand, refuse_mixed
from procam.workflows.solve.calibrate import decode_projector
from procam.workflows.solve.geometry import rig_problem
from procam.workflows.solve.light import measure_light
from procam.workflows.solve.long_exposure import with_long_exposure
from procam.workflows.solve.provenance import provenance
from procam.workflows.venue_rig import open_rig
from procam.workflows.verify.verify import SETTLE_S, Verified, verify

WATCHED = 2  # projectors that are verified where others are to be recalibrated
WORSE, LEAST_RESIDUAL_PX = 3.0, 0.05
# causes that new photographs of a projector make up for; others want a hand first
HELPED: tuple[Cause, ...] = ("moved", "light", "colour", "gamma setting", "black level")
BLOCKING: tuple[Cause, ...] = (
    "camera moved",
    "camera exposure",
    "camera focus",
    "ambient light",
    "warming up",
)


def recalibrate(venue: Venue, used: Path, names: Sequence[str] = ()) -> Iterator[Event]:
    """Photograph some projectors and put them into the calibration `used`.

    Without `names` the whole venue is verified first, and those are chosen that recalibrating helps. With
    names only two others are verified, for the camera and the room's light must be as they were. The last
    event carries the new directory as `data["calibration"]`, None if nothing had to be done, and
    `data["notes"]`. The new session has the photographs of all other projectors too, as links, so that it
    can be verified against and solved as a whole.

    Raises
    ------
    InputError
        For names that the venue does not have, and for a media server, whose warp is not procam's.
    CalibrationError
        The camera or the room is not as it was, or the photographs do not determine a projector; nothing is
        written.
    """
    old = load_calibration(used)
    _check(venue, old, names)
    with recorded(venue.directory, "recalibrate") as run, open_rig(venue) as rig:
        photographer = DrivenPhotographer(rig, old, SETTLE_S)
        watched = [n for n in old.projectors if n not in names][:WATCHED] if names else []
        verified: Verified | None = None
        for event in verify(photographer, venue, old, watched):
            verified = event.data.get("verified")
            yield event
        assert verified is not None
        chosen, notes = _chosen(verified, names)
        run.message = f"{', '.join(chosen) or 'nothing'} recalibrated"
        if not chosen:
            yield Event(
                "solve",
                1,
                1,
                "nothing to recalibrate",
                {"calibration": None, "projectors": [], "notes": notes},
            )
            return
        source = Session(venue.directory / "sessions" / str(old.provenance.get("session")))
        session = source.without(next_session(venue), chosen)
        yield from capture(rig, venue, session)
        yield from _solved(venue, (used, old), (source, session), chosen, notes)


def _solved(
    venue: Venue,
    before: tuple[Path, Calibration],
    sessions: tuple[Session, Session],
    names: Sequence[str],
    notes: Sequence[str],
) -> Iterator[Event]:
    """Solve projectors from the new session, and write the calibration; it is used unless it is worse."""
    (used, old), (source, session), total = before, sessions, len(names) + 1
    calibration, worse = old, list[str]()
    for done, name in enumerate(names, start=1):
        calibration, residual_px = _with(venue, source, session, calibration, name)
        worse += _worse(old, name, residual_px)
        yield Event("solve", done, total, f"{name} solved, residual {residual_px:.3f} px")
    directory = next_directory(venue.directory)
    save_calibration(calibration, directory)
    use_calibration(venue.directory, used if worse else directory)
    data = {
        "calibration": str(directory),
        "session": str(session.directory),
        "projectors": list(names),
        "notes": [*notes, *worse],
    }
    yield Event("solve", total, total, f"{directory} written", data)


def _worse(old: Calibration, name: str, residual_px: float) -> list[str]:
    """A note if a projector fits much worse than the rig did."""
    before = old.quality.get("geometry_residual_rms_px")
    limit = WORSE * (float(before.value) if before and isinstance(before.value, float) else 0.0)
    if residual_px <= max(limit, LEAST_RESIDUAL_PX):
        return []
    return [
        f"{name} fits by {residual_px:.2f} px, and the calibration before by {limit / WORSE:.2f}, which "
        "stays in use. Did something move while it was photographed? Recalibrate again"
    ]


def _chosen(verified: Verified, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Projectors to recalibrate, and what else was found, a line each.

    Raises
    ------
    OutOfModelRange
        The camera or the room is not as it was.
    """
    for each in verified.findings:
        if each.cause in BLOCKING:
            raise OutOfModelRange(
                f"{each.subject or 'venue'}: {each.cause}: {each.text}. Single projectors are photographed "
                f"by the camera where it stood, in the same light: {each.advice}; else run procam calibrate"
            )
    helped = [each.subject for each in verified.findings if each.cause in HELPED]
    notes = [
        f"{each.subject or 'venue'}: {each.cause}: {each.text}; {each.advice}"
        for each in verified.findings
        if each.cause not in HELPED or (names and each.subject not in names)
    ]
    return (list(names) or list(dict.fromkeys(helped))), notes


def _check(venue: Venue, calibration: Calibration, names: Sequence[str]) -> None:
    if server_of(venue):
        raise InputError(
            f"{venue.directory}: its projectors are behind a media server, which aligns them; align them "
            "there, then calibrate again"
        )
    refuse_mixed(venue)
    if is_by_hand(venue):
        raise InputError(
            f"{venue.directory}: people drive its devices, and single projectors are recalibrated by devices "
            "alone; photograph a whole session (`procam patterns`)"
        )
    unknown = [name for name in names if name not in calibration.projectors]
    if unknown:
        raise InputError(
            f"--projector {unknown[0]}: there is none of this name; choose from "
            f"{', '.join(calibration.projectors)}"
        )


def _with(
    venue: Venue, source: Session, session: Session, old: Calibration, name: str
) -> tuple[Calibration, float]:
    """The calibration with one projector solved from a session, and the rms residual of its geometry [px].

    `source` is the session of the calibration.
    """
    images = _images(session, old)
    found, geometry = _placed(venue, images, old, name)
    view = _view(venue, old, images)
    masks = projector_masks(venue)
    main = {(geometry.main, name): found}
    measured = measure_light(old.screen, images, view, geometry, main, masks, name)
    before = _black_before(venue, _images(source, old), old, view, name)
    origin: dict[str, Any] = {
        **provenance(venue, session),
        "notes": [*measured.notes],
        "recalibrated": [*old.provenance.get("recalibrated", []), name],
    }
    new = with_projector(old, name, geometry, measured, before, nudges(venue), origin)
    return new, float(np.sqrt(np.mean(geometry.residual_px[geometry.main, name] ** 2)))


def _images(session: Session, calibration: Calibration) -> SessionImages:
    """A session by the camera that a calibration's light was measured with, where it stands."""
    camera = next(iter(calibration.cameras.values()))
    images, _ = with_long_exposure(SessionImages(session, session.read_plan(), Radiometer(camera)))
    return images


def _placed(
    venue: Venue, images: SessionImages, calibration: Calibration, name: str
) -> tuple[CorrespondenceMap, GeometrySolution]:
    """What the main camera sees of a projector, and the rig with that projector solved."""
    seen, gathered = {}, {}
    for camera in calibration.cameras.values():
        own = SessionImages(images.session, images.plan, Radiometer(camera))
        seen[camera.name], gathered[camera.name, name], _ = decode_projector(venue, own, name)
    known = RigGeometry(
        round_shape(calibration.screen),
        calibration.cameras,
        {n: p.model for n, p in calibration.projectors.items()},
    )
    solved = solve_projectors(rig_problem(venue, gathered, ()), known, [name])
    return seen[solved.main], solved


def _view(venue: Venue, calibration: Calibration, images: SessionImages) -> DomeView:
    """What the main camera sees of the screen, without what a person has masked."""
    radiometer = images.radiometer
    seen = radiometer.seen & ~camera_masks(venue)[radiometer.camera.name].covered
    view = DomeView.of(radiometer.camera, calibration.screen, radiometer.rays, seen)
    places = master_pixels(np.nan_to_num(view.direction), MASTER_SIZE)
    return view.without(screen_mask(venue, MASTER_SIZE).at(places))


def _black_before(
    venue: Venue, images: SessionImages, calibration: Calibration, view: DomeView, name: str
) -> Image:
    """Direct radiance (H, W, 3) of a projector's black in the session of the calibration."""
    found, geometry = _placed(venue, images, calibration, name)
    main = {(geometry.main, name): found}
    masks = projector_masks(venue)
    return direct_black(
        measure_light(calibration.screen, images, view, geometry, main, masks, name)
    )
