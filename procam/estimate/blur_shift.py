"""What a blurred picture's slopes and borders do to decoded places, and taking it out again.

A defocused point gathers light from around it, more from the brighter side: its mean place is off by
the blur's variance times the gradient of the logarithm of the light (Tweedie's formula).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from procam.estimate.clean import keep_only
from procam.maths.polynomials import fit_surface
from procam.maths.warp import blur, blur_within, edge_distance, grow, sample
from procam.model.correspondence import CorrespondenceMap

Array = NDArray[np.float64]
Map = NDArray[np.float32]
Mask = NDArray[np.bool_]
LIGHT_DEGREE, PLACE_DEGREE = 5, 5
FEWEST_PIXELS = 200
TABLE_STEP_PX = 8
HALF_LIT = 0.5  # of the light that the surroundings promise: here runs the picture's border
CLOSED_PX = 3  # gaps in the decoded area up to twice this wide are no border
NEAREST_SIGMAS = 1.2  # from the border; nearer, the place is off by more than half the blur
FARTHEST_SIGMAS = 4.0
FEWEST_SIGMAS = 10.0  # of the blur, that the decoded part of the panel spans at least
KNOWN_DOUBT = 0.2  # of a border's shift, where it is taken out whole
BEYOND_PX = 100  # of the camera: farther than any blur reaches


def undo_blur(
    found: CorrespondenceMap,
    direct: Map,
    blur_px2: Array,
    period_px: Array,
    size: tuple[int, int],
) -> CorrespondenceMap:
    """The map without the shifts that a blur of variance (2,) [px^2] along x and y makes.

    They were read off waves of periods (2,) [px]. `direct` (H, W) is the direct light, of pixels that
    are not valid too; pixels too near the border of the picture are dropped. The blur is the
    projector's: a border that the screen or the camera makes shifts nothing. Only at the edges of
    the panel of `size` is it known to be the projector's; elsewhere half the shift is taken out, and
    the other half is in the standard error.
    """
    sigma = np.sqrt(blur_px2)
    if found.valid.sum() < FEWEST_PIXELS or not blur_px2.all():
        return found
    if (np.ptp(found.projector_xy[found.valid], axis=0) < FEWEST_SIGMAS * sigma).any():
        return found  # too little of the panel to tell slopes from borders
    light = np.log(np.maximum(direct, 1e-6))
    level = _Level(found, light, found.valid)
    lit = _lit(found, direct, level.at(found)[..., 0])
    border = _Border(found, lit, sigma)
    level = _Level(found, light, border.inner)  # without the border's own fall
    moved = found.projector_xy - (blur_px2 * level.at(found)[..., 1:]).astype(np.float32)
    told = found.sigma_px.copy()
    shift = border.shifts(period_px)
    xy = found.projector_xy[border.near]
    edge = np.minimum(xy, np.array(size) - 1 - xy)
    known = np.any(edge < FARTHEST_SIGMAS * sigma, axis=1)[:, None]
    moved[border.near] -= (np.where(known, 1.0, 0.5) * shift).astype(np.float32)
    doubt = np.where(known, KNOWN_DOUBT, 0.5) * shift
    told[border.near] = np.hypot(told[border.near], doubt)
    inside = ((moved >= -0.5) & (moved <= np.array(size) - 0.5)).all(axis=-1)
    keep = lit & inside & ~border.too_near
    return keep_only(CorrespondenceMap(moved, told, found.valid), keep)


def _lit(found: CorrespondenceMap, direct: Map, level: Map) -> Mask:
    """Pixels (H, W) with at least half the light that the panel promises there.

    Judged by the light alone just outside of the decoded pixels, or their gaps would make a border.
    """
    promised = np.where(found.valid, np.exp(np.nan_to_num(level)), 0)
    around = blur_within(promised, found.valid, CLOSED_PX)
    return np.asarray((around > 0) & (direct > HALF_LIT * around))


class _Level:
    """Smooth logarithm of the direct light over the panel, as a table of its value and gradient."""

    def __init__(self, found: CorrespondenceMap, light: Map, where: Mask) -> None:
        if where.sum() < FEWEST_PIXELS:
            where = found.valid
        xy = found.projector_xy[where].astype(float)
        surface = fit_surface(xy, light[where].astype(float)[:, None], LIGHT_DEGREE)
        self._low = np.nanmin(found.projector_xy, axis=(0, 1))
        size = np.nanmax(found.projector_xy, axis=(0, 1)) - self._low
        columns, rows = (np.arange(0, n + 2 * TABLE_STEP_PX, TABLE_STEP_PX) for n in size)
        places = np.stack(np.meshgrid(columns, rows), -1) + self._low
        flat = places.reshape(-1, 2).astype(float)
        table = np.concatenate([surface(flat), surface.gradient(flat)[:, 0]], axis=1)
        self._table = table.reshape(*places.shape[:2], 3)

    def at(self, found: CorrespondenceMap) -> Map:
        """Value and gradient by x and y [1/px] (H, W, 3) at the places of a map."""
        return sample(self._table, (found.projector_xy - self._low) / TABLE_STEP_PX)


class _Border:
    """Pixels near the border of the lit area.

    `near` (H, W) marks them, `too_near` those that cannot be used, `inner` the lit rest. Distances
    are measured in the camera and carried to the panel by the inverse transpose of the map's slope.
    What is lit at the photograph's own edge goes on beyond it.
    """

    def __init__(self, found: CorrespondenceMap, lit: Mask, sigma: Array) -> None:
        rows, columns = np.nonzero(found.valid)
        seen = np.stack([columns, rows], axis=1).astype(float)
        place = fit_surface(seen, found.projector_xy[found.valid].astype(float), PLACE_DEGREE)
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

    def shifts(self, period_px: Array) -> Array:
        """Shift (N, 2) [px] of the `near` pixels towards the inside, for waves of periods (2,)."""
        wave = np.maximum(2 * np.pi * self._sigma / period_px, 1e-3)
        return self._sigma * self._normal * _pull(self._away, wave)


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
