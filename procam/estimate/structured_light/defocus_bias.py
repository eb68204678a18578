"""The bias of decoded positions caused by defocus at borders and under slopes of light.

A blurred camera pixel gathers light from a neighbourhood of the panel, more from the brighter side. Its
mean position is off by the variance of the blur times the gradient of the logarithm of the projector's
flux (Tweedie's formula). At a straight border of the picture the bias of a wave has a closed form
(`_border_bias`). The projector's border is known at the edges of the panel only; elsewhere a border or a
slope of light may also belong to the screen or the camera, which cause no bias. There half of the bias
is corrected, and half of it goes into the standard error.
"""

import numpy as np
from scipy.special import erfc

from procam.arrays import Array, BoolArray, Map
from procam.estimate.structured_light.outliers import keep_only
from procam.maths.polynomials import Surface2D, fit_surface
from procam.maths.warp import blur, blur_within, edge_distance, grow, sample
from procam.model.correspondence import CorrespondenceMap

LIGHT_DEGREE, POSITION_DEGREE = 5, 5  # of the polynomials for log light and for the map
MIN_PIXELS = 200
MIN_PANEL_SIGMAS = 10.0  # of the blur, that the decoded part of the panel spans
TABLE_STEP_PX = 8
SLOPE_UNCERTAINTY = 0.5  # of the bias if all of the light's slope were the projector's
HALF_LIT = 0.5  # of the light that the surroundings predict: the border of the picture runs here
CLOSED_PX = 3  # gaps in the decoded area up to twice this wide are no border
NEAREST_SIGMAS = 1.2  # of the blur, from the border; nearer, the bias exceeds half the blur
FARTHEST_SIGMAS = 4.0  # beyond, a border causes no bias
KNOWN_BORDER_UNCERTAINTY = (
    0.2  # of the bias, at the edges of the panel, where all of it is corrected
)
BORDER_SIGMA = 0.4  # of the position of a border [sigmas of the blur]
BEYOND_PX = 100  # by which the lit area is extended past the photograph: farther than any blur


def correct_defocus_bias(
    found: CorrespondenceMap, direct: Map, blur_px2: Array, period_px: Array, size: tuple[int, int]
) -> CorrespondenceMap:
    """The map less the bias of the blur at borders, with the remaining one in its standard error.

    Pixels too near a border are dropped. The map is returned as it is where there is no blur or too
    little of the panel in view.

    Parameters
    ----------
    direct : (H, W) direct light, also of pixels that are not valid.
    blur_px2 : (2,) variance of the blur along x and y [projector px^2]. period_px : (2,) of the waves.
    size : of the panel (width, height).
    """
    sigma = np.sqrt(blur_px2)
    if found.valid.sum() < MIN_PIXELS or not blur_px2.all():
        return found
    if (np.ptp(found.projector_xy[found.valid], axis=0) < MIN_PANEL_SIGMAS * sigma).any():
        return found  # too little of the panel to distinguish slopes from borders
    light = np.log(np.maximum(direct, 1e-6))
    lit = _lit(found, direct, _smooth_light(found, light, found.valid)[..., 0])
    border = _Border(found, lit, sigma)
    shared = _slope_sigma(found, light, border.inner, blur_px2)
    moved = found.projector_xy.copy()
    correction, uncertainty = _border_correction(found, border, period_px, size)
    moved[border.near] -= correction.astype(np.float32)
    shared[border.near] = np.hypot(shared[border.near], uncertainty)
    inside = ((moved >= -0.5) & (moved <= np.array(size) - 0.5)).all(axis=-1)
    corrected = CorrespondenceMap(moved, np.hypot(found.sigma_px, shared), found.valid, shared)
    return keep_only(corrected, lit & inside & ~border.too_near)


def _slope_sigma(found: CorrespondenceMap, light: Map, inner: BoolArray, blur_px2: Array) -> Map:
    """Standard error (H, W, 2) that neighbouring pixels share because light has a slope."""
    slope = _smooth_light(found, light, inner)[found.valid, 1:]  # without the fall at the border
    usual = SLOPE_UNCERTAINTY * blur_px2 * np.sqrt(np.mean(slope**2, axis=0))
    return np.where(found.valid[..., None], usual.astype(np.float32), np.float32(np.nan))


def _border_correction(
    found: CorrespondenceMap, border: "_Border", period_px: Array, size: tuple[int, int]
) -> tuple[Array, Array]:
    """Bias (N, 2) [px] to subtract from the pixels near a border, and the error of what remains."""
    bias, unsure = border.bias(period_px)
    xy = found.projector_xy[border.near]
    edge = np.minimum(xy, np.array(size) - 1 - xy)
    known = np.any(edge < FARTHEST_SIGMAS * border.sigma, axis=1)[:, None]
    uncertainty = np.hypot(np.where(known, KNOWN_BORDER_UNCERTAINTY, 0.5) * bias, unsure)
    return np.where(known, 1.0, 0.5) * bias, uncertainty


def _pairs(found: CorrespondenceMap, where: BoolArray) -> tuple[Array, Array]:
    """Camera pixels (N, 2) and the projector pixels (N, 2) they see."""
    rows, columns = np.nonzero(where)
    return np.stack([columns, rows], axis=1).astype(float), found.projector_xy[where].astype(float)


def _lit(found: CorrespondenceMap, direct: Map, level: Map) -> BoolArray:
    """Pixels (H, W) with at least half the light that the smooth `level` predicts there.

    Includes pixels just outside the decoded ones, so that gaps between these are no borders.
    """
    predicted = np.where(found.valid, np.exp(np.nan_to_num(level)), 0)
    around = blur_within(predicted, found.valid, CLOSED_PX)
    return np.asarray((around > 0) & (direct > HALF_LIT * around))


def _smooth_light(found: CorrespondenceMap, light: Map, where: BoolArray) -> Map:
    """Polynomial of the log light over the panel, and its gradient by x and y [1/px]: (H, W, 3)."""
    used = where if where.sum() >= MIN_PIXELS else found.valid
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
    """Pixels near the border of the lit area, and the bias there.

    `near` (H, W) marks them, `too_near` those that cannot be used, `inner` the lit rest. Distances
    are measured in the camera and converted to the panel by the inverse transpose of the map's slope.
    The lit area is taken to continue beyond the edge of the photograph.
    """

    def __init__(self, found: CorrespondenceMap, lit: BoolArray, sigma: Array) -> None:
        self.sigma = sigma
        seen, xy = _pairs(found, found.valid)
        position = fit_surface(seen, xy, POSITION_DEGREE)
        around = np.pad(lit, BEYOND_PX, mode="edge")
        closed = grow(grow(around, CLOSED_PX), -CLOSED_PX) | around
        inside = slice(BEYOND_PX, -BEYOND_PX)
        distance = edge_distance(closed)[inside, inside]
        some = seen[:: max(1, len(seen) // 500)]
        finest = np.linalg.svd(position.gradient(some) / sigma[:, None])[
            1
        ].min()  # sigmas per pixel
        self.near = found.valid & (distance < FARTHEST_SIGMAS / max(float(finest), 0.02) + 1)
        normal = self._panel_normal(distance, position)
        length = np.maximum(np.linalg.norm(normal, axis=1), 1e-9)
        self._normal = normal / length[:, None]
        self._away = np.minimum((distance[self.near] - 0.5) / length, FARTHEST_SIGMAS)
        self.too_near = np.zeros_like(lit)
        self.too_near[self.near] = self._away <= NEAREST_SIGMAS
        self.inner = lit & found.valid
        self.inner[self.near] = self._away >= FARTHEST_SIGMAS

    def _panel_normal(self, distance: Map, position: Surface2D) -> Array:
        """Inward normal (N, 2) of the border on the panel, as long as a sigma in camera pixels."""
        rows, columns = np.nonzero(self.near)
        down, across = np.gradient(blur(distance, 1.0))
        inward = np.stack([across, down], axis=-1)[self.near].astype(float)
        slope = position.gradient(np.stack([columns, rows], axis=1).astype(float))
        transposed = np.swapaxes(slope / self.sigma[:, None], 1, 2) + 1e-9 * np.eye(2)
        return np.asarray(np.linalg.solve(transposed, inward[..., None])[..., 0])

    def bias(self, period_px: Array) -> tuple[Array, Array]:
        """Bias (N, 2) [px] of the `near` pixels for waves of periods (2,), and its standard error."""
        wave = np.maximum(2 * np.pi * self.sigma / period_px, 1e-3)
        scale = self.sigma * self._normal
        bias = scale * _border_bias(self._away, wave)
        return bias, np.abs(scale * _border_bias(self._away - BORDER_SIGMA, wave) - bias)


def _border_bias(away: Array, wave: Array) -> Array:
    """Inward bias (N, 2) [sigmas] `away` (N,) [sigmas] from a straight border, of waves (2,) [rad/sigma].

    A wave blurred by a Gaussian and cut off at the border has the phase of the normal distribution
    function at the complex position away + i wave. For long waves the bias is density over distribution.
    """
    near = away < FARTHEST_SIGMAS
    bias = np.zeros((len(away), 2))
    position = away[near, None] + 1j * wave
    bias[near] = np.angle(erfc(-position / np.sqrt(2))) / wave
    return bias
