"""Findings of `procam doctor` in photographs of a rig that procam does not drive.

The pictures of `procam session plan` carry their numbers, so any of them will do: white and black of a
projector give its exposures, a pair of stripes the focus, photographs without a number the room.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array
from procam.errors import FileFormatError, InputError, NotEnoughData, OutOfModelRange
from procam.estimate.camera.checks import edge_blur, fit_dark_frames
from procam.estimate.camera.exposure import (
    BRIGHT_QUANTILE,
    DARK_QUANTILE,
    green,
    lit_by_brightness,
    plan_exposures,
)
from procam.estimate.camera.noise import noise_from_neighbours
from procam.files.images.photos import list_photos, load_response, photo_counts, read_photo
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.maths.codes.shot_id import read_shot_id
from procam.model.optics import Sensor
from procam.model.plan import Plan, Purpose, Shot
from procam.workflows.capture.by_hand import PREFIX
from procam.workflows.capture.decoded import with_decoded_bits
from procam.workflows.capture.ingest import named_camera
from procam.workflows.capture.session_plan import plan_of
from procam.workflows.doctor.findings import (
    CameraView,
    Diagnosis,
    View,
    judge_dark,
    judge_views,
)
from procam.workflows.events import Event, Steps

DARK_SHARE = 0.2  # of full scale: brighter photographs without a number show a picture
MAX_BLUR_PX = 2.0  # of stripes' edges in a photograph, a standard deviation
Counts = NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class _Photograph:
    """Counts (H, W, C) of a photograph and its exposure [s]."""

    counts: Counts
    exposure_s: float


@dataclass
class _Seen:
    """Photographs by what they show: each projector's pictures, and the dark ones."""

    pictures: dict[tuple[str, Purpose], list[tuple[Shot, _Photograph]]] = field(
        default_factory=dict
    )
    dark: list[_Photograph] = field(default_factory=list)

    def first(self, projector: str, purpose: Purpose) -> _Photograph | None:
        """The first photograph of a kind of picture."""
        return next((photo for _, photo in self.pictures.get((projector, purpose), ())), None)

    def stripes(self, projector: str) -> list[_Photograph]:
        """A stripe pattern and its inverse; empty if no pair was photographed."""
        sides: dict[tuple[object, object], dict[object, _Photograph]] = {}
        for shot, photo in self.pictures.get((projector, "stripes"), ()):
            kind = shot.detail["axis"], shot.detail["bit"]
            sides.setdefault(kind, {})[shot.detail["inverse"]] = photo
        return next(([pair[0], pair[1]] for pair in sides.values() if len(pair) == 2), [])


def newest_by_hand(venue: Venue) -> Session:
    """The newest session whose pictures carry numbers."""
    known = sorted((venue.directory / "sessions").glob(f"{PREFIX}[0-9]*"))
    if not known:
        raise InputError(
            f"{venue.directory}: it has no pictures yet; run: procam session plan {venue.directory} FOLDER"
        )
    return Session(known[-1])


def examine_photographs(
    venue: Venue, camera: str, folder: Path, diagnosis: Diagnosis
) -> Steps[None]:
    """Fill `diagnosis` from test photographs by one camera."""
    named_camera(venue, camera)
    venue = with_decoded_bits(venue)
    plan, (paths, _) = plan_of(venue, newest_by_hand(venue)), list_photos(folder)
    by_number = {shot.detail["number"]: shot for shot in plan.shots if "number" in shot.detail}
    seen = _Seen()
    for done, path in enumerate(paths, start=1):
        found = _photograph(venue, camera, path, diagnosis)
        diagnosis.photographs += 1
        yield Event("doctor", done, len(paths), f"{path.name} looked at")
        if found is None:
            continue
        number = read_shot_id(found.counts)
        shot = None if number is None else by_number.get(number)
        if shot is not None:
            shown = _as_planned(found, shot)
            seen.pictures.setdefault((shot.projector, shot.purpose), []).append((shot, shown))
        elif not _is_dark(found, venue.cameras[camera].sensor):
            diagnosis.add(
                f"camera {camera}",
                "unread",
                f"no number of this plan in {path.name}",
                "pictures of the newest patterns, sharp and whole",
                "focus, and show the pictures whole",
            )
        elif np.isfinite(found.exposure_s):  # room light needs the exposure
            seen.dark.append(found)
    _judge(venue, camera, plan, seen, diagnosis)


def _photograph(venue: Venue, camera: str, path: Path, diagnosis: Diagnosis) -> _Photograph | None:
    """A photograph in counts; one that cannot be used becomes a finding."""
    device, model = f"camera {camera}", venue.cameras[camera]
    try:
        photo = read_photo(path)
    except FileFormatError as error:
        diagnosis.add(device, "file", str(error), "photographs that can be read", "see above")
        return None
    values = photo.pixels
    if values.shape[2] == 1:
        diagnosis.add(
            device, "channels", f"{path.name} with one channel", "R, G and B", "develop in colour"
        )
        return None
    size = (values.shape[1], values.shape[0])
    if size != tuple(model.size):
        diagnosis.add(
            device,
            "size",
            f"{path.name} of {size[0]}x{size[1]} px",
            f"{model.size[0]}x{model.size[1]} px of venue.toml",
            "export it whole and unturned, or correct size",
        )
        return None
    step = int(np.gcd.reduce(np.unique(values)))
    too_large = int(values.max()) >= 2**model.sensor.bits
    if values.dtype == np.uint16 and too_large and step > 1 and step & (step - 1) == 0:
        bits = 16 - step.bit_length() + 1
        diagnosis.add(
            device,
            "left-aligned",
            f"{path.name} with multiples of {step} alone, {bits} bits moved up to 16",
            "values as the camera counts them",
            f"set bits = 16 and black_level times {step}, or export {bits} bits",
        )
    table = venue.table.cameras[camera]
    try:
        response = (
            load_response(table.response, venue.directory) if table.brackets is None else None
        )
        counts = photo_counts(photo, response, model.sensor)
    except FileFormatError as error:
        diagnosis.add(device, "file", str(error), "photographs that can be read", "see above")
        return None
    return _Photograph(counts, photo.exposure_s or np.nan)


def _as_planned(photograph: _Photograph, shot: Shot) -> _Photograph:
    """The photograph, exposed as the plan says where its header does not."""
    if np.isfinite(photograph.exposure_s):
        return photograph
    return replace(photograph, exposure_s=shot.exposures_s[0])


def _is_dark(photograph: _Photograph, sensor: Sensor) -> bool:
    bright = float(np.quantile(photograph.counts, BRIGHT_QUANTILE)) - sensor.black_level
    return bright < DARK_SHARE * sensor.full_scale


def _judge(venue: Venue, camera: str, plan: Plan, seen: _Seen, diagnosis: Diagnosis) -> None:
    sensor = venue.cameras[camera].sensor
    ambient_dn_s = _judge_dark(camera, seen.dark, sensor, diagnosis)
    for name in venue.table.projectors:
        white, black = (seen.first(name, purpose) for purpose in ("white", "black"))
        if white is None or black is None:
            pictures = " and ".join(
                shot.pattern for p in ("white", "black") for shot in plan.of(name, p)
            )
            diagnosis.add(
                f"projector {name}",
                "not-photographed",
                f"no photograph of {pictures or 'it, nor a picture in the newest patterns'}",
                "one of each",
                "photograph them, or see that their numbers are sharp and whole",
            )
            continue
        _judge_projector(venue, (name, camera), (white, black), ambient_dn_s, diagnosis)
        _judge_focus((name, camera), sensor.black_level, white, seen.stripes(name), diagnosis)
    judge_views(diagnosis)


def _judge_dark(
    camera: str, dark: list[_Photograph], sensor: Sensor, diagnosis: Diagnosis
) -> float:
    """Room light [DN/s]; without dark photographs none, and the black level is that of venue.toml."""
    if not dark:
        return 0.0
    short, long = min(dark, key=lambda p: p.exposure_s), max(dark, key=lambda p: p.exposure_s)
    level = sensor.black_level
    if long.exposure_s > 2 * short.exposure_s:
        both = (green(short.counts), green(long.counts))
        level, _ = fit_dark_frames(*both, (short.exposure_s, long.exposure_s))
    rate = float(np.median(green(long.counts)) - level) / long.exposure_s
    diagnosis.cameras[camera] = CameraView(level, rate / sensor.full_scale)
    judge_dark(diagnosis, f"camera {camera}", diagnosis.cameras[camera], sensor)
    return max(rate, 0.0)


def _judge_projector(
    venue: Venue,
    pair: tuple[str, str],
    photographs: tuple[_Photograph, _Photograph],
    ambient_dn_s: float,
    diagnosis: Diagnosis,
) -> None:
    """Exposures of a projector, from white and black."""
    (name, camera), (white, black) = pair, photographs
    sensor, capture = venue.cameras[camera].sensor, venue.table.capture
    both = (green(white.counts), green(black.counts))
    noise = noise_from_neighbours(both, sensor)
    try:
        plan = plan_exposures(
            white.counts,
            black.counts,
            exposures_s=(white.exposure_s, black.exposure_s),
            sensor=sensor,
            panel=venue.table.projectors[name].size,
            noise=noise,
        )
    except (OutOfModelRange, NotEnoughData) as error:
        diagnosis.add(
            f"projector {name}",
            "exposure",
            str(error),
            "white below saturation",
            "photograph it again",
        )
        return
    span, dark = _rates(both, white.exposure_s, black.exposure_s, sensor)
    lit = lit_by_brightness(span * white.exposure_s, float(np.sqrt(noise.variance(0.0))))
    darkest = float(np.quantile(span[lit], DARK_QUANTILE)) if lit.any() else 1.0
    light = float(dark[lit].mean() - ambient_dn_s) * capture.black_exposure_s if lit.any() else 0.0
    diagnosis.views[name, camera] = View(
        plan,
        plan.peak * capture.exposure_s / white.exposure_s,
        None,
        None,
        ambient_dn_s / max(darkest, 1e-9),
        light / float(np.sqrt(noise.variance(0.0))),
        black.exposure_s,
    )


def _rates(
    both: tuple[Counts, Counts], white_s: float, black_s: float, sensor: Sensor
) -> tuple[Array, Array]:
    """White less black, and black (H, W) [DN/s]."""
    white, black = (counts.astype(float) - sensor.black_level for counts in both)
    return white / white_s - black / black_s, black / black_s


def _judge_focus(
    pair: tuple[str, str],
    level: float,
    white: _Photograph,
    stripes: list[_Photograph],
    diagnosis: Diagnosis,
) -> None:
    """The blur of stripes' edges, if a picture of them and its inverse were photographed."""
    (name, camera) = pair
    if not stripes:
        return
    light = [(green(p.counts) - level) / p.exposure_s for p in (*stripes, white)]
    blur = edge_blur(*(np.asarray(x, np.float32) for x in light))
    if blur > MAX_BLUR_PX:
        diagnosis.add(
            f"projector {name}",
            "focus",
            f"edges of stripes blurred by {blur:.1f} pixels of camera {camera}",
            f"{MAX_BLUR_PX:g} or less",
            "focus the camera on the dome, then the projector",
        )
