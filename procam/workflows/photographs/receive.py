"""Photographs of a round, from a folder of a camera's card, put behind what was asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from procam.arrays import AnyArray, Array
from procam.errors import FileFormatError, InputError
from procam.files.images.photos import (
    Response,
    in_time,
    list_photos,
    photo_counts,
    read_photo,
)
from procam.files.session import digest
from procam.maths.codes.shot_id import read_shot_id
from procam.maths.warp import block_mean
from procam.model.optics import Sensor
from procam.workflows.capture.earlier import Earlier, earlier_photographs
from procam.workflows.capture.ingest import photo_frame
from procam.workflows.capture.settings import (
    Setting,
    common_settings,
    keep_settings,
    read_settings,
)
from procam.workflows.photographs.orders import Asked, OrderRow
from procam.workflows.photographs.rounds import Rounds

SHORTEST, LONGEST = 0.78, 1.28  # times the exposure that was asked for: a third of a stop
BLOCK_PX = 8
SAME_LIGHT, SAME_SHARE = 0.05, 1e-3  # photographs of one picture: relative, and of full scale
COLOURS = 3
CLOCK_S = 86400.0  # clocks of cameras and computers, and their time zones, differ by less


@dataclass(frozen=True, slots=True)
class _Surveyed:
    """What is kept of a photograph while the others are looked at; its pixels are not.

    `light` (h, w, C) is that of blocks of pixels [full scale].
    """

    path: Path
    taken_s: float | None
    stated_s: float | None
    setting: Setting
    light: Array
    sha256: str


def receive(
    rounds: Rounds, folder: Path, response: Response | None, settings: Mapping[str, float]
) -> list[str]:
    """Store the photographs of a folder as those of the last round, in its order.

    Everything is checked before anything is stored. They count by the camera's clock, else by name.
    `settings` are the ISO and the aperture of the calibration, as far as they are known.

    Returns
    -------
    list : warnings, one per line.

    Raises
    ------
    FileFormatError
        There are more or fewer than were asked for; one is of another size, exposure or picture.
    """
    if not rounds.asked:
        other = rounds.unfinished()
        started = f" ({other} has started, for another calibration or picture)" if other else ""
        raise InputError(
            f"{folder}: no photographs were asked for yet{started}; run the command without --photos first"
        )
    paths, _ = list_photos(folder)
    asked, order = rounds.last_round, in_words(rounds.order())
    if len(paths) != len(asked):
        raise FileFormatError(
            f"{folder}: {len(paths)} photographs instead of {len(asked)}: {order}, in this order; "
            f"give a folder of these alone"
        )
    surveyed = in_time([_survey(rounds, path, response) for path in paths])
    known = read_settings(rounds.session, rounds.camera.name) or settings
    common = common_settings(((s.path, s.setting) for s in surveyed), known)
    _check_slates(asked, surveyed, order)
    _check_exposures(asked, surveyed, order)
    _check_alike(asked, surveyed, order)
    earlier = list(earlier_photographs(rounds.session, rounds.camera.name))
    _check_new(rounds, surveyed, earlier, order)
    _check_times(rounds, surveyed, earlier, order)
    for each, found in zip(asked, surveyed, strict=True):
        photo = read_photo(found.path)
        counts = photo_counts(photo, response, rounds.camera.sensor)
        frame = photo_frame(photo, counts, each.shot, photo.exposure_s or each.exposure_s)
        rounds.session.store(rounds.camera.name, each.shot, each.exposure_s, frame)
    rounds.write()  # last: until then the round that they replace is the one on disk
    keep_settings(rounds.session, rounds.camera.name, common)
    return [*_notes(surveyed), *_time_notes(rounds, surveyed)]


def in_words(rows: Sequence[OrderRow]) -> str:
    """An order in a line."""
    return ", ".join(f"{row.photographs} of {row.picture} at {row.exposure_s:g} s" for row in rows)


def _survey(rounds: Rounds, path: Path, response: Response | None) -> _Surveyed:
    photo, camera = read_photo(path), rounds.camera
    height, width, channels = photo.pixels.shape
    if (width, height) != tuple(camera.size) or channels != COLOURS:
        raise FileFormatError(
            f"{path}: {width}x{height} px in {channels} channels, but the calibration's camera "
            f"{camera.name} has {camera.size[0]}x{camera.size[1]} in colour; is it by that camera? Export it "
            "whole, unturned and in colour"
        )
    counts = photo_counts(photo, response, camera.sensor)
    light = _coarse(counts, camera.sensor)
    setting = (photo.sensitivity, photo.aperture)
    return _Surveyed(path, photo.taken_s, photo.exposure_s, setting, light, digest(counts))


def _check_slates(asked: Sequence[Asked], surveyed: Sequence[_Surveyed], order: str) -> None:
    """Refuse photographs whose slate shows the number of another picture, or none."""
    for each, found in zip(asked, surveyed, strict=True):
        if not each.slate:
            continue
        number = read_shot_id(read_photo(found.path).pixels)
        if number != each.picture:
            shows = "no readable number" if number is None else f"the number {number:02d}"
            raise FileFormatError(
                f"{found.path}: {shows}, but the slate of picture {each.picture:02d} was asked for in its "
                f"place: {order}. Show the pictures of this round, each after its slate, and photograph again"
            )


def _check_exposures(asked: Sequence[Asked], surveyed: Sequence[_Surveyed], order: str) -> None:
    for each, found in zip(asked, surveyed, strict=True):
        if found.stated_s and not SHORTEST <= found.stated_s / each.exposure_s <= LONGEST:
            raise FileFormatError(
                f"{found.path}: exposed {found.stated_s:g} s, but {each.exposure_s:g} s was asked for in "
                f"its place: {order}; is the order right?"
            )


def _check_alike(asked: Sequence[Asked], surveyed: Sequence[_Surveyed], order: str) -> None:
    """Refuse photographs of one picture that show different light."""
    before = dict[tuple[str, float], _Surveyed]()
    for each, found in zip(asked, surveyed, strict=True):
        first = before.setdefault((each.shown, each.exposure_s), found)
        longer = (first.stated_s or each.exposure_s) / (found.stated_s or each.exposure_s)
        off = np.abs(longer * found.light - first.light).mean()
        if off > SAME_LIGHT * np.abs(first.light).mean() + SAME_SHARE:
            raise FileFormatError(
                f"{found.path} differs from {first.path.name}, which should show the same picture; the "
                f"order is {order}. Something moved, or a photograph is missing: take them again"
            )


def _check_new(
    rounds: Rounds, surveyed: Sequence[_Surveyed], earlier: Sequence[Earlier], order: str
) -> None:
    """Refuse a photograph that the venue has already; those of the dark may be alike."""
    before = {asked.id for asked in rounds.asked} - {asked.id for asked in rounds.last_round}
    stored = rounds.session.stored(rounds.camera.name).items()
    known = {each.entry.sha256: f"as one of {each.session.name}" for each in earlier}
    known |= {entry.sha256: "for an earlier round" for (shot, _), entry in stored if shot in before}
    for asked, found in zip(rounds.last_round, surveyed, strict=True):
        if asked.picture and found.sha256 in known:
            raise FileFormatError(
                f"{found.path} was given {known[found.sha256]} already; give the photographs of this one: "
                f"{order}"
            )


def _check_times(
    rounds: Rounds, surveyed: Sequence[_Surveyed], earlier: Sequence[Earlier], order: str
) -> None:
    """Refuse a photograph taken before one that was stored before this round was asked for."""
    asked_s = rounds.document.asked_s or 0.0
    dated = [e for e in earlier if e.taken_s is not None and e.stored_s < asked_s]
    if not dated:
        return
    newest = max(dated, key=lambda each: each.entry.started_s)
    for found in surveyed:
        if found.taken_s is not None and found.taken_s < newest.entry.started_s:
            raise FileFormatError(
                f"{found.path} was taken on {_day(found.taken_s)}, before the photographs of "
                f"{newest.session.name} ({_day(newest.entry.started_s)}), which were there when this round "
                f"was asked for. Give the photographs of this one: {order}; if the camera's clock was set "
                "back, set it forward and photograph again"
            )


def _time_notes(rounds: Rounds, surveyed: Sequence[_Surveyed]) -> list[str]:
    """A line on photographs that look older than their order, by the camera's clock or the file's date."""
    when = [(s.taken_s or s.path.stat().st_mtime, s.path.name) for s in surveyed]
    (oldest_s, name), asked_s = min(when), rounds.document.asked_s
    if asked_s is None or oldest_s > asked_s - CLOCK_S:
        return []
    return [
        f"{name}: of {_day(oldest_s)} by the camera's clock or the file's date, but it was asked for on "
        f"{_day(asked_s)}; if the clock is right, these are photographs of something else: give those "
        "of this round with --photos and --replace"
    ]


def _day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M")


def _coarse(counts: AnyArray, sensor: Sensor) -> Array:
    """Light above black [full scale] in blocks, which have little noise."""
    height, width = (n // BLOCK_PX * BLOCK_PX for n in counts.shape[:2])
    light = counts[:height, :width].astype(np.float32) - np.float32(sensor.black_level)
    return np.asarray(block_mean(light, BLOCK_PX) / sensor.full_scale, float)


def _notes(surveyed: Sequence[_Surveyed]) -> list[str]:
    unknown = [s.path.name for s in surveyed if s.stated_s is None]
    if not unknown:
        return []
    return [
        f"{unknown[0]}: no exposure in the headers of {len(unknown)} photographs, so those asked for are "
        "believed; a third of a stop would make the light 26 % wrong"
    ]
