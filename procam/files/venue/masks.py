"""Manual masks: polygons of venue.toml and PNG pictures, as pixels.

`masks` are parts that are not used (a pillar before a camera, a door in the dome); `protected` parts are
measured but never compensated. They are part of venue.toml, so every solve applies them.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Array, BoolArray
from procam.errors import FileFormatError
from procam.files.images.pixels import read_image
from procam.files.venue.load import Venue
from procam.files.venue.outlines import Outline, polygon_pixels
from procam.maths.geometry.sphere import direction_from_angles, master_pixels
from procam.model.calibration import Calibration
from procam.model.mask import Mask, Nudge
from procam.model.screen import RoomScreen


def camera_masks(venue: Venue) -> dict[str, Mask]:
    """Camera pixels (H, W) that do not show the screen, by camera."""
    return {
        name: Mask(name, _covered(venue.directory, table.masks, table.size))
        for name, table in venue.table.cameras.items()
    }


def projector_masks(venue: Venue) -> dict[str, Mask]:
    """Panel pixels (H, W) that are not to be used, by projector."""
    return {
        name: Mask(name, _covered(venue.directory, table.masks, table.size))
        for name, table in venue.table.projectors.items()
    }


def screen_mask(venue: Venue, size: int) -> Mask:
    """Parts that are not screen, on its canvas of that `size`."""
    return _of_screen(venue, venue.table.screen.masks, size)


def protected_mask(venue: Venue, size: int) -> Mask:
    """Parts of the screen that are never compensated, on its canvas of that `size`."""
    return _of_screen(venue, venue.table.screen.protected, size)


def nudges(venue: Venue) -> list[Nudge]:
    """Manual shifts of all projectors."""
    return [
        Nudge(name, nudge.pixel, nudge.shift_px)
        for name, table in venue.table.projectors.items()
        for nudge in table.nudges
    ]


def manual_edits(venue: Venue) -> dict[str, Any]:
    """The masks, protected parts and nudges of venue.toml, as JSON for a calibration; {} for none.

    "masks" and "protected" list {"of": "camera NAME", "projector NAME" or the kind of screen, "corners" of a
    polygon or "file", "share" of the picture's or panel's pixels or of the screen, 0..1},
    "nudges" {"projector", "pixel", "shift_px"} [px].
    """
    table, folder = venue.table, venue.directory
    screen, protected = (
        [
            _entry(venue.screen.kind, outline, _share_of_screen(venue, outline))
            for outline in outlines
        ]
        for outlines in (table.screen.masks, table.screen.protected)
    )
    masks = [
        _entry(f"{kind} {name}", outline, float(_covered(folder, [outline], device.size).mean()))
        for kind, devices in (("camera", table.cameras), ("projector", table.projectors))
        for name, device in devices.items()
        for outline in device.masks
    ]
    moved = [
        {"projector": n.projector, "pixel": list(n.pixel), "shift_px": list(n.shift_px)}
        for n in nudges(venue)
    ]
    parts = {"masks": masks + screen, "protected": protected, "nudges": moved}
    return {name: entries for name, entries in parts.items() if entries}


def _of_screen(venue: Venue, outlines: Sequence[Outline], size: int) -> Mask:
    screen = venue.screen
    rows, columns = screen.canvas.shape(size)

    def to_pixels(outline: Outline) -> str | Array:
        if isinstance(outline, str):
            return outline
        if isinstance(screen, RoomScreen):
            return np.asarray(outline) / screen.room.size_m * [columns, rows] - 0.5
        azimuth, elevation = np.radians(outline).T
        # edges are straight in the dome master, so a polygon may enclose the pole
        return np.asarray(master_pixels(direction_from_angles(azimuth, elevation), size))

    covered = _covered(venue.directory, [to_pixels(o) for o in outlines], (columns, rows))
    return Mask("screen", covered)


def _share_of_screen(venue: Venue, outline: Outline) -> float:
    screen, size = venue.screen, venue.table.screen.map_size
    direction, inside = screen.canvas.directions(size)
    weight = screen.canvas.weights(size) * (inside & screen.contains(direction))
    marked = _of_screen(venue, [outline], size).covered
    return float(weight[marked].sum() / weight.sum())


def _entry(of: str, outline: Outline, share: float) -> dict[str, Any]:
    drawn = {"file": outline} if isinstance(outline, str) else {"corners": len(outline)}
    return {"of": of, **drawn, "share": share}


def _covered(folder: Path, outlines: Sequence[Outline | Array], size: tuple[int, int]) -> BoolArray:
    covered = np.zeros((size[1], size[0]), bool)
    for outline in outlines:
        if isinstance(outline, str):
            covered |= read_mask(folder / outline, size)
        else:
            covered |= polygon_pixels(np.asarray(outline, float), size)
    return covered


def read_mask(path: Path, size: tuple[int, int]) -> BoolArray:
    """The pixels of a PNG that are not black."""
    pixels = read_image(path)
    height, width = pixels.shape[:2]
    if (width, height) != tuple(size):
        raise FileFormatError(
            f"{path} is a mask of {width}x{height} px, and {size[0]}x{size[1]} are needed; draw it over a "
            "picture of that size"
        )
    colours = pixels[..., :3] if pixels.shape[2] > 2 else pixels[..., :1]
    return np.asarray((colours.astype(float) > 0).any(axis=2))


def protecting(venue: Venue, calibration: Calibration) -> Calibration:
    """The calibration with the parts of the dome that a person protects, if there are any."""
    mask, maps = protected_mask(venue, calibration.maps.size), calibration.maps
    protected = mask if mask.covered.any() else None
    return replace(calibration, maps=replace(maps, protected=protected))
