"""Photographs taken by hand or by another program, put behind the shots of a plan."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError
from procam.estimate.structured_light.photo_match import Match, PhotoObservation, Slot, match_photos
from procam.files.history.record import recorded
from procam.files.images.photos import (
    Photo,
    Response,
    in_time,
    list_photos,
    load_response,
    photo_counts,
    read_photo,
    write_response,
)
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.maths.codes.shot_id import read_shot_id
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import CameraModel
from procam.model.plan import Plan, Shot
from procam.workflows.capture.brackets import solve_brackets
from procam.workflows.capture.by_hand import PREFIX
from procam.workflows.capture.decoded import DECODED_BITS, with_decoded_bits
from procam.workflows.capture.earlier import notes_of_earlier
from procam.workflows.capture.photo_index import read_index
from procam.workflows.capture.session_plan import plan_of
from procam.workflows.capture.settings import (
    Setting,
    common_settings,
    keep_settings,
    read_settings,
)
from procam.workflows.events import Event, Steps

GREEN = 1
SAME_EXPOSURE = 1e-3  # relative; headers round


@dataclass(frozen=True, slots=True)
class _Surveyed:
    """What is kept of a photograph while the others are looked at; its pixels are not."""

    path: Path
    observation: PhotoObservation
    channels: int
    taken_s: float | None
    setting: Setting


@dataclass(frozen=True, slots=True)
class Ingested:
    """How many photographs were stored, and the names of shots that are missing.

    `notes` has a line for every photograph that was left out or guessed.
    """

    stored: int
    missing: list[str]
    notes: list[str]


def ingest(
    venue: Venue,
    session: Session,
    camera: str,
    folder: Path,
    index: Path | None = None,
    *,
    by_order: bool = False,
    replace_stored: bool = False,
) -> Steps[Ingested]:
    """Sort the photographs of a folder behind the shots of a session and store what is missing.

    With `by_order` photographs without a readable number count by their order; with `replace_stored` they
    replace what is stored already. Everything is checked before anything is written.
    """
    with recorded(venue.directory, "session add"):
        plan, venue = plan_of(venue, session), with_decoded_bits(venue, session)
        model, response, notes = camera_and_response(venue, session, camera)
        paths, others = list_photos(folder)
        claims = read_index(index, plan, paths) if index else {}
        surveyed = []
        for path in paths:
            surveyed.append(_survey(path, model, response, claims.get(path.name)))
            yield Event("add", len(surveyed), len(paths), f"{path.name} looked at")
        surveyed = in_time(surveyed)
        stored, observations = set(session.stored(camera)), [s.observation for s in surveyed]
        kept = set() if replace_stored else stored
        match = match_photos(plan, observations, kept, by_order=by_order)
        match.missing = [slot for slot in match.missing if slot not in stored]
        match.notes += [f"{name}: is no photograph; left out" for name in others]
        _check(plan, surveyed, match, model, session, camera)
        used = [surveyed[photo] for photo in match.chosen.values()]
        replaced = replace_stored and stored <= set(match.chosen)
        known = {} if replaced else read_settings(session, camera)
        settings = common_settings(((s.path, s.setting) for s in used), known)
        exposed, chosen = _as_exposed(plan, surveyed, match, session, venue, camera)
        if exposed != plan:
            session.keep_plan()
            session.write_plan(exposed, {})
        keep_settings(session, camera, settings)
        match.notes += [*notes, *_keep_response(venue, session, camera, response)]
        yield from _store(session, exposed, model, response, surveyed, chosen)
        match.notes += notes_of_earlier(session, camera)
        yield Event("add", len(chosen), len(chosen), "stored")
        missing = list(dict.fromkeys(shot for shot, _ in match.missing))
        return Ingested(len(chosen), missing, match.notes)


def undo(venue: Venue, session: Session, camera: str) -> Path:
    """Set all photographs of a camera aside, with what was solved from them; where they are now."""
    with recorded(venue.directory, "session undo"):
        named_camera(venue, camera)
        if not session.directory.name.startswith(PREFIX):
            raise InputError(
                f"{session.directory}: its photographs are by devices, and `session capture` takes them; "
                "`undo` is for those that were added by hand"
            )
        if not session.stored(camera):
            raise InputError(
                f"{session.directory}: no photographs by camera {camera} are stored, so "
                "there is nothing to undo"
            )
        aside = session.set_aside(camera)
        if not any(session.stored(name) for name in venue.cameras):
            session.restore_plan()  # exposures were those of the photographs
        return aside


def camera_and_response(
    venue: Venue, session: Session, name: str
) -> tuple[CameraModel, Response | None, list[str]]:
    """The camera, its response, and what was left out to solve it.

    It is solved only once per session, so that frames are alike.
    """
    model = named_camera(venue, name)
    table, used = venue.table.cameras[name], _solved_response(session, name)
    if table.brackets is None:
        return model, load_response(table.response, venue.directory), []
    if used.is_file():
        return model, load_response(used.name, used.parent), []
    found = solve_brackets(venue.directory / table.brackets)
    notes = [f"response of camera {name}: {note}" for note in found.notes]
    return model, (found.response.levels, found.response.light), notes


def named_camera(venue: Venue, name: str) -> CameraModel:
    """The camera that --camera names."""
    if name not in venue.cameras:
        what = f"no camera {name!r}" if name else "say which one photographs"
        raise InputError(f"--camera: {what}; venue.toml has {', '.join(venue.cameras)}")
    return venue.cameras[name]


def _solved_response(session: Session, camera: str) -> Path:
    return session.directory / "captures" / camera / "response.csv"


def _keep_response(
    venue: Venue, session: Session, camera: str, response: Response | None
) -> list[str]:
    """Store a response that was solved just now; a line that names the one used."""
    brackets, path = venue.table.cameras[camera].brackets, _solved_response(session, camera)
    if brackets is None or response is None:
        return []
    if path.is_file():
        return [f"{path}: this response, solved before, is used for all photographs of the session"]
    write_response(path, *response)
    return [f"{path}: response solved from the photographs in {brackets}"]


def _survey(
    path: Path, model: CameraModel, response: Response | None, claimed: str | None
) -> _Surveyed:
    photo = read_photo(path)
    height, width = photo.pixels.shape[:2]
    fits = (width, height) == tuple(model.size)
    if not fits and claimed is None:
        # a stranger among the photographs, unless it shows a number after all
        number, clipped, sharpness = read_shot_id(photo.pixels), 0.0, 0.0
    else:
        counts = photo_counts(photo, response, model.sensor)
        number = read_shot_id(counts) if claimed is None else None
        clipped = float((counts >= 2**model.sensor.bits - 1).any(axis=2).mean())
        sharpness = _sharpness(counts, model.sensor.black_level)
    if not fits and (number is not None or claimed is not None):
        raise FileFormatError(
            f"{path}: {width}x{height} px, but venue.toml gives its camera "
            f"{model.size[0]}x{model.size[1]}; export it whole and unturned, or correct the camera's size"
        )
    observation = PhotoObservation(
        path.name, number, claimed, photo.exposure_s, clipped, sharpness, fits
    )
    channels = photo.pixels.shape[2]
    return _Surveyed(
        path, observation, channels, photo.taken_s, (photo.sensitivity, photo.aperture)
    )


def _sharpness(counts: NDArray[np.uint16], black_level: float) -> float:
    """Mean square of second differences, relative to the light: blur and shake lower it."""
    light = counts.mean(axis=2, dtype=np.float32) - np.float32(black_level)
    bend = light[1:-1, 1:-1] * 4 - light[:-2, 1:-1] - light[2:, 1:-1]
    bend -= light[1:-1, :-2] + light[1:-1, 2:]
    return float(np.mean(bend**2) / max(float(np.mean(light**2)), 1e-9))


def _check(
    plan: Plan,
    surveyed: list[_Surveyed],
    match: Match,
    model: CameraModel,
    session: Session,
    camera: str,
) -> None:
    """Refuse what would make a solve wrong, before anything is stored."""
    if not match.chosen and not session.stored(camera):
        raise InputError(
            f"{surveyed[0].path.parent}: {len(surveyed)} photographs, none of a shot of "
            f"{session.directory / 'plan.json'}; are the numbers in the pictures sharp and whole? "
            "else name files and shots with --index"
        )
    colour = {shot.id for shot in plan.shots if shot.pixel_format == "rgb"}
    for (shot, _), photo in match.chosen.items():
        if shot in colour and surveyed[photo].channels == 1:
            raise FileFormatError(
                f"{surveyed[photo].path}: one channel, but shot {shot} needs R, G and B; "
                "develop the photographs in colour"
            )


def _as_exposed(
    plan: Plan,
    surveyed: list[_Surveyed],
    match: Match,
    session: Session,
    venue: Venue,
    camera: str,
) -> tuple[Plan, dict[Slot, int]]:
    """The plan with the exposures of the photographs' headers, and the choice by those."""
    others = (name for name in venue.cameras if name != camera)
    fixed = {slot for name in others for slot in session.stored(name)}
    chosen: dict[Slot, int] = {}
    shots = []
    for shot in plan.shots:
        exposures = []
        for planned in shot.exposures_s:
            photo = match.chosen.get((shot.id, planned))
            stated_s = None if photo is None else surveyed[photo].observation.exposure_s
            really = planned if stated_s is None or _alike(stated_s, planned) else stated_s
            if really != planned and photo is not None and (shot.id, planned) in fixed:
                raise FileFormatError(
                    f"{surveyed[photo].path}: exposed {really:g} s, but another camera has "
                    f"shot {shot.id} at {planned:g} s; expose all cameras alike"
                )
            exposures.append(really)
            if photo is not None:
                chosen[shot.id, really] = photo
        shots.append(replace(shot, exposures_s=tuple(exposures)))
    return Plan(tuple(shots)), chosen


def _alike(first: float, second: float) -> bool:
    return abs(first / second - 1) < SAME_EXPOSURE


def _store(
    session: Session,
    plan: Plan,
    model: CameraModel,
    response: Response | None,
    surveyed: list[_Surveyed],
    chosen: Mapping[Slot, int],
) -> Steps[None]:
    shots = {shot.id: shot for shot in plan.shots}
    bits = session.bits(model.name) if session.stored(model.name) else DECODED_BITS
    decoded = None if response is None else bits
    for done, ((shot_id, exposure_s), photo) in enumerate(chosen.items(), start=1):
        shot, source = shots[shot_id], read_photo(surveyed[photo].path)
        frame = photo_frame(source, photo_counts(source, response, model.sensor), shot, exposure_s)
        session.store(model.name, shot, exposure_s, frame, decoded)
        yield Event("add", done, len(chosen), f"{source.path.name} stored as {shot_id}")


def photo_frame(photo: Photo, counts: NDArray[np.uint16], shot: Shot, exposure_s: float) -> Frame:
    """A photograph as a driven camera would have given it; the clock is the photograph's own."""
    mono = shot.pixel_format == "mono" or counts.shape[2] == 1
    wanted = counts[..., min(GREEN, counts.shape[2] - 1)] if mono else counts
    started_s = photo.taken_s or 0.0
    settings = CameraSettings(exposure_s, "mono" if mono else "rgb")
    return Frame(np.ascontiguousarray(wanted), settings, started_s, started_s + exposure_s)
