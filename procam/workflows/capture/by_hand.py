"""A session for rigs that procam does not drive: numbered pictures, movies, the order to show them."""

import math
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np

from procam.estimate.structured_light.codes import NOMINAL_GAMMA, Picture
from procam.estimate.structured_light.photo_match import NUMBER
from procam.files import atomic
from procam.files.csv_text import csv_text
from procam.files.history.record import recorded
from procam.files.images.pixels import read_image
from procam.files.images.slideshow import write_movie
from procam.files.lock import locked
from procam.files.session import Session
from procam.files.system import open_here
from procam.files.venue.load import Venue
from procam.maths.codes.shot_id import CELLS_PER_MASTER, CELLS_PER_PANEL, draw_shot_id
from procam.model.plan import Plan, Shot
from procam.workflows.capture.session_plan import plan_of_session, server_of

PREFIX = "hand-"  # keeps these sessions apart from those that `procam session capture` resumes
HOLD_S = 4  # to find the shutter button, beside twice the exposures
BLACK_TAG_SHARE = 0.12  # of white's counts, in the photograph of black
MOST_LIGHT_IN_BLACK = 0.01  # of white: its bounces must stay well below black's own light
COLUMNS = ("number", "shot", "projector", "purpose", "picture", "exposures_s", "start_s", "hold_s")


def write_by_hand(venue: Venue, out: Path, movie: bool) -> Session:
    """A new session whose pictures carry their numbers, and a folder of them for the rig.

    `out` gets the plan, the pictures, the order and playlists, and with `movie` a movie of each. It
    and the session appear when they are complete.
    """
    # the session and the history are written first: pictures without them could not be ingested, and
    # would keep a second run from their folder
    with locked(venue.directory, "session plan"), atomic.replacing_directory(out) as pictures:
        with recorded(venue.directory, "session plan"):
            folder = _next_folder(venue)
            with atomic.replacing_directory(folder) as new:
                session = Session(new)
                _write_session(venue, session)
                _export(session, pictures, movie)
    return Session(folder)


def _write_session(venue: Venue, session: Session) -> None:
    capture = venue.table.capture
    plan, patterns = plan_of_session(venue)
    light = black_light(capture.exposure_s, capture.black_exposure_s)
    cells = CELLS_PER_MASTER if server_of(venue) else CELLS_PER_PANEL
    numbered, shots = {}, []
    for number, shot in enumerate(plan.shots):
        if not shot.pattern:
            shots.append(shot)  # nothing shines, so nothing can be read
            continue
        drive = round(255 * light ** (1 / NOMINAL_GAMMA)) if shot.purpose == "black" else None
        numbered[shot.pattern] = draw_shot_id(patterns.pop(shot.pattern), number, drive, cells)
        detail = {**shot.detail, NUMBER: number}
        shots.append(replace(exposed_by_hand(shot), detail=detail))
    text = (venue.directory / "venue.toml").read_text("utf-8")
    atomic.write_text(session.directory / "venue.toml", text)
    session.write_plan(Plan(tuple(shots)), numbered)


def exposed_by_hand(shot: Shot) -> Shot:
    """A shot as people photograph it: the number in a black is too dim to read at white's exposure."""
    exposures_s = shot.exposures_s[:1] if shot.purpose == "black" else shot.exposures_s
    return replace(shot, exposures_s=exposures_s)


def _export(session: Session, out: Path, movie: bool) -> None:
    """Copy a session's plan and pictures to a folder for the rig, with the order and playlists."""
    plan = session.read_plan()
    for shot in plan.shots:
        if shot.pattern:
            (out / shot.pattern).parent.mkdir(parents=True, exist_ok=True)
            with open(out / shot.pattern, "wb", opener=open_here) as picture:
                picture.write((session.directory / shot.pattern).read_bytes())
    atomic.write_text(out / "plan.json", (session.directory / "plan.json").read_text("utf-8"))
    atomic.write_text(out / "order.csv", order_table(plan))
    for name, shots in _playlists(plan).items():
        atomic.write_text(out / f"{name}.m3u", _playlist(shots))
        if movie:
            stills = ((_picture(session, shot), hold_s(shot)) for shot in shots)
            write_movie(out / f"{name}.mov", stills)


def black_light(exposure_s: float, black_exposure_s: float) -> float:
    """Light of the number in a black picture, as a share of white: readable at black's exposure."""
    return min(MOST_LIGHT_IN_BLACK, BLACK_TAG_SHARE * exposure_s / black_exposure_s)


def hold_s(shot: Shot) -> int:
    """Whole seconds to show a shot for: time to release the shutter, and then some."""
    return HOLD_S + math.ceil(2 * sum(shot.exposures_s))


def order_table(plan: Plan) -> str:
    """What to show when and how long to expose it, as CSV; times count within a movie."""
    rows: list[tuple[object, ...]] = [COLUMNS]
    start, projector = 0, ""
    for shot in plan.shots:
        start, projector = (start if shot.projector == projector else 0), shot.projector
        exposures = " ".join(f"{e:g}" for e in shot.exposures_s)
        number = shot.detail.get(NUMBER, "")
        head = (number, shot.id, shot.projector, shot.purpose, shot.pattern, exposures)
        rows.append((*head, start, hold_s(shot)))
        start += hold_s(shot)
    return csv_text(rows)


def _next_folder(venue: Venue) -> Path:
    folder = venue.directory / "sessions"
    taken = [int(p.name.removeprefix(PREFIX)) for p in folder.glob(PREFIX + 4 * "[0-9]")]
    return folder / f"{PREFIX}{max(taken, default=0) + 1:04d}"


def _playlists(plan: Plan) -> dict[str, list[Shot]]:
    """Shots by playlist: one for each projector, and one for the first at the end of the session."""
    lists: dict[str, list[Shot]] = {}
    for name, shots in groupby(plan.shots, key=lambda shot: shot.projector):
        if name:
            lists[f"{name}-end" if name in lists else name] = list(shots)
    return lists


def _playlist(shots: list[Shot]) -> str:
    entries = (f"#EXTINF:{hold_s(shot)},{shot.id}\n{shot.pattern}\n" for shot in shots)
    return "#EXTM3U\n" + "".join(entries)


def _picture(session: Session, shot: Shot) -> Picture:
    return np.asarray(read_image(session.directory / shot.pattern), np.uint8)
