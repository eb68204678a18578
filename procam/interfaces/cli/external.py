"""`procam patterns VENUE` and `procam ingest`: rigs that procam does not drive."""

from pathlib import Path

from procam.errors import InputError
from procam.files.images.slideshow import video_library
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli.output import Output
from procam.interfaces.cli.venues import venue_of
from procam.workflows.capture.by_hand import export, hold_s, prepare_by_hand
from procam.workflows.capture.ingest import ingest
from procam.workflows.capture.session_plan import server_of

SHOWN = 8  # missing shots that a line names
ONE_BY_ONE = "show one projector's pictures after the other's, all other shutters closed"


def run_venue_patterns(directory: Path, out: Path, movie: bool, output: Output) -> None:
    """`procam patterns VENUE`: a session, and what its rig is to show."""
    venue = load_venue(directory)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: got something there already, expected a new or empty folder")
    if movie:
        video_library()  # or nothing is written
    out.mkdir(parents=True, exist_ok=True)  # where that fails, no session may be left behind
    session = prepare_by_hand(venue)
    export(session, out, movie)
    shots = session.read_plan().shots
    minutes = sum(hold_s(shot) for shot in shots) / 60
    cameras = " or ".join(venue.cameras)
    output.say(
        f"{len(shots)} shots written to {out}, {minutes:.0f} min; order.csv tells what to show and how "
        "long to expose it"
    )
    server = server_of(venue)
    then = f"open them and feed {server.name} with its pictures" if server else ONE_BY_ONE
    output.say(
        f"first close all shutters and photograph the dark; then {then}; focus, zoom, aperture and "
        "ISO stay as they are"
    )
    output.say(f"then run: procam ingest {session.directory} --camera {cameras} --photos PHOTOS")
    output.finish({"session": str(session.directory), "out": str(out), "shots": len(shots)})


def run_ingest(
    directory: Path, camera: str, photos: Path, index: Path | None, output: Output
) -> None:
    """`procam ingest`."""
    session, venue = Session(directory), load_venue(venue_of(directory))
    session.read_plan()  # a folder that is none must not get a lock file
    told = output.follow(ingest(venue, session, camera, photos, index))
    for note in told["notes"]:
        output.say(note)
    missing = told["missing"]
    more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
    output.say(f"{told['stored']} photographs stored for camera {camera}")
    if missing:
        output.say(
            f"missing: {', '.join(missing[:SHOWN])}{more}; photograph them and ingest again: "
            "it adds only what is missing"
        )
    else:
        output.say(f"nothing is missing; now run: procam solve {directory}")
    output.finish(told)
