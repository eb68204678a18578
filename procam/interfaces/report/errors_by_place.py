"""Errors of a picture against elevation on a dome, and by part in a room."""

import numpy as np

from procam.arrays import Array, FloatArray
from procam.interfaces.plots import charts as plots
from procam.interfaces.report.before_after import WHOLE, BeforeAfter
from procam.interfaces.report.blocks import Charts, Table
from procam.interfaces.report.words import percent
from procam.maths.geometry.sphere import (
    angles_from_direction,
    master_directions,
    master_solid_angles,
)
from procam.model.screen import Dome, RoomScreen, Screen

BAND_DEG = 3.0
LEAST = 1e-5  # of white: less is rounding
PART_HEAD = ["Part", "Error before", "After", "After, where no limit holds", "Free of limits"]


def errors_by_place(screen: Screen, seen: BeforeAfter) -> Charts | Table:
    """The errors before and after, over the parts of the screen."""
    return _profile(seen) if isinstance(screen, Dome) else _by_part(screen, seen)


def _profile(seen: BeforeAfter) -> Charts:
    everywhere = np.ones_like(seen.free)
    free = (seen.free > WHOLE).astype(np.float32)
    before, after = seen.before - seen.target, seen.after - seen.target
    image = plots.profile_chart(
        np.arange(BAND_DEG / 2, 90, BAND_DEG, dtype=np.float64),
        _by_elevation(before, everywhere, seen.coverage),
        _by_elevation(after, everywhere, seen.coverage),
        _by_elevation(after, free, seen.coverage),
    )
    return Charts(
        [(image, "Error against elevation, before and after")],
        "The same errors averaged round the dome, by elevation from its rim (0 degrees) to the "
        "zenith (90); zero is the intended picture. The full lines on the right leave out "
        "directions where a limit holds. Rings that are mostly unlit are left out.",
        width_px=980,
    )


def _by_elevation(picture: FloatArray, share: FloatArray, coverage: FloatArray) -> Array:
    """Means (K, 3) over rings of equal elevation; NaN where a ring is mostly unlit."""
    size = len(picture)
    direction, inside = master_directions(size)
    elevation = np.degrees(angles_from_direction(direction)[1])
    ring = np.clip(elevation / BAND_DEG, 0, 90 / BAND_DEG - 1).astype(int).ravel()
    solid = master_solid_angles(size) * inside
    lit = solid * (coverage > WHOLE)
    mostly = np.bincount(ring, lit.ravel()) > 0.5 * np.bincount(ring, solid.ravel())
    columns = []
    for c in range(picture.shape[2]):
        weight = (lit * share[..., c]).ravel()
        total = np.bincount(ring, weight)
        mean = np.bincount(ring, weight * picture[..., c].ravel()) / np.maximum(total, 1e-12)
        columns.append(np.where(mostly & (total > 1e-9), mean, np.nan))
    return np.stack(columns, axis=-1)


def _by_part(screen: RoomScreen, seen: BeforeAfter) -> Table:
    """Errors of each lit part, root mean square over its lit places and colours."""
    width = seen.target.shape[1]
    part = screen.room.part[screen.canvas.raster(width).face]
    lit = seen.coverage > WHOLE
    rows = []
    for name in screen.lit:
        own = lit & (part == screen.room.names.index(name))
        weight = (seen.weight * own)[..., None] * np.ones(3)
        if not weight.any():
            rows.append([name.capitalize(), *["not lit"] * (len(PART_HEAD) - 1)])
            continue
        free = weight * (seen.free > WHOLE)
        errors = ((seen.before, weight), (seen.after, weight), (seen.after, free))
        cells = [_rms(shown - seen.target, some) for shown, some in errors]
        share = percent(float(free.sum() / max(weight.sum(), 1e-12)))
        rows.append([name.capitalize(), *cells, share])
    return Table(
        PART_HEAD,
        rows,
        "Errors of the picture on each part, of white: root mean square over what is lit.",
    )


def _rms(error: FloatArray, weight: FloatArray) -> str:
    total = float(weight.sum())
    if not total:
        return "nothing is free"
    rms = float(np.sqrt((weight * error**2).sum() / total))
    return percent(rms, 2) if rms > LEAST else "none"
