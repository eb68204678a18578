"""Measures the changes of one projector: its picture, its sharpness, its light and its response."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.drift.displacement import Motion, blurred, grid_places, window_slices
from procam.estimate.drift.light_change import WindowLight, white_ratio
from procam.estimate.drift.panel import Found, Panel, at_places, sample_today, shown_light
from procam.estimate.drift.physical_motion import EdgeBands, edge_follows, explains_motion
from procam.estimate.drift.pictures import PanelPictures, VenuePhotographs
from procam.estimate.drift.response_change import (
    LEAST_LIGHT,
    LevelLight,
    ResponseChange,
    compare_levels,
    raised_drive,
    tile_index,
)
from procam.maths.statistics import MEDIAN_SIGMA, robust_sigma
from procam.model.calibration import Calibration
from procam.model.optics import ProjectorModel

BLUR_SHIFT, BLUR_SIGMA = 0.01, 0.022  # errors of motion and blur by a blur [grid px per grid px^2]
# of white, by a motion of one grid px: tiles get other parts of the scattered light
MOVED_SIGMA = 0.003
BLACK_SIGMA = 0.012  # relative: drift of a camera's own black level between two sessions
LEAST_BLUR2 = 0.02  # grid px^2: less is not made up for
QUARTERS = 2, 2
MotionKind = Literal["moved", "scaled", "stretched", "keystone"]
ELECTRONIC: tuple[MotionKind, ...] = ("scaled", "stretched", "keystone")
MOST_STRETCH = 0.004  # difference of the two scales
MOST_KEYSTONE = 0.006  # terms beyond what turning the projector explains
SAME_EDGE = 0.5  # of the picture's motion: the edge of the light stayed


@dataclass(frozen=True, slots=True)
class ProjectorChange:
    """What has changed of one projector.

    Attributes
    ----------
    shows : light of its white over that of before; the rest is None or NaN where it shows nothing.
    turned_over : "as it was", or how the picture is flipped.
    motion : of its picture [grid px]; None where it was not found. step : panel px per grid px.
    moved_px, moved_sigma : root mean square displacement over the panel [px].
    blur_px2, blur_sigma : rise of the variance of the blur [px^2].
    physical : whether a projector, or a lens, that moved explains where the picture went.
    edge_follows : 1 where the edge of its light moved with the picture, 0 where it stayed, None if unknown.
    response : of its levels. raised : drive that its black has become [-].
    black, black_sigma : light of black over white, relative to before.
    trend, trend_sigma : rise of white during the run, relative.
    light, light_sigma : (3,) log of each primary's light over that before, without the screen's change.
    """

    shows: float
    turned_over: str = "as it was"
    motion: Motion | None = None
    step: int = 1
    moved_px: float = float("nan")
    moved_sigma: float = float("nan")
    blur_px2: float = float("nan")
    blur_sigma: float = float("nan")
    physical: bool = False
    edge_follows: float | None = None
    response: ResponseChange | None = None
    raised: float = 0.0
    black: float = float("nan")
    black_sigma: float = float("nan")
    trend: float = 0.0
    trend_sigma: float = 1.0
    light: Array = field(default_factory=lambda: np.full(3, np.nan))
    light_sigma: Array = field(default_factory=lambda: np.full(3, np.nan))

    def kind_of_motion(self, model: ProjectorModel) -> MotionKind:
        """What moved the picture: the projector or its lens, or its electronics."""
        assert self.motion is not None
        terms = self.motion.terms
        zooms = abs(terms[1] + terms[5]) / 2 > np.hypot(terms[0], terms[3])
        if zooms and self.edge_follows is not None and self.edge_follows < SAME_EDGE:
            return "scaled"
        if self.physical:
            return "moved"
        reach = (model.size[0] / 2 / float(model.lens.focal.mean())) ** 2
        for shift, keystone in ((terms[0], terms[6]), (terms[3], terms[7])):
            by_turning = shift * reach  # a lens shift of the same size has none
            explained = np.clip(keystone, min(0, by_turning), max(0, by_turning))
            if abs(keystone - explained) > MOST_KEYSTONE:
                return "keystone"
        if abs(terms[1] - terms[5]) > MOST_STRETCH:
            return "stretched"
        return "moved"


def measure_projector(
    calibration: Calibration,
    panel: Panel,
    before: VenuePhotographs,
    now: VenuePhotographs,
    found: Found,
    scattered: Image,
) -> tuple[ProjectorChange, WindowLight | None]:
    """The change of one projector, and the light of its windows."""
    shows, motion, windows = shown_light(panel, now), found.motion, found.windows
    if motion is None or windows is None:
        return ProjectorChange(shows, found.turned_over), None
    grid, step = panel.grid, panel.grid.step
    today, matrix = sample_today(panel, now), calibration.content_from_camera.astype(np.float32)
    follows = _edge(calibration, panel, before, now, motion)
    physical = explains_motion(
        calibration.projectors[panel.name].model,
        at_places(grid.points(), windows.place + windows.shift),
        windows.place * step,
    )
    change = ProjectorChange(
        shows, motion=motion, step=step, physical=physical, edge_follows=follows
    )
    electronic = change.kind_of_motion(calibration.projectors[panel.name].model) in ELECTRONIC
    light = white_ratio(
        grid,
        panel.before.white @ matrix.T,
        today.white @ matrix.T,
        calibration.projectors[panel.name].photometry.colour_mix,
        scattered,
        None if electronic else motion,
    )
    (length, sigma), blur2 = motion.rms(grid_places(grid.shape)[grid.valid]), windows.blur2
    sharpness = float(np.median(blur2))
    spread = MEDIAN_SIGMA * robust_sigma(blur2) / np.sqrt(len(blur2))
    black, black_sigma, share = _black(panel, today)
    raised = raised_drive(calibration.projectors[panel.name].photometry, share * (black - 1))
    trend, trend_sigma = _trend(today)
    change = replace(
        change,
        moved_px=length * step,
        moved_sigma=float(np.hypot(sigma, BLUR_SHIFT * sharpness)) * step,
        blur_px2=sharpness * step**2,
        blur_sigma=float(np.hypot(spread, BLUR_SIGMA * sharpness)) * step**2,
        response=_response(panel, now, motion, sharpness, raised, calibration),
        raised=raised,
        black=black,
        black_sigma=black_sigma,
        trend=trend,
        trend_sigma=trend_sigma,
    )
    return change, light


def _edge(
    calibration: Calibration,
    panel: Panel,
    before: VenuePhotographs,
    now: VenuePhotographs,
    motion: Motion,
) -> float | None:
    model = calibration.projectors[panel.name].model
    bands = EdgeBands.of(model, calibration.screen.shape, panel.grid)
    whites = [(each.camera, each.projectors[panel.name].white) for each in (before, now)]
    return edge_follows(bands, panel.grid, whites[0], whites[1], motion)


def _response(
    panel: Panel,
    now: VenuePhotographs,
    motion: Motion,
    blur2: float,
    raised: float,
    calibration: Calibration,
) -> ResponseChange | None:
    """The change of the levels, both pictures equally sharp, where black is a drive `raised`."""
    grid, matrix = panel.grid, calibration.content_from_camera.astype(np.float32)
    today = sample_today(panel, now, grid_places(grid.shape) + motion.at(grid_places(grid.shape)))
    index = tile_index(panel.level_picture, grid.pixel)
    (levels, white), (new_levels, new_white) = (
        [
            blurred(image @ matrix.T, more) if more > LEAST_BLUR2 else image @ matrix.T
            for image in (pictures.levels, pictures.white)
        ]
        for pictures, more in ((panel.before, blur2), (today, -blur2))
    )
    old, new = LevelLight.pair(
        (levels, white), (new_levels, new_white), np.where(grid.valid, index, -1)
    )
    away = motion.rms(grid_places(grid.shape)[grid.valid])[0]
    return compare_levels(old, new.doubtful(MOVED_SIGMA * away), raised)


def _black(panel: Panel, today: PanelPictures) -> tuple[float, float, float]:
    """Black over white relative to before, its standard error, and black over white before.

    All channels together, NaN where black is not seen, or was 0: without a shutter the dark holds it too.
    """
    old, new = panel.before, today
    good = np.isfinite(old.texture) & np.isfinite(new.white).all(axis=-1)
    good &= np.isfinite(old.black).all(axis=-1) & np.isfinite(new.black).all(axis=-1)
    parts = [
        [
            float(image[part][good[part]].sum())
            for image in (old.black, old.white, new.black, new.white)
        ]
        for part in window_slices(panel.grid.shape, QUARTERS)
        if good[part].any()
    ]
    if not parts:
        return float("nan"), float("nan"), 0.0
    before, white, after, lit = np.array(parts).T
    measured = before.sum() > LEAST_LIGHT * white.sum()
    if not measured or not (before > 0).all() or not (lit > 0).all():
        return float("nan"), float("nan"), 0.0
    each = after / lit / (before / white)
    whole = float(after.sum() / lit.sum() / (before.sum() / white.sum()))
    sigma = float(np.std(each) / np.sqrt(max(1, len(each) - 1)))
    return whole, float(np.hypot(sigma, BLACK_SIGMA * whole)), float(before.sum() / white.sum())


def _trend(today: PanelPictures) -> tuple[float, float]:
    """Rise of white from its first photograph to its second, and its standard error."""
    if today.again is None:
        return 0.0, 1.0
    parts = []
    for part in window_slices(today.white.shape, QUARTERS):
        first, second = today.white[part], today.again[part]
        good = np.isfinite(first).all(axis=-1) & np.isfinite(second).all(axis=-1)
        if good.any():
            parts.append(float(second[good].sum() / first[good].sum()) - 1)
    return float(np.mean(parts)), float(np.std(parts) / np.sqrt(max(1, len(parts) - 1)))
