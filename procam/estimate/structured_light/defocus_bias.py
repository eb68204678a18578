"""What blur does to decoded places at borders and under slopes of light, taken out or told.

A defocused point gathers light from around it, more from the brighter side: its mean place is off by
the blur's variance times the gradient of the logarithm of the projector's flux (Tweedie's formula).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from procam.estimate.structured_light.outliers import keep_only
from procam.maths.polynomials import Surface2D, fit_surface
from procam.maths.warp import blur, blur_within, edge_distance, grow, sample
from procam.model.correspondence import CorrespondenceMap

Array = NDArray[np.float64]
Map = NDArray[np.float32]
Mask = NDArray[np.bool_]
LIGHT_DEGREE, PLACE_DEGREE = 5, 5
FEWEST_PIXELS = 200
TABLE_STEP_PX = 8
SLOPE_DOUBT = 0.5  # of the shift that all of the light's slope would make
HALF_LIT = 0.5  # of the light that the surroundings promise: here runs the picture's border
CLOSED_PX = 3  # gaps in the decoded area up to twice this wide are no border
NEAREST_SIGMAS = 1.2  # from the border; nearer, the place is off by more than half the blur
FARTHEST_SIGMAS = 4.0
FEWEST_SIGMAS = 10.0  # of the blur, that the decoded part of the panel spans at least
KNOWN_DOUBT = 0.2  # of a border's shift, where it is taken out whole
BORDER_DOUBT = 0.4  # sigmas that the border's place is uncertain by
BEYOND_PX = 100  # of the camera: farther than any blur reaches


def correct_defocus_bias(
    found: CorrespondenceMap,
    direct: Map,
    blur_px2: Array,
    period_px: Array,
    size: tuple[int, int],
) -> CorrespondenceMap:
    """The map without the shifts that a blur of variance (2,) [px^2] along x and y makes at borders.

    They were read off waves of periods (2,) [px]. `direct` (H, W) is the direct light, of pixels that
    are not valid too; pixels too near the border of the picture are dropped. The blur is the
    projector's: a border that the screen or the camera makes shifts nothing. Only at the edges of
    the panel of `size` is it known to be the projector's; elsewhere half the shift is taken out, and
    the other half is in the standard error, with what a smooth slope of the flux would shift: one
    picture cannot tell the projector's slopes from the screen's and the camera's.
    """
    sigma = np.sqrt(blur_px2)
    if found.valid.sum() < FEWEST_PIXELS or not blur_px2.all():
        return found
    if (np.ptp(found.projector_xy[found.valid], axis=0) < FEWEST_SIGMAS * sigma).any():
        return found  # too little of the panel to tell slopes from borders
    place = fit_surface(*_pairs(found, found.valid), PLACE_DEGREE)
    light = np.log(np.maximum(direct, 1e-6))
    lit = _lit(found, direct, _level(found, light, found.valid)[..., 0])
    border = _Border(found, lit, sigma, place)
    slope = _level(found, light, border.inner)[found.valid, 1:]  # without the border's own fall
    usual = SLOPE_DOUBT * blur_px2 * np.sqrt(np.mean(slope**2, axis=0))
    shared = np.where(found.valid[..., None], usual.astype(np.float32), np.float32(np.nan))
    moved, (shift, unsure) = found.projector_xy.copy(), border.shifts(period_px)
    xy = found.projector_xy[border.near]
    edge = np.minimum(xy, np.array(size) - 1 - xy)
    known = np.any(edge < FARTHEST_SIGMAS * sigma, axis=1)[:, None]
    moved[border.near] -= (np.where(known, 1.0, 0.5) * shift).astype(np.float32)
    doubt = np.hypot(np.where(known, KNOWN_DOUBT, 0.5) * shift, unsure)
    shared[border.near] = np.hypot(shared[border.near], doubt)
    told = np.hypot(found.sigma_px, shared)
    inside = ((moved >= -0.5) & (moved <= np.array(size) - 0.5)).all(axis=-1)
    keep = lit & inside & ~border.too_near
    return keep_only(CorrespondenceMap(moved, told, found.valid, shared), keep)


def _pairs(found: CorrespondenceMap, where: Mask) -> tuple[Array, Array]:
    """Camera pixels (N, 2) and the projector pixels (N, 2) they see."""
    rows, columns = np.nonzero(where)
    return np.stack([columns, rows], axis=1).astype(float), found.projector_xy[where].astype(float)


def _lit(found: CorrespondenceMap, direct: Map, level: Map) -> Mask:
    """Pixels (H, W) with at least half the light that the panel promises there.

    Judged by the light alone just outside of the decoded pixels, or their gaps would make a border.
    """
    promised = np.where(found.valid, np.exp(np.nan_to_num(level)), 0)
    around = blur_within(promised, found.valid, CLOSED_PX)
    return np.asarray((around > 0) & (direct > HALF_LIT * around))


def _level(found: CorrespondenceMap, light: Map, where: Mask) -> Map:
    """Log light, smooth over the panel, and its gradient by x and y [1/px]: (H, W, 3)."""
    used = where if where.sum() >= FEWEST_PIXELS else found.valid
    _, xy = _pairs(found, used)
    surface = fit_surface(xy, light[used].astype(float)[:, None], LIGHT_DEGREE)
    low = np.nanmin(found.projector_xy, axis=(0, 1))
    size = np.nanmax(found.projector_xy, axis=(0, 1)) - low
    columns, rows = (np.arange(0, n + 2 * TABLE_STEP_PX, TABLE_STEP_PX) for n in size)
    places = np.stack(np.meshgrid(columns, rows), -1) + low
    flat = places.reshape(-1, 2).astype(float)
    table = np.concatenate([surface(flat), surface.gradient(flat)[:, 0]], axis=1)
    return sample(table.reshape(*places.shape[:2], 3), (found.projector_xy - low) / TABLE_STEP_PX)


class _Border:
    """Pixels near the border of the lit area.

    `near` (H, W) marks them, `too_near` those that cannot be used, `inner` the lit rest. Distances
    are measured in the camera and carried to the panel by the inverse transpose of the map's slope.
    What is lit at the photograph's own edge goes on beyond it.
    """

    def __init__(self, found: CorrespondenceMap, lit: Mask, sigma: Array, place: Surface2D) -> None:
        seen, _ = _pairs(found, found.valid)
        around = np.pad(lit, BEYOND_PX, mode="edge")
        closed = grow(grow(around, CLOSED_PX), -CLOSED_PX) | around
        inside = slice(BEYOND_PX, -BEYOND_PX)
        distance = edge_distance(closed)[inside, inside]
        some = seen[:: max(1, len(seen) // 500)]
        finest = np.linalg.svd(place.gradient(some) / sigma[:, None])[1].min()  # sigmas per pixel
        self.near = found.valid & (distance < FARTHEST_SIGMAS / max(float(finest), 0.02) + 1)
        rows, columns = np.nonzero(self.near)
        down, across = np.gradient(blur(distance, 1.0))
        inward = np.stack([across, down], axis=-1)[self.near].astype(float)
        scaled = place.gradient(np.stack([columns, rows], axis=1).astype(float)) / sigma[:, None]
        transposed = np.swapaxes(scaled, 1, 2) + 1e-9 * np.eye(2)
        carried = np.linalg.solve(transposed, inward[..., None])[..., 0]
        size = np.maximum(np.linalg.norm(carried, axis=1), 1e-9)
        self._sigma, self._normal = sigma, carried / size[:, None]
        self._away = np.minimum((distance[self.near] - 0.5) / size, FARTHEST_SIGMAS)
        self.too_near = np.zeros_like(lit)
        self.too_near[self.near] = self._away <= NEAREST_SIGMAS
        self.inner = lit & found.valid
        self.inner[self.near] = self._away >= FARTHEST_SIGMAS

    def shifts(self, period_px: Array) -> tuple[Array, Array]:
        """Shift (N, 2) [px] of the `near` pixels to the inside, for waves of periods (2,); its doubt."""
        wave = np.maximum(2 * np.pi * self._sigma / period_px, 1e-3)
        scale = self._sigma * self._normal
        shift = scale * _pull(self._away, wave)
        return shift, np.abs(scale * _pull(self._away - BORDER_DOUBT, wave) - shift)


def _pull(away: Array, wave: Array) -> Array:
    """Shift (N, 2) [sigmas] inside a straight border `away` (N,) [sigmas] of waves (2,) [rad/sigma].

    A wave smeared by a Gaussian that ends at the border keeps the phase of the normal distribution
    function at the complex place away + i wave; long waves give density over distribution.
    """
    near = away < FARTHEST_SIGMAS
    shift = np.zeros((len(away), 2))
    place = away[near, None] + 1j * wave
    shift[near] = np.angle(erfc(-place / np.sqrt(2))) / wave
    return shift
