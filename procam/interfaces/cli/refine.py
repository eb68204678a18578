"""`procam refine`: the closed loop on the compensated picture."""

from pathlib import Path
from typing import Annotated

import typer

from procam.files.calibration import load_calibration
from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.images.stills import read_picture
from procam.files.session import digest
from procam.files.venue.load import load_venue
from procam.files.versions import chosen_calibration, venue_of_calibration
from procam.interfaces.cli import _sessions
from procam.interfaces.cli._options import FromArgument, Json, ReplaceRound, RoundPhotos
from procam.interfaces.cli._output import Output, RunLog, as_dicts, exit_if_missed
from procam.interfaces.cli._rounds import ask_for_photographs, given_photographs
from procam.workflows.photographs.open import photographer_of
from procam.workflows.photographs.orders import PhotographsWanted
from procam.workflows.playout.frame import canvas_size, require_standard_canvas
from procam.workflows.refine import refine as loop
from procam.workflows.refine.stored_pictures import keep_loop, keep_pictures
from procam.workflows.sample_content import half_sky

EXAMPLE = "procam refine my-dome --picture sky.exr"


def refine(
    start: FromArgument,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Picture on the canvas to refine on; by default a picture of half a sky."
        ),
    ] = None,
    photos: RoundPhotos = None,
    replace: ReplaceRound = False,
    json: Json = False,
) -> None:
    """Show the compensated picture, photograph it and correct the residual; a new calibration.

    By hand it goes in four to eight rounds: each run writes the pictures to show and photograph, and the
    next takes the photographs with --photos. Exit 1 if a figure misses its goal or gets worse; if
    one gets worse, nothing is written.
    """
    venue = venue_of_calibration(start)
    loaded, output = load_venue(venue), Output(json, RunLog(venue, "refine"))
    kept = chosen_calibration(start)
    verify_unchanged(venue, kept)
    calibration = load_calibration(kept)
    if picture:
        require_standard_canvas(calibration, "--picture", "leave it out to refine on half a sky")
    if picture:
        content, note = read_picture(picture)
        canvas_size(content, str(picture), calibration)
    else:
        content, note = half_sky(calibration.maps.size, calibration.screen), ""
    with recorded(venue, "refine"):
        try:
            of = f"{kept.name} {digest(content)}"
            given = given_photographs(photos, replace)
            with photographer_of(loaded, calibration, "refine", of, given) as photographer:
                output.warn(photographer.notes)
                events = loop.refine(photographer, loaded, calibration, content)
                refined = output.follow(events)
        except PhotographsWanted as wanted:
            of_picture = ["--picture", str(picture)] if picture else []
            ask_for_photographs(wanted, ["procam", "refine", str(start), *of_picture], output)
            return
        keep_pictures(venue, calibration, content)
        keep_loop(venue, refined, content)
        notes = [*[note] * bool(note), *refined.notes()]
        for line in notes:
            output.say(f"note: {line}")
        figures = refined.figures()
        output.table(figures)
        newest = _sessions.keep_refined(venue, kept, refined, output)
        photographer.end()
        if refined.worse and photographer.again:
            output.say(photographer.again)
    document = {
        "calibration": str(newest),
        "figures": as_dicts(figures),
        "notes": notes,
    }
    output.finish(document | ({"worse": refined.worse} if refined.worse else {}))
    if refined.worse:
        raise typer.Exit(1)
    exit_if_missed(figures)
