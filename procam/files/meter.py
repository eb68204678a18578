"""CSV files of a hand meter's readings."""

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from procam.arrays import Array
from procam.errors import FileFormatError
from procam.maths.colour_science import colour_science
from procam.model.reading import BLACK, PATCHES, MeterReading

PLACE = ("azimuth_deg", "elevation_deg")
COLOUR = (("Y", "x", "y"), ("X", "Y", "Z"))
HEADER = f"projector,patch,{','.join(PLACE)},{','.join(COLOUR[0])} (or {','.join(COLOUR[1])})"
WIDEST_DEG = {"azimuth_deg": 360.0, "elevation_deg": 90.0}
LEAST_Y = 1e-4  # of the spectrum it is 0.005
BRIGHTEST = 1e10  # cd/m2
ROUNDED = 1.01  # x + y of a saturated red, as meters round it


def read_meter(path: Path, projectors: Collection[str]) -> list[MeterReading]:
    """Readings of a file; those of the same patch, projector and place are averaged.

    The first line names the columns, in any order: projector, patch, azimuth_deg, elevation_deg, then
    Y [cd/m2], x, y or X, Y, Z [cd/m2]. Other columns, and text after a #, are ignored.

    Raises
    ------
    FileFormatError
        A missing column, a cell that is not a number or out of its range, an unknown patch, or a
        projector that is not one of `projectors`. The message has file and line.
    """
    rows = _rows(path)
    number, header = next(rows, (1, []))
    colour = _colour_columns(path, number, header)
    found = [
        _reading(f"{path}:{number}", dict(zip(header, cells, strict=True)), colour, projectors)
        for number, cells in _require_width(path, rows, len(header))
    ]
    if not found:
        raise FileFormatError(f"{path} holds no readings; it needs lines below {HEADER}")
    return _averaged(found)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of the lines that are not empty."""
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; it must hold {HEADER}")
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"{path} is not a text file ({error.reason}); save it as CSV in UTF-8"
        ) from error
    for number, line in enumerate(lines, 1):
        if content := line.partition("#")[0].strip():
            yield number, [cell.strip() for cell in _cells(f"{path}:{number}", content)]


def _cells(where: str, content: str) -> list[str]:
    try:
        return next(csv.reader([content]))
    except csv.Error as error:  # a cell longer than a book
        raise FileFormatError(f"{where}: no line of a table ({error}); correct it") from error


def _colour_columns(path: Path, number: int, header: Sequence[str]) -> tuple[str, ...]:
    place = [name for name in ("projector", "patch", *PLACE) if name not in header]
    missing = [[name for name in form if name not in header] for form in COLOUR]
    lacking = place + min(missing, key=len)
    if lacking:
        raise FileFormatError(
            f"{path}:{number}: the column {', '.join(lacking)} is missing; the first line must be "
            f"{HEADER}, with commas between"
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise FileFormatError(
            f"{path}:{number}: there are two columns {', '.join(twice)}; remove one"
        )
    return COLOUR[0] if not missing[0] else COLOUR[1]


def _require_width(
    path: Path, rows: Iterator[tuple[int, list[str]]], width: int
) -> Iterator[tuple[int, list[str]]]:
    for number, cells in rows:
        if len(cells) != width:
            raise FileFormatError(
                f"{path}:{number}: the line has {len(cells)} cells, and the first line {width}; write "
                "decimal points, not commas"
            )
        yield number, cells


def _reading(
    where: str, row: Mapping[str, str], colour: tuple[str, ...], projectors: Collection[str]
) -> MeterReading:
    if row["projector"] not in projectors:
        raise FileFormatError(
            f"{where}: projector {row['projector']!r} is not one of {', '.join(projectors)}"
        )
    patch = row["patch"].lower()
    if patch not in PATCHES:
        raise FileFormatError(f"{where}: patch {row['patch']!r} is not one of {', '.join(PATCHES)}")
    azimuth, elevation = (_angle(where, row, name) for name in PLACE)
    values = np.array([_number(where, row, name) for name in colour])
    for name, value in zip(colour, values, strict=True):
        if value < 0 and name not in ("x", "y"):
            raise FileFormatError(
                f"{where}: {name} is {value:g}; write 0 for a value below the meter's range"
            )
        if value > BRIGHTEST:
            raise FileFormatError(
                f"{where}: {name} is {value:g} cd/m2, more than the sun's; is the unit right?"
            )
    xyz = values if colour == COLOUR[1] else _from_chromaticity(where, *values)
    if xyz[1] == 0 and patch != BLACK:
        raise FileFormatError(f"{where}: Y is 0 for {patch}; was the shutter closed?")
    return MeterReading(row["projector"], patch, azimuth, elevation, xyz)


def _from_chromaticity(where: str, luminance: float, x: float, y: float) -> Array:
    colour = colour_science()

    for name, value in (("x", x), ("y", y)):
        if not 0 <= value <= 1:
            raise FileFormatError(f"{where}: {name} is {value:g}; it must be 0 to 1")
    if x + y > ROUNDED or (y < LEAST_Y and luminance > 0):
        raise FileFormatError(
            f"{where}: x is {x:g} and y {y:g}, but y must be above 0 and x + y at most 1; are the "
            "columns those of the header?"
        )
    return np.asarray(colour.xyY_to_XYZ(np.array([x, y, luminance])), float)


def _angle(where: str, row: Mapping[str, str], name: str) -> float:
    value, widest = _number(where, row, name), WIDEST_DEG[name]
    if abs(value) > widest:
        raise FileFormatError(
            f"{where}: {name} is {value:g}; it must be {-widest:g} to {widest:g} degrees"
        )
    return value


def _number(where: str, row: Mapping[str, str], name: str) -> float:
    try:
        value = float(row[name])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileFormatError(f"{where}: {name} is {row[name]!r}; it must be a number")
    return value


def _averaged(readings: Sequence[MeterReading]) -> list[MeterReading]:
    """Means of repeated readings, in the order of the first; XYZ is averaged, because it is linear."""
    groups = dict[tuple[object, ...], list[MeterReading]]()
    for reading in readings:
        groups.setdefault((*reading.spot, reading.patch), []).append(reading)
    return [
        MeterReading(
            each[0].projector,
            each[0].patch,
            each[0].azimuth_deg,
            each[0].elevation_deg,
            np.mean([r.xyz for r in each], axis=0),
            len(each),
        )
        for each in groups.values()
    ]
