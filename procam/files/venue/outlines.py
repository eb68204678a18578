"""Outlines in venue.toml: a polygon or the name of a PNG, the pixels they cover, and their checks."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Discriminator, FiniteFloat, Tag

from procam.arrays import BoolArray, FloatArray

Corner = tuple[float, float]
Polygon = list[tuple[FiniteFloat, FiniteFloat]]
# a polygon, or the name of a PNG beside venue.toml; the tags give one message for a mistake, not two
Outline = Annotated[
    Annotated[str, Tag("file")] | Annotated[Polygon, Tag("polygon")],
    Discriminator(lambda entry: "file" if isinstance(entry, str) else "polygon"),
]
MIN_CORNERS = 3


def polygon_pixels(corners: FloatArray, size: tuple[int, int]) -> BoolArray:
    """Pixels (H, W) whose centres lie inside a polygon (N, 2) [px], by the even-odd rule.

    Where edges cross, what is enclosed twice is outside. A centre on an edge belongs to the polygon
    on one side of it only, so that neighbours share no pixel.

    >>> polygon_pixels(np.array([[0.5, -0.5], [2.5, -0.5], [2.5, 0.5], [0.5, 0.5]]), (4, 1)).tolist()
    [[False, True, True, False]]
    """
    width, height = size
    inside = np.zeros((height, width), bool)
    columns = np.arange(width)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low, high = sorted((y0, y1))
        rows = np.arange(max(0, int(np.ceil(low))), min(height, int(np.ceil(high))))
        crossing = x0 + (rows - y0) * (x1 - x0) / (y1 - y0) if len(rows) else rows
        inside[rows] ^= columns[None, :] >= np.asarray(crossing)[:, None]
    return inside


def is_within(pixel: tuple[float, float], size: tuple[int, int]) -> bool:
    """Whether a place lies on a picture or panel, its outermost pixels' edges included."""
    return all(-0.5 <= at <= count - 0.5 for at, count in zip(pixel, size, strict=True))


def file_mistakes(where: str, outlines: Sequence[Outline], folder: Path) -> list[str]:
    """One line for each picture of a mask that does not exist."""
    return [
        f"{where}.{number}: {folder / outline}: no such file; a PNG is needed there"
        for number, outline in enumerate(outlines)
        if isinstance(outline, str) and not (folder / outline).is_file()
    ]


def pixel_mistakes(where: str, outlines: Sequence[Outline], size: tuple[int, int]) -> list[str]:
    """One line for each mistake in polygons in pixels of a device of `size`."""
    width, height = size
    limits = f"-0.5..{width - 0.5} and -0.5..{height - 0.5} px; clip the polygon to the picture"
    return _mistakes(where, outlines, lambda corner: is_within(corner, size), limits)


def dome_mistakes(where: str, outlines: Sequence[Outline]) -> list[str]:
    """One line for each mistake in polygons of [azimuth_deg, elevation_deg]."""
    limits = "azimuth -360..360 and elevation 0..90 degrees; clip the polygon to the dome master"
    return _mistakes(where, outlines, lambda c: abs(c[0]) <= 360 and 0 <= c[1] <= 90, limits)


def canvas_mistakes(
    where: str, outlines: Sequence[Outline], size_m: tuple[float, float]
) -> list[str]:
    """One line for each mistake in polygons in metres on a canvas of that width and height."""
    width, height = size_m
    limits = f"the canvas of {width:g} x {height:g} m; clip the polygon to it"
    within = lambda c: 0 <= c[0] <= width and 0 <= c[1] <= height  # noqa: E731
    return _mistakes(where, outlines, within, limits)


def _mistakes(
    where: str, outlines: Sequence[Outline], is_inside: Callable[[Corner], bool], limits: str
) -> list[str]:
    """Polygons of too few corners, and the first corner of each that lies outside `limits`."""
    polygons = [(i, outline) for i, outline in enumerate(outlines) if not isinstance(outline, str)]
    found = [
        f"{where}.{number} is a polygon of {len(corners)} corners; it needs at least {MIN_CORNERS}"
        for number, corners in polygons
        if len(corners) < MIN_CORNERS
    ]
    for number, corners in polygons:
        off = next((corner for corner in corners if not is_inside(corner)), None)
        if off is not None:
            found.append(f"{where}.{number}: the corner {list(off)} lies outside {limits}")
    return found
