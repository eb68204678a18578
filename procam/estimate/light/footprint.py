"""Pixel directions, solid angles and footprint of a projector, after manual corrections."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array, Array32, FloatArray
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.pixel_directions import PixelDirections, fit_pixel_directions
from procam.estimate.geometry.screen_points import screen_points
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.areas import PanelField, cell_areas, panel_areas, panel_solid_angles
from procam.maths.geometry.local_shift import LocalShift
from procam.maths.warp import blur_within, sample, without_jumps
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Nudge
from procam.model.screen import Dome, Screen

GREEN = 1
BESIDE_PX = 1.0  # Gaussian that continues areas to pixels at the edge of an open screen
MIN_LIT_SHARE = 0.5  # of a pixel's light, for it to be part of the footprint
DARK_SHARE = 0.02  # of the brightest light, below which a share of it is not known


def project_surface(
    solution: GeometrySolution,
    name: str,
    screen: Screen,
    view: ScreenView,
    light: SeparatedLight,
    nudges: Sequence[Nudge] = (),
    moved_arcmin: float = 0.0,
) -> ProjectorSurface:
    """Pixel directions and footprint of projector `name`.

    `view` is that of the camera by which `light` was measured, `moved_arcmin` by how much it turned
    while the projector was photographed, which widens standard errors.

    Directions come from `fit_pixel_directions`. A nudge, a manual shift of the picture, changes them so
    that the picture moves; it changes neither the footprint, which `light` gives, nor the standard error.
    """
    fitted = fit_pixel_directions(solution, name)
    own = [nudge for nudge in nudges if nudge.projector == name]
    field = _nudged(fitted, own) if own else fitted.directions
    x, y = (np.arange(n, dtype=float) for n in fitted.size)
    seen = fitted.directions(x, y)
    direction = field(x, y) if own else seen
    on_screen = screen.contains(direction)
    measured = np.where(on_screen, lit_share(light, view.camera_pixels(screen, seen)), 0)
    return ProjectorSurface(
        direction.astype(np.float32),
        panel_weights(fitted.size, field, screen).astype(np.float32),
        measured > MIN_LIT_SHARE,
        measured.astype(np.float32),
        np.hypot(fitted.sigma_arcmin(x, y), np.float32(moved_arcmin)),
    )


def panel_weights(size: tuple[int, int], field: PanelField, screen: Screen) -> Array:
    """Weights (H, W) of a panel's pixels, as `ScreenView.weight`, from the directions of its points."""
    if isinstance(screen, Dome):
        return panel_solid_angles(size, field)

    def points(x: Array, y: Array) -> Array:
        direction = field(x, y)
        known = np.isfinite(direction)
        return np.where(
            known, screen_points(screen.shape, np.where(known, direction, 0.577)), np.nan
        )

    areas = panel_areas(size, points, cell_areas).astype(np.float32)
    known = np.isfinite(areas)  # at the edge of an open screen a corner misses it
    areas = np.where(known, areas, blur_within(np.nan_to_num(areas), known, BESIDE_PX))
    return without_jumps(areas, known)


def _nudged(fitted: PixelDirections, nudges: Sequence[Nudge]) -> PanelField:
    """Directions of the panel's points (x, y) [px] after manual shifts of the picture."""
    shift = LocalShift.on_panel(
        fitted.size,
        np.array([nudge.pixel for nudge in nudges]),
        np.array([nudge.shift_px for nudge in nudges]),
    )

    def directions(x: Array, y: Array) -> Array:
        xy = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
        return fitted.at(xy - shift.at(xy))

    return directions


def lit_share(light: SeparatedLight, xy: FloatArray) -> Array32:
    """Share 0..1 (...) of the expected light that the camera saw at its pixels (..., 2)."""
    extended = light.extended()[..., GREEN]
    seen, expected = sample(light.direct[..., GREEN], xy), sample(extended, xy)
    dark = DARK_SHARE * float(np.percentile(extended, 99))
    share = np.where(expected > dark, seen / np.maximum(expected, dark), 0)
    return np.asarray(np.clip(share, 0, 1), np.float32)
