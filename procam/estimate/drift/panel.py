"""One projector's panel: its pictures of before, and where today's picture of it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, FloatArray, Image, IndexArray
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.drift.camera_motion import CameraMotion, Seen
from procam.estimate.drift.coarse_windows import find_windows
from procam.estimate.drift.displacement import (
    Motion,
    Windows,
    fit_motion,
    follow,
    grid_places,
)
from procam.estimate.drift.pictures import (
    PanelGrid,
    PanelPictures,
    VenuePhotographs,
    texture,
)
from procam.estimate.drift.response_change import tile_index
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import project_to_camera
from procam.maths.warp import sample
from procam.model.calibration import Calibration

NO_LIGHT = 0.05  # of the light before, below which a projector shows nothing
SEEN_THEN = 0.5  # of a pixel of before
LEAST_SEEN = 0.05  # of a lit panel: less is not judged
FEWEST_LEVELS = 3  # of the tiles, for a change of the response


@dataclass(frozen=True)
class Panel:
    """One projector's grid and its pictures of before."""

    name: str
    grid: PanelGrid
    before: PanelPictures
    level_picture: FloatArray


@dataclass(frozen=True, slots=True)
class Found:
    """A panel's picture: how it is turned over, its motion and windows; None where it was not found."""

    turned_over: str
    motion: Motion | None
    windows: Windows | None


def make_panel(
    calibration: Calibration, before: VenuePhotographs, name: str, levels: FloatArray
) -> Panel:
    """A projector's panel, with the pictures of before and the picture of level tiles (H, W, C)."""
    grid = PanelGrid.of(calibration.projectors[name], calibration.screen)
    pictures = PanelPictures.of(before, name, grid.places(before.camera), grid.valid)
    return Panel(name, grid, pictures, levels)


def sample_today(panel: Panel, now: VenuePhotographs, index: Array | None = None) -> PanelPictures:
    """Today's pictures at the panel's points, or at places (h, w, 2) on the grid."""
    places: FloatArray = panel.grid.places(now.camera)
    if index is not None:
        places = sample(places, index, float("nan"))
    return PanelPictures.of(now, panel.name, places, np.ones(panel.grid.shape, bool))


def shown_light(panel: Panel, now: VenuePhotographs) -> float:
    """Light of white over that of before; NaN where the camera sees hardly any of the panel."""
    white = sample_today(panel, now).white
    good = np.isfinite(panel.before.texture) & np.isfinite(white).all(axis=-1)
    if good.sum() < LEAST_SEEN * panel.grid.valid.sum():
        return float("nan")
    return float(white[good].sum() / panel.before.white[good].sum())


def find_picture(panel: Panel, now: VenuePhotographs) -> Found:
    """Where the panel's picture is."""
    if not shown_light(panel, now) >= NO_LIGHT:
        return Found("as it was", None, None)
    turned, windows = find_windows(panel.before.texture, sample_today(panel, now).texture)
    if windows is None or turned != "as it was":
        return Found(turned, None, None)
    return Found(turned, *_follow(panel, now, fit_motion(windows, panel.grid.shape)))


def _follow(panel: Panel, now: VenuePhotographs, start: Motion) -> tuple[Motion, Windows]:
    """Exactly where it is. The texture of before is given today's levels, as far as they differ."""
    grid = panel.grid
    places, everywhere = grid.places(now.camera).astype(np.float32), np.ones(grid.shape, bool)

    def today(index: Array) -> Image:
        at = sample(places, index.astype(np.float32), float("nan"))
        return texture(now, panel.name, at, everywhere)

    motion, windows = follow(panel.before.texture, today, start)
    index = tile_index(panel.level_picture, grid.pixel)
    moved = today(grid_places(grid.shape) + motion.at(grid_places(grid.shape)))
    levels = [_median_levels(t, index) for t in (panel.before.texture, moved)]
    known = np.isfinite(levels).all(axis=0)
    old, new = (level[known] for level in levels)
    if known.sum() < FEWEST_LEVELS or not (np.diff(old) > 0).all():
        return motion, windows
    change = np.interp(np.nan_to_num(panel.before.texture), old, new - old)
    return follow(panel.before.texture + change.astype(np.float32), today, motion)


def _median_levels(texture: Image, index: IndexArray) -> Array:
    return np.array(
        [
            np.nanmedian(texture[index == i]) if np.isfinite(texture[index == i]).any() else np.nan
            for i in range(int(index.max()) + 1)
        ]
    )


def all_seen(
    panels: Sequence[Panel], now: VenuePhotographs, found: Mapping[str, Found]
) -> dict[str, Seen]:
    """Where the camera sees the panels whose pictures were found, by projector."""
    return {
        panel.name: _seen(panel, now, windows)
        for panel in panels
        if (windows := found[panel.name].windows) is not None
    }


def _seen(panel: Panel, now: VenuePhotographs, windows: Windows) -> Seen:
    """Where the camera sees the middles of the panel's windows now."""
    pixel = at_places(panel.grid.places(now.camera), windows.place + windows.shift)
    point, good = at_places(panel.grid.points(), windows.place), np.isfinite(pixel).all(axis=1)
    return Seen(point[good], pixel[good], windows.sigma[good])


def at_places(field: Array, place: Array) -> Array:
    """A smooth field (h, w, C) at places (n, 2) on its grid, (n, C); NaN outside."""
    return sample(field, place[None], float("nan"))[0].astype(float)


def from_pose(
    calibration: Calibration,
    before: VenuePhotographs,
    now: VenuePhotographs,
    motion: CameraMotion,
) -> VenuePhotographs:
    """The photographs by a camera in its new pose, without the part of the dome that was masked before."""
    radiometer = Radiometer(motion.camera)
    view = ScreenView.of(motion.camera, calibration.screen, radiometer.rays, radiometer.seen)
    then = project_to_camera(before.camera, view.points(calibration.screen).astype(float))
    seen_then = sample(before.view.on_screen.astype(np.float32), then)
    return replace(now, view=view.without(seen_then < SEEN_THEN))
