"""Recalibrates some projectors: only they are photographed, and all else of the calibration stays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from procam.devices.rig import Rig
from procam.errors import InputError, OutOfModelRange
from procam.estimate.drift.finding import Cause
from procam.files.calibration import load_calibration, save_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.versions import next_directory, use_calibration
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.workflows.capture.capture import capture
from procam.workflows.capture.newest import next_session
from procam.workflows.capture.session_plan import server_of
from procam.workflows.events import Event, Steps
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.photographs.open import is_by_hand, refuse_mixed
from procam.workflows.recalibrate.one_projector import solve_again
from procam.workflows.recalibrate.worse import new_notes, white_notes, worse_notes
from procam.workflows.solve.plausible import check_calibration
from procam.workflows.verify.verify import SETTLE_S, Verified, verify

WATCHED = 2  # projectors that are verified where others are to be recalibrated
STAYS = "the calibration before stays in use; put that right, and recalibrate again"
REFINED = (
    "the calibration was refined, and what that corrected in the gains of these projectors is not in their "
    "new ones: refine again (procam refine)"
)
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


@dataclass(frozen=True, slots=True)
class Recalibrated:
    """Folders of the new calibration and of its session, None if nothing had to be done.

    `projectors` were measured again; `notes` are what else was found.
    """

    calibration: Path | None
    session: Path | None
    projectors: list[str]
    notes: list[str]


def recalibrate(
    rig: Callable[[], Rig], venue: Venue, used: Path, names: Sequence[str] = ()
) -> Steps[Recalibrated]:
    """Photograph some projectors with a rig and put them into the calibration `used`.

    Without `names` the whole venue is verified first, and those are chosen that recalibrating helps. With
    names only two others are verified, for the camera and the room's light must be as they were. The new
    session has the photographs of all other projectors too, as links, so that it can be verified against and
    solved as a whole.

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
        verified = yield from verify(photographer, venue, old, watched)
        chosen, notes = _chosen(verified, names)
        run.message = f"{', '.join(chosen) or 'nothing'} recalibrated"
        if not chosen:
            yield Event("solve", 1, 1, "nothing to recalibrate")
            return Recalibrated(None, None, [], notes)
        source = Session(venue.directory / "sessions" / old.provenance.session)
        session = source.without(next_session(venue), chosen)
        yield from capture(rig(), venue, session)
        ambient = verified.change.ambient
        return (yield from _solved(venue, (used, old), (source, session), chosen, ambient, notes))


def _solved(
    venue: Venue,
    before: tuple[Path, Calibration],
    sessions: tuple[Session, Session],
    names: Sequence[str],
    ambient: Measured,
    notes: Sequence[str],
) -> Steps[Recalibrated]:
    """Solve projectors from the new session, and write the calibration; it is used unless it is worse."""
    (used, old), (source, session), total = before, sessions, len(names) + 1
    calibration, worse = old, list[str]()
    for done, name in enumerate(names, start=1):
        repaired = solve_again(venue, source, session, calibration, name)
        calibration = repaired.calibration
        worse += map(str, new_notes(old, repaired.notes))
        worse += worse_notes(old, repaired, name, ambient)
        text = f"{name} solved, residual {repaired.residual_px:.3f} px"
        yield Event("solve", done, total, text)
    worse += map(str, new_notes(old, check_calibration(calibration)))
    directory = next_directory(venue.directory)
    save_calibration(calibration, directory)
    use_calibration(venue.directory, used if worse else directory)
    kept = [REFINED] if "loop_iterations" in old.quality else []
    kept += white_notes(old, calibration)
    yield Event("solve", total, total, f"{directory} written")
    said = [*notes, *worse, *([STAYS] if worse else kept)]
    return Recalibrated(directory, session.directory, list(names), said)


def _chosen(verified: Verified, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Projectors to recalibrate, and other findings, one per line.

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
            "alone; photograph a whole session (`procam session plan`)"
        )
    unknown = [name for name in names if name not in calibration.projectors]
    if unknown:
        raise InputError(
            f"--projector {unknown[0]}: there is none of this name; choose from "
            f"{', '.join(calibration.projectors)}"
        )
