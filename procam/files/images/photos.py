"""Photographs taken without procam: pixels, header, and linear counts from them."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, Array
from procam.errors import FileFormatError
from procam.files.atomic import write_text
from procam.files.images.pixels import read_header, read_image
from procam.maths.light.curves import srgb_decode
from procam.model.optics import Sensor

SENSITIVITY = ("Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings")
SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg")
RAW_SUFFIXES = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".rw2")
Response = tuple[Array, Array]  # levels (K,), and light (K,) of all channels or (K, 3)
TITLES = (["level", "light"], ["level", "red", "green", "blue"])


@dataclass(frozen=True, slots=True)
class Photo:
    """A photograph and its header; None for what is not in the header.

    Attributes
    ----------
    pixels : (H, W, 1) or (H, W, 3) uint8 or uint16.
    exposure_s : shutter time [s]. taken_s : seconds since 1970 on the camera's clock [s].
    sensitivity : ISO. aperture : f-number.
    """

    path: Path
    pixels: AnyArray
    exposure_s: float | None
    taken_s: float | None
    sensitivity: float | None
    aperture: float | None


class Dated(Protocol):
    """What has a time on the camera's clock, as photographs do."""

    @property
    def taken_s(self) -> float | None:
        """Seconds since 1970 [s], if it is known."""
        ...


Photographed = TypeVar("Photographed", bound=Dated)


def in_time(photographs: list[Photographed]) -> list[Photographed]:
    """By the camera's clock, if all photographs carry it; else as they are."""
    if any(p.taken_s is None for p in photographs):
        return photographs
    return sorted(photographs, key=lambda p: p.taken_s or 0.0)


@dataclass(frozen=True, slots=True)
class Bracket:
    """Photographs of one still scene, their exposures [s] and the depth of their pixels [bit]."""

    paths: tuple[Path, ...]
    exposures_s: tuple[float, ...]
    bits: int

    def pixels(self) -> Iterator[AnyArray]:
        """One photograph after the other, (H, W, 1) or (H, W, 3)."""
        return (read_photo(path).pixels for path in self.paths)


def list_photos(folder: Path) -> tuple[list[Path], list[str]]:
    """Photographs of a folder, img_2 before img_10, and the names of its other files."""
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: no such folder; photographs are needed in it")
    files = sorted((p for p in folder.iterdir() if p.is_file()), key=in_order)
    photos = [p for p in files if p.suffix.lower() in SUFFIXES]
    if not photos:
        raise FileFormatError(
            f"{folder} holds no photographs ({', '.join(SUFFIXES)}); develop raw files to linear 16-bit "
            "TIFF first"
        )
    return photos, [p.name for p in files if p not in photos]


def read_photo(path: Path) -> Photo:
    """A photograph with its header; one that is cut short or damaged is refused."""
    pixels = read_image(path)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise FileFormatError(f"{path} has {pixels.dtype} pixels; export it as 16-bit TIFF")
    pixels = pixels[..., : 1 if pixels.shape[2] < 3 else 3]
    header = read_header(path)
    return Photo(
        path,
        pixels,
        _number(header, "ExposureTime"),
        _taken(header),
        _number(header, *SENSITIVITY),
        _number(header, "FNumber"),
    )


def find_bracket(folder: Path, exposures_s: Sequence[float] = ()) -> Bracket:
    """The photographs of a folder, sorted by name, with `exposures_s` or those of their headers.

    Photographs of several depths, sensitivities or apertures are refused: a response curve holds for
    one setting.
    """
    paths, _ = list_photos(folder)
    if exposures_s and len(exposures_s) != len(paths):
        raise FileFormatError(
            f"{folder}: {len(exposures_s)} exposures were given for {len(paths)} photographs; give one for "
            f"each, in this order: {', '.join(p.name for p in paths)}"
        )
    headers = [read_header(path) for path in paths]
    for what, of in (
        ("bits", lambda h: 8 * int(h.format.basesize())),
        ("ISO", lambda h: _number(h, *SENSITIVITY)),
        ("aperture f/", lambda h: _number(h, "FNumber")),
    ):
        found = {path: of(header) for path, header in zip(paths, headers, strict=True)}
        if len({value for value in found.values() if value is not None}) > 1:
            raise FileFormatError(
                f"{folder}: the photographs differ in {what} "
                f"({', '.join(f'{p.name} {v}' for p, v in found.items())}); only the shutter time may change"
            )
    exposures = exposures_s or [_exposure(p, h) for p, h in zip(paths, headers, strict=True)]
    return Bracket(tuple(paths), tuple(exposures), 8 * int(headers[0].format.basesize()))


def photo_counts(photo: Photo, response: Response | None, sensor: Sensor) -> NDArray[np.uint16]:
    """Linear counts (H, W, C) [DN] of the camera's sensor.

    Without a `response` the photograph is linear and stays as it is; 8 bits are then refused, because
    they hold encoded light in practice. With a response, full scale becomes the sensor's saturation.
    """
    pixels = photo.pixels
    if response is not None:
        return _linearised(pixels, response, sensor)
    if pixels.dtype == np.uint8:
        raise FileFormatError(
            f"{photo.path} has 8 bits, and its response is not known; develop the raw files to linear "
            '16-bit TIFF, or set response = "srgb" (or a table FILE.csv, or "solve" with brackets) for '
            "the camera in venue.toml"
        )
    if int(pixels.max()) >= 2**sensor.bits:
        raise FileFormatError(
            f"{photo.path} has values up to {int(pixels.max())}, but bits = {sensor.bits} allows less than "
            f"{2**sensor.bits}; was it scaled to 16 bits? Set bits and black_level in venue.toml to "
            "those of the files"
        )
    return np.asarray(pixels, np.uint16)


def load_response(name: str, folder: Path) -> Response | None:
    """Levels (K,) and light (K,) or (K, 3), 0..1, of a venue's `response`; None for "linear"."""
    if name == "linear":
        return None
    if name == "srgb":
        levels = np.linspace(0, 1, 4096)
        return levels, np.asarray(srgb_decode(levels), float)
    path = folder / name
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; it must hold level,light lines")
    try:
        rows = list(csv.reader(path.read_text("utf-8").splitlines()))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(
            f"{path} is not UTF-8 text ({error}); save it as CSV in UTF-8"
        ) from error
    title = [cell.strip() for cell in rows[0]] if rows else []
    try:
        lines = rows[title in TITLES :]
        table = np.array([[float(cell) for cell in row] for row in lines])
    except ValueError as error:
        raise FileFormatError(f"{path}: each line needs two numbers ({error})") from error
    columns = 4 if title == TITLES[1] else 2
    rises = table.ndim == 2 and table.shape[1] == columns and (np.diff(table, axis=0) > 0).all()
    if not rises or not np.array_equal(table[[0, -1]], np.arange(2.0)[:, None] * np.ones(columns)):
        zeros, ones = (",".join([end] * columns) for end in "01")
        raise FileFormatError(
            f"{path}: the lines {','.join(TITLES[columns == 4])} must rise from {zeros} to {ones}"
        )
    return table[:, 0], table[:, 1] if columns == 2 else table[:, 1:]


def write_response(path: Path, levels: Array, light: Array) -> None:
    """Write a response (K,) or (K, 3), as `load_response` reads it, with all digits."""
    title = TITLES[light.ndim == 2]
    lines = (
        ",".join(repr(value) for value in row) for row in np.column_stack([levels, light]).tolist()
    )
    write_text(path, "\n".join([",".join(title), *lines, ""]))


def _linearised(pixels: AnyArray, response: Response, sensor: Sensor) -> NDArray[np.uint16]:
    light = _through(pixels, response)
    return np.rint(sensor.black_level + light * sensor.full_scale).astype(np.uint16)


def _through(pixels: AnyArray, response: Response) -> Array:
    """Light (H, W, C) of encoded pixels; one channel is taken for green where channels differ."""
    levels, light = response
    top, channels = np.iinfo(pixels.dtype).max, pixels.shape[2]
    curves = light[:, None] if light.ndim == 1 else light if channels == 3 else light[:, 1:2]
    each = np.broadcast_to(curves, (len(levels), channels))
    codes = np.arange(top + 1) / top
    tables = np.stack([np.interp(codes, levels, curve) for curve in each.T])
    return np.stack([tables[c][pixels[..., c]] for c in range(channels)], axis=-1)


def _exposure(path: Path, header: Any) -> float:
    found = _number(header, "ExposureTime")
    if found is None:
        raise FileFormatError(
            f"{path} has no exposure in its header; give the exposures to `procam lens response "
            "--exposures`, which writes a curve for venue.toml"
        )
    return found


def _number(header: Any, *names: str) -> float | None:
    values = (header.getattribute(name) for name in names)
    found = next((v for v in values if v is not None), None)
    value = float(found) if isinstance(found, int | float) else 0.0
    return value if value > 0 else None


def _taken(header: Any) -> float | None:
    text = header.getattribute("Exif:DateTimeOriginal")
    try:
        moment = datetime.strptime(str(text), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    part = str(header.getattribute("Exif:SubsecTimeOriginal") or "")
    return moment.timestamp() + (float(f"0.{part}") if part.isdigit() else 0.0)


def in_order(path: Path) -> list[str | int]:
    """Sort key of pictures that puts img_2 before img_10: text and numbers alternate."""
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", path.name))]
