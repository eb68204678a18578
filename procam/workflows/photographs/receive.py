"""Photographs of a round, from a folder of a camera's card, put behind what was asked for."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from procam.arrays import Array
from procam.errors import FileFormatError, InputError
from procam.files.images.photos import Photo, Response, list_photos, photo_counts, read_photo
from procam.files.session import digest
from procam.maths.warp import block_mean
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor
from procam.workflows.capture.settings import common_settings, keep_settings, read_settings
from procam.workflows.photographs.by_hand import OrderRow, Rounds

SHORTEST, LONGEST = 0.5, 1.3  # times the exposure that was asked for
BLOCK_PX = 8
SAME_LIGHT, SAME_DN = 0.05, 3.0  # photographs of one picture: relative, and counts of noise
COLOURS = 3


def receive(
    rounds: Rounds, folder: Path, response: Response | None, settings: Mapping[str, float]
) -> None:
    """Store the photographs of a folder as those of the last round, in its order.

    Everything is checked before anything is stored. They count by the camera's clock, else by name.
    `settings` are the ISO and the aperture of the calibration, as far as they are known.

    Raises
    ------
    FileFormatError
        There are more or fewer than were asked for; one is of another size, exposure or picture.
    """
    if not rounds.asked:
        raise InputError(
            f"{folder}: no photographs were asked for yet; run the command without --photos first"
        )
    paths, _ = list_photos(folder)
    rows, numbers = rounds.order(), rounds.last_round
    if len(paths) != len(numbers):
        raise FileFormatError(
            f"{folder}: {len(paths)} photographs instead of {len(numbers)}: {in_words(rows)}, in this order; "
            f"give a folder of these alone"
        )
    photos = _in_time([read_photo(path) for path in paths])
    known = read_settings(rounds.session, rounds.camera.name) or settings
    common = common_settings(((p.path, (p.sensitivity, p.aperture)) for p in photos), known)
    frames = _frames(rounds, photos, response)
    _check_new(rounds, photos, frames)
    for number, frame in zip(numbers, frames, strict=True):
        shot = rounds.shot(number)
        rounds.session.store(rounds.camera.name, shot, shot.exposures_s[0], frame)
    keep_settings(rounds.session, rounds.camera.name, common)


def in_words(rows: Sequence[OrderRow]) -> str:
    """An order in a line."""
    return ", ".join(f"{row.photographs} of {row.picture} at {row.exposure_s:g} s" for row in rows)


def _in_time(photos: list[Photo]) -> list[Photo]:
    if any(photo.taken_s is None for photo in photos):
        return photos
    return sorted(photos, key=lambda photo: photo.taken_s or 0.0)


def _frames(rounds: Rounds, photos: Sequence[Photo], response: Response | None) -> list[Frame]:
    """The photographs as a driven camera would have given them, checked one against the other."""
    frames, before = list[Frame](), dict[tuple[int, float], tuple[Path, Array]]()
    sensor = rounds.camera.sensor
    for number, photo in zip(rounds.last_round, photos, strict=True):
        asked = rounds.asked[number]
        _check_size(photo, rounds)
        exposure_s = photo.exposure_s or asked.exposure_s
        if not SHORTEST <= exposure_s / asked.exposure_s <= LONGEST:
            raise FileFormatError(
                f"{photo.path}: exposed {exposure_s:g} s, but {asked.exposure_s:g} s was asked for in its "
                f"place: {in_words(rounds.order())}; is the order right?"
            )
        started_s = photo.taken_s or 0.0
        counts = photo_counts(photo, response, sensor)
        frame = Frame(counts, CameraSettings(exposure_s, "rgb"), started_s, started_s + exposure_s)
        light = _coarse(frame, sensor) / exposure_s
        same, first = before.setdefault((asked.picture, asked.exposure_s), (photo.path, light))
        noise = SAME_DN / exposure_s
        if np.abs(light - first).mean() > SAME_LIGHT * np.abs(first).mean() + noise:
            raise FileFormatError(
                f"{photo.path} differs from {same.name}, which should show the same picture; the order is "
                f"{in_words(rounds.order())}. Something moved, or a photograph is missing: take them again"
            )
        frames.append(frame)
    return frames


def _check_new(rounds: Rounds, photos: Sequence[Photo], frames: Sequence[Frame]) -> None:
    """Refuse a photograph that was given for an earlier round; those of the dark may be alike."""
    numbers = rounds.last_round
    stored = rounds.session.stored(rounds.camera.name).items()
    last = {rounds.shot(number).id for number in numbers}
    earlier = {entry.sha256 for (shot, _), entry in stored if shot not in last}
    for number, photo, frame in zip(numbers, photos, frames, strict=True):
        if rounds.asked[number].picture and digest(frame.counts) in earlier:
            raise FileFormatError(
                f"{photo.path} was given for an earlier round already; give the photographs of this one: "
                f"{in_words(rounds.order())}"
            )


def _check_size(photo: Photo, rounds: Rounds) -> None:
    height, width, channels = photo.pixels.shape
    if (width, height) != tuple(rounds.camera.size) or channels != COLOURS:
        raise FileFormatError(
            f"{photo.path}: {width}x{height} px in {channels} channels, but the calibration's camera "
            f"{rounds.camera.name} has {rounds.camera.size[0]}x{rounds.camera.size[1]} in colour; export it "
            "whole, unturned and in colour"
        )


def _coarse(frame: Frame, sensor: Sensor) -> Array:
    """Counts above black in blocks, which have little noise."""
    height, width = (n // BLOCK_PX * BLOCK_PX for n in frame.counts.shape[:2])
    counts = frame.counts[:height, :width].astype(np.float32) - np.float32(sensor.black_level)
    return np.asarray(block_mean(counts, BLOCK_PX), float)
