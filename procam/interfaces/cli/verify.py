"""`procam verify`: what has changed at a venue since it was calibrated."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path

import typer

from procam.errors import DeviceError, ProcamError
from procam.estimate.drift.finding import Finding, advice_by_hand
from procam.files.calibration import load_calibration
from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.venue.load import load_venue
from procam.files.versions import chosen_calibration, venue_of_calibration
from procam.interfaces.cli._options import (
    FromArgument,
    Json,
    ReplaceRound,
    RoundPhotos,
    UnattendedOption,
)
from procam.interfaces.cli._output import Output, RunLog, as_dicts
from procam.interfaces.cli._rounds import ask_for_photographs, given_photographs
from procam.interfaces.cli._system_errors import worded
from procam.workflows.photographs.open import is_by_hand, photographer_of
from procam.workflows.photographs.orders import PhotographsWanted
from procam.workflows.unattended import leave_for
from procam.workflows.verify.verify import SETTLE_S, Verified
from procam.workflows.verify.verify import verify as verifying

EXAMPLE = "procam verify my-dome"


def verify(
    start: FromArgument,
    photos: RoundPhotos = None,
    replace: ReplaceRound = False,
    unattended: UnattendedOption = False,
    json: Json = False,
) -> None:
    """Say what has changed at a venue since it was calibrated, and why; exit 1 if anything has.

    Photographs each projector four times and compares with the session of the calibration in use: pictures
    that moved, focus, lamps, settings, the screen, the floor, the room's light. A camera that was put back
    roughly is no alarm. By hand, one run writes the pictures, and the next takes photographs with --photos.
    """
    venue, kept = venue_of_calibration(start), chosen_calibration(start)
    loaded, output = load_venue(venue), Output(json, RunLog(venue, "verify"))
    verified: Verified | None = None
    try:
        with recorded(venue, "verify") as run, leave_for(loaded, "verify", unattended) as leave:
            verify_unchanged(venue, kept)  # here, so that whoever is to be notified hears of it
            calibration = load_calibration(kept)
            try:
                given = given_photographs(photos, replace)
                with photographer_of(
                    loaded, calibration, "verify", kept.name, given, SETTLE_S, leave.rig
                ) as photographer:
                    output.warn(photographer.notes)
                    events = verifying(photographer, loaded, calibration)
                    verified = output.follow(leave.watch(events))
                    if is_by_hand(loaded):
                        verified = _advised_by_hand(verified)
            except PhotographsWanted as wanted:
                run.message = "photographs are wanted"
                ask_for_photographs(wanted, ["procam", "verify", str(start)], output)
                return
            photographer.end()
            run.measured(verified.figures())
            run.message = verified.summary()
            leave.notify(run.message)
    except (ProcamError, OSError) as error:
        if verified is None:
            raise
        _say(verified, kept, output, error)  # which no disk and no message may take away
        raise typer.Exit(1 if isinstance(error, DeviceError) else 2) from error
    _say(verified, kept, output)
    if verified.alarm:
        raise typer.Exit(1)


def _advised_by_hand(verified: Verified) -> Verified:
    findings = [replace(each, advice=advice_by_hand(each.advice)) for each in verified.findings]
    return replace(verified, findings=findings)


def _say(
    verified: Verified, kept: Path, output: Output, error: ProcamError | OSError | None = None
) -> None:
    """Print the findings, and the error that came after them."""
    for line in _lines(verified, kept):
        output.say(line)
    document = _document(verified, kept)
    if error:
        text = worded(error) if isinstance(error, OSError) else str(error)
        output.warn([f"the findings are complete, and after them: {text}"])
        document["error"] = text
    output.finish(document)


def _document(verified: Verified, kept: Path) -> dict[str, object]:
    """A verification of calibration `kept` for machines."""
    return {
        "calibration": str(kept),
        "alarm": verified.alarm,
        "photographs": verified.photographs,
        "findings": [_entry(each) for each in verified.findings],
        "figures": as_dicts(verified.figures()),
    }


def _entry(finding: Finding) -> dict[str, object]:
    """A finding for machines; what has no size has none."""
    entry = asdict(finding) | {"alarm": finding.alarm, "sigmas": finding.sigmas}
    return {
        key: None if isinstance(value, float) and not isfinite(value) else value
        for key, value in entry.items()
    }


def _lines(verified: Verified, kept: Path) -> Iterator[str]:
    for each in verified.findings:
        subject = each.subject or "venue"
        size = ""
        if isfinite(each.size):
            size = f"  {each.size:+.3g} +- {each.sigma:.1g} {each.unit}, {each.sigmas:.0f} sigmas"
        yield f"{'CHANGED' if each.alarm else 'note   '}  {subject}: {each.cause}{size}"
        yield f"         {each.text}"
        yield f"         what to do: {each.advice}"
    compared = f"{verified.photographs} photographs, compared with calibration {kept.name}"
    count = sum(each.alarm for each in verified.findings)
    yield f"{compared}: {count} change{'s' * (count != 1)}" if count else f"{compared}: all is well"
