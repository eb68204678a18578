"""Recalibrates some projectors: only they are photographed, and all else of the calibration stays."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procam.devices.rig import Rig
from procam.errors import InputError, OutOfModelRange
from procam.estimate.calibration import ProjectorMeasurement, direct_black
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.drift.finding import Cause
from procam.estimate.geometry.known_rig import solve_projectors
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.screen_points import round_shape
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.recalibration import with_projector
from procam.files.calibration import load_calibration, save_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import nudges, projector_masks
from procam.files.versions import next_directory, use_calibration
from procam.model.calibration import Calibration
from procam.workflows.capture.capture import capture
from procam.workflows.capture.newest import next_session
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.capture.session_plan import server_of
from procam.workflows.events import Event
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.photographs.open import is_by_hand, refuse_mixed
from procam.workflows.solve.calibrate import decode_projector, screen_view
from procam.workflows.solve.direct_light import Decoded
from procam.workflows.solve.geometry import rig_problem
from procam.workflows.solve.light import measure_light
from procam.workflows.solve.long_exposure import with_long_exposure
from procam.workflows.solve.plausible import check_finite, check_on_screen
from procam.workflows.solve.provenance import provenance
from procam.workflows.verify.verify import SETTLE_S, Verified, verify

WATCHED = 2  # projectors that are verified where others are to be recalibrated
WORSE, LEAST_RESIDUAL_PX = 3.0, 0.05
MOST_LOST = 0.1  # of the lit share of a panel: a projector that is nudged by degrees keeps more
STAYS = "the calibration before stays in use; put that right, and recalibrate again"
REFINED = (
    "the calibration was refined, and what that corrected in the gains of these projectors is not in their "
    "new ones: refine again (procam refine)"
)
# a number of a note, and not of a device's name
_NUMBER = re.compile(
    r"(?<![\w.-])(?<!projector )(?<!camera )[+-]?(\d+(?:\.\d+)?)(?:e[+-]?\d+)?(%?)"
)
MUCH_MORE, LEAST_MORE = 2.0, 1.0  # times a percentage of before, and percent beyond that
# causes that new photographs of a projector make up for; others want a hand first
HELPED: tuple[Cause, ...] = ("moved", "light", "colour", "gamma setting", "black level")
BLOCKING: tuple[Cause, ...] = (
    "camera moved",
    "camera exposure",
    "camera focus",
    "banding",
    "ambient light",
    "warming up",
)


def recalibrate(
    rig: Callable[[], Rig], venue: Venue, used: Path, names: Sequence[str] = ()
) -> Iterator[Event]:
    """Photograph some projectors with a rig and put them into the calibration `used`.

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
    with recorded(venue.directory, "recalibrate") as run:
        photographer = DrivenPhotographer(rig(), old, SETTLE_S)
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
        yield from capture(rig(), venue, session)
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
        repaired = _repaired(venue, source, session, calibration, name)
        calibration = repaired.calibration
        worse += [*_new_notes(old, repaired.notes), *_worse(old, repaired, name)]
        text = f"{name} solved, residual {repaired.residual_px:.3f} px"
        yield Event("solve", done, total, text)
    check_finite(calibration)
    directory = next_directory(venue.directory)
    save_calibration(calibration, directory)
    use_calibration(venue.directory, used if worse else directory)
    refined = [REFINED] if "loop_iterations" in old.quality else []
    data = {
        "calibration": str(directory),
        "session": str(session.directory),
        "projectors": list(names),
        "notes": [*notes, *worse, *([STAYS] if worse else refined)],
    }
    yield Event("solve", total, total, f"{directory} written", data)


def _new_notes(old: Calibration, notes: Sequence[str]) -> list[str]:
    """Notes of new photographs that the calibration did not have, or with much smaller percentages.

    Each says that a figure is wrong or may be, and the calibration that is to be repaired is not.
    """
    known = [str(note) for note in old.provenance.get("notes", ())]
    return [note for note in notes if not any(_is_known(note, each) for each in known)]


def _is_known(note: str, before: str) -> bool:
    """Whether a note says what one before said, of the same device and of no much larger share."""
    if _NUMBER.sub("", note) != _NUMBER.sub("", before):
        return False
    both = zip(_NUMBER.findall(note), _NUMBER.findall(before), strict=True)
    return all(
        float(now) <= MUCH_MORE * float(then) + LEAST_MORE
        for (now, percent), (then, _) in both
        if percent
    )


def _worse(old: Calibration, repaired: "_Repaired", name: str) -> list[str]:
    """Notes if a projector fits much worse than the rig did, or covers much less than before."""
    notes = list[str]()
    before = old.quality.get("geometry_residual_rms_px")
    limit = WORSE * (float(before.value) if before and isinstance(before.value, float) else 0.0)
    if repaired.residual_px > max(limit, LEAST_RESIDUAL_PX):
        notes.append(
            f"{name} fits by {repaired.residual_px:.2f} px, and the calibration before by "
            f"{limit / WORSE:.2f}. Did something move while it was photographed?"
        )
    was, now = (float(c.projectors[name].surface.valid.mean()) for c in (old, repaired.calibration))
    if now < (1 - MOST_LOST) * was:
        notes.append(
            f"{now:.0%} of the panel of {name} light the screen, and {was:.0%} did before. Does "
            "something stand before it or before the camera, or does its picture miss the screen?"
        )
    return notes


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


@dataclass(frozen=True, slots=True)
class _Repaired:
    """A calibration with one projector solved anew; the rms residual of its geometry; notes of its solve."""

    calibration: Calibration
    residual_px: float
    notes: list[str]


def _repaired(
    venue: Venue, source: Session, session: Session, old: Calibration, name: str
) -> _Repaired:
    """Solve one projector from a session; `source` is the session of the calibration."""
    measured, geometry, notes = _measured(venue, session, old, name)
    before, *_ = _measured(venue, source, old, name)
    about = re.compile(rf"projector {re.escape(name)}(?![\w-])")
    kept = [note for note in old.provenance.get("notes", ()) if not about.search(str(note))]
    origin: dict[str, Any] = {
        **provenance(venue, session),
        "notes": [*kept, *notes],
        "recalibrated": [*old.provenance.get("recalibrated", []), name],
    }
    black = direct_black(before)
    new = with_projector(old, name, geometry, measured, black, nudges(venue), origin)
    residual = geometry.residual_px[geometry.main, name]
    return _Repaired(new, float(np.sqrt(np.mean(residual**2))), notes)


def _measured(
    venue: Venue, session: Session, calibration: Calibration, name: str
) -> tuple[ProjectorMeasurement, GeometrySolution, list[str]]:
    """A projector's light in a session, the rig in which it was solved there, and notes.

    By the camera that the calibration's light was measured with, where it stands.
    """
    radiometer = Radiometer(calibration.camera)
    images, notes = with_long_exposure(SessionImages(session, session.read_plan(), radiometer))
    found, geometry, decoded = _placed(venue, images, calibration, name)
    view = screen_view(venue, calibration.screen, images, geometry)
    main = {(geometry.main, name): found}
    notes += [*decoded, *check_on_screen(view, main)]
    masks = projector_masks(venue)
    measured = measure_light(calibration.screen, images, view, geometry, main, masks, name)
    return measured, geometry, [*notes, *measured.notes]


def _placed(
    venue: Venue, images: SessionImages, calibration: Calibration, name: str
) -> tuple[Decoded, GeometrySolution, list[str]]:
    """What the main camera sees of a projector, the rig with that projector solved, and notes."""
    seen, gathered, notes = {}, {}, list[str]()
    for camera in calibration.cameras.values():
        own = SessionImages(images.session, images.plan, Radiometer(camera))
        seen[camera.name], gathered[camera.name, name], lines = decode_projector(venue, own, name)
        notes += lines
    known = RigGeometry(
        round_shape(calibration.screen),
        calibration.cameras,
        {n: p.model for n, p in calibration.projectors.items()},
    )
    problem, main = rig_problem(venue, gathered, ()), calibration.main_camera
    return seen[main], solve_projectors(problem, known, [name], main=main), notes
