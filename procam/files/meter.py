"""CSV files of a hand meter's readings."""

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.maths.colour_science import colour_science
from procam.model.reading import BLACK, PATCHES, MeterReading

PLACE = ("azimuth_deg", "elevation_deg")
COLOUR = (("Y", "x", "y"), ("X", "Y", "Z"))
HEADER = f"projector,patch,{','.join(PLACE)},{','.join(COLOUR[0])} (or {','.join(COLOUR[1])})"
WIDEST_DEG = {"azimuth_deg": 360.0, "elevation_deg": 90.0}
ROUNDED = 1.01  # x + y of a saturated red, as meters round it


def read_meter(path: Path, projectors: Collection[str]) -> list[MeterReading]:
    """Readings of a file; those of the same patch, projector and place become their mean.

    The first line names the columns, in any order: projector, patch, azimuth_deg, elevation_deg, then
    Y [cd/m2], x, y or X, Y, Z [cd/m2]. Others are passed over, and so is what follows a #.

    Raises
    ------
    FileFormatError
        With file and line: a missing column, a cell that is no number or out of its range, an unknown
        patch, or a projector that is not one of `projectors`.
    """
    rows = _rows(path)
    number, header = next(rows, (1, []))
    colour = _colour_columns(path, number, header)
    found = [
        _reading(f"{path}:{number}", dict(zip(header, cells, strict=True)), colour, projectors)
        for number, cells in _as_wide(path, rows, len(header))
    ]
    if not found:
        raise FileFormatError(f"{path}: got no readings, expected lines below {HEADER}")
    return _averaged(found)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Lines with something in them: their number and cells."""
    if not path.is_file():
        raise FileFormatError(f"{path}: got no such file, expected readings: {HEADER}")
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"{path}: got bytes that are no text ({error.reason}), expected {HEADER}; save it as CSV "
            "in UTF-8"
        ) from error
    for number, line in enumerate(lines, 1):
        told = line.partition("#")[0].strip()
        if told:
            yield number, [cell.strip() for cell in next(csv.reader([told]))]


def _colour_columns(path: Path, number: int, header: Sequence[str]) -> tuple[str, ...]:
    place = [name for name in ("projector", "patch", *PLACE) if name not in header]
    missing = [[name for name in form if name not in header] for form in COLOUR]
    lacking = place + min(missing, key=len)
    if lacking:
        raise FileFormatError(
            f"{path}:{number}: got no column {', '.join(lacking)}, expected {HEADER}, with commas "
            "between"
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise FileFormatError(
            f"{path}:{number}: got column {', '.join(twice)} twice, expected each once"
        )
    return COLOUR[0] if not missing[0] else COLOUR[1]


def _as_wide(
    path: Path, rows: Iterator[tuple[int, list[str]]], width: int
) -> Iterator[tuple[int, list[str]]]:
    for number, cells in rows:
        if len(cells) != width:
            raise FileFormatError(
                f"{path}:{number}: got {len(cells)} cells, expected {width} as in the first line; write "
                "decimal points, not commas"
            )
        yield number, cells


def _reading(
    where: str, row: Mapping[str, str], colour: tuple[str, ...], projectors: Collection[str]
) -> MeterReading:
    if row["projector"] not in projectors:
        raise FileFormatError(
            f"{where}: got projector {row['projector']!r}, expected one of {', '.join(projectors)}"
        )
    patch = row["patch"].lower()
    if patch not in PATCHES:
        raise FileFormatError(
            f"{where}: got patch {row['patch']!r}, expected one of {', '.join(PATCHES)}"
        )
    azimuth, elevation = (_angle(where, row, name) for name in PLACE)
    values = np.array([_number(where, row, name) for name in colour])
    for name, value in zip(colour, values, strict=True):
        if value < 0 and name not in ("x", "y"):
            raise FileFormatError(
                f"{where}: got {name} {value:g}, expected 0 or more; write 0 for what is below the "
                "meter's range"
            )
    xyz = values if colour == COLOUR[1] else _from_chromaticity(where, *values)
    if xyz[1] == 0 and patch != BLACK:
        raise FileFormatError(
            f"{where}: got Y 0 for {patch}, expected light; was the shutter closed?"
        )
    return MeterReading(row["projector"], patch, azimuth, elevation, xyz)


def _from_chromaticity(where: str, luminance: float, x: float, y: float) -> NDArray[np.float64]:
    colour = colour_science()

    for name, value in (("x", x), ("y", y)):
        if not 0 <= value <= 1:
            raise FileFormatError(f"{where}: got {name} {value:g}, expected 0 to 1")
    if x + y > ROUNDED or (y == 0 and luminance > 0):
        raise FileFormatError(
            f"{where}: got x {x:g} and y {y:g}, expected y above 0 and x + y up to 1; are the columns "
            "what the header says?"
        )
    return np.asarray(colour.xyY_to_XYZ(np.array([x, y, luminance])), float)


def _angle(where: str, row: Mapping[str, str], name: str) -> float:
    value, widest = _number(where, row, name), WIDEST_DEG[name]
    if abs(value) > widest:
        raise FileFormatError(
            f"{where}: got {name} {value:g}, expected {-widest:g} to {widest:g} degrees"
        )
    return value


def _number(where: str, row: Mapping[str, str], name: str) -> float:
    try:
        value = float(row[name])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileFormatError(f"{where}: got {name} {row[name]!r}, expected a number")
    return value


def _averaged(readings: Sequence[MeterReading]) -> list[MeterReading]:
    """Means of what was read several times, in the order of the first; light adds, so XYZ does."""
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
