"""`procam state`: feedback and ambient light of the venue with its audience and its own lamps."""

from typing import Annotated

import typer

from procam.files.calibration import load_calibration, save_calibration
from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.versions import (
    chosen_calibration,
    next_directory,
    use_calibration,
    venue_of_calibration,
)
from procam.interfaces.cli._options import FromArgument, Json, ReplaceRound, RoundPhotos
from procam.interfaces.cli._output import Output, RunLog
from procam.interfaces.cli._rounds import ask_for_photographs, given_photographs
from procam.interfaces.cli._sessions import load_dome_venue
from procam.model.venue_state import VenueState
from procam.workflows.audience import check_state_name, measure_state, with_state
from procam.workflows.photographs.open import photographer_of
from procam.workflows.photographs.orders import PhotographsWanted

EXAMPLE = "procam state my-dome full"
ONLY = "--ambient-only"


def state(
    start: FromArgument,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the state, such as full.")],
    ambient_only: Annotated[
        bool,
        typer.Option(
            ONLY,
            help="Only the room's own light; no projector is lit, nothing is checked.",
        ),
    ] = False,
    photos: RoundPhotos = None,
    replace: ReplaceRound = False,
    json: Json = False,
) -> None:
    """Measure the venue with its present audience and its own lamps; a new calibration.

    Leave exit signs and aisle lights as in a show. Photographs the room dark, then black and parts
    of each projector's picture, and adds the state to the calibration. The camera must stand where it
    stood for that calibration. By hand, one run writes the pictures, and the next takes the
    photographs with --photos.
    """
    venue = venue_of_calibration(start)
    loaded, output = load_dome_venue(venue, "state"), Output(json, RunLog(venue, "state"))
    kept = chosen_calibration(start)
    verify_unchanged(venue, kept)
    calibration = load_calibration(kept)
    check_state_name(calibration, name)
    with recorded(venue, "state"):
        try:
            of, work = kept.name + ONLY * ambient_only, f"state-{name}"
            given = given_photographs(photos, replace)
            with photographer_of(loaded, calibration, work, of, given) as photographer:
                output.warn(photographer.notes)
                events = measure_state(photographer, loaded, calibration, name, ambient_only)
                measured, light = output.follow(events)
        except PhotographsWanted as wanted:
            command = ["procam", "state", str(start), name, *[ONLY] * ambient_only]
            ask_for_photographs(wanted, command, output)
            return
        out = next_directory(venue)
        save_calibration(with_state(calibration, measured), out)
        use_calibration(venue, out)
        photographer.end()
    ambient = [float(v) for v in light]
    output.say(f"{out} written, with venue state {name}")
    _print_channels(measured, ambient, output)
    output.finish(
        {
            "calibration": str(out),
            "state": name,
            "feedback": measured.feedback.value.tolist(),
            "feedback_sigma": measured.feedback.sigma.tolist(),
            "scatter_ratio": measured.scatter_ratio.tolist(),
            "ambient": ambient,
        }
    )


def _print_channels(measured: VenueState, ambient: list[float], output: Output) -> None:
    low, high = measured.feedback.interval()
    rows = zip(
        "RGB", measured.feedback.value, low, high, measured.scatter_ratio, ambient, strict=True
    )
    for channel, m, least, most, ratio, light in rows:
        output.say(
            f"  {channel}  feedback {m:.4f} ({least:.4f} .. {most:.4f}), {ratio:.1%} of the "
            f"calibration's; the room's own light {light:.2%} of white"
        )
