"""Black level, veiling glare and vignetting of a camera, from photographs taken at a desk.

All three fit the model of `procam.estimate.camera.radiance`, so the file is longer than 300 lines: observed =
(1 - g) true + g mean(true) over the image circle, then vignetting, exposure and black level. As in
ISO 9358, the light observed in a black hole within a bright surround is the glare. Vignetting is a
polynomial of the angle off the axis, fitted to means over rings and sectors of a uniform surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from procam.arrays import AnyArray, Array, BoolArray, IndexArray
from procam.errors import InputError, NotEnoughData, OutOfModelRange
from procam.estimate.camera.radiance import Radiometer
from procam.maths.statistics import robust_sigma

TRAP_SIGMA = 5e-4  # light that a trap reflects itself, as a share of the mean around it
MIN_TRAP_PIXELS = 100
MAX_TRAP_LIGHT = 0.05  # in a trap, as a share of the mean: more is no trap
MAX_TRAP_VARIATION = 0.25  # between parts of a trap, over its mean
SIGNIFICANT_SIGMAS = 5.0
GLARE_VARIATION = 0.3  # of the glare over the picture, assumed for a single photograph
MAX_SATURATED = 0.001  # of the picture
MAX_DARK_LEVEL, MIN_DARK_PIXELS = 0.1, 1000  # of full scale; of a dark photograph
HOT_SIGMAS, MIN_NORMAL = 6.0, 0.99  # of hot pixels; share of the others
ROUNDING_DN = 0.5
ONE_SIGMA = 0.8413  # quantile of a normal distribution
TERMS, RINGS, SECTORS = 2, 8, 12
MIN_CELL_PIXELS = 20
MAX_UNEVEN, MAX_MISFIT, MAX_RIM_GAIN = 0.03, 0.02, 0.02  # shares of the light


@dataclass(frozen=True, slots=True)
class VeilingGlare:
    """Veiling glare as a share of the frame's mean, its standard error, and that of `each` photograph."""

    glare: float
    sigma: float
    each: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Vignetting:
    """1 + v1 theta^2 + v2 theta^4: `coefficients` and `sigma` (2,), fitted out to `reach` [rad].

    `uneven` is the rms variation round the axis, as a share of the light. Its causes are an unevenly lit
    surface, or a wrong principal point.
    """

    coefficients: Array
    sigma: Array
    reach: float
    uneven: float


def linear_light(counts: AnyArray, radiometer: Radiometer) -> Array:
    """Light (H, W, C) of raw counts, corrected for vignetting but not for glare; NaN where saturated.

    Counts in floating point, such as merged exposures, are light already: no black level is subtracted,
    and no pixel is saturated.
    """
    sensor, light = radiometer.camera.sensor, np.atleast_3d(counts).astype(float)
    if not np.issubdtype(counts.dtype, np.floating):
        light[light >= 2**sensor.bits - 1] = np.nan
        light -= sensor.black_level
    fall = np.where(radiometer.seen, radiometer.fall(radiometer.rays), 1.0)
    return np.asarray(light / fall[..., None])


def black_level(dark: AnyArray, bits: int) -> tuple[float, float]:
    """Black level and its standard error [DN], from a photograph with the cap on.

    Raises
    ------
    NotEnoughData
        Too few pixels.
    OutOfModelRange
        The photograph is not dark.

    Notes
    -----
    Hot pixels are rejected. Banding and warm corners do not average out like noise, so the standard
    error is the standard deviation of the means of 8 x 8 fields.
    """
    values = np.asarray(dark, float)
    if values.size < MIN_DARK_PIXELS:
        raise NotEnoughData(
            f"dark: {values.size} pixels are too few; give a whole photograph, of {MIN_DARK_PIXELS} or more"
        )
    middle = float(np.median(values))
    sigma = robust_sigma(values, middle) + ROUNDING_DN
    kept = np.where(np.abs(values - middle) < HOT_SIGMAS * sigma, values, np.nan)
    fields = np.array(
        [
            np.nanmean(field)
            for rows in np.array_split(kept, 8, axis=0)
            for field in np.array_split(rows, 8, axis=1)
            if np.isfinite(field).any()
        ]
    )
    largest, limit = float(fields.max()), MAX_DARK_LEVEL * (2**bits - 1)
    normal = float(np.isfinite(kept).mean())
    if largest > limit or normal < MIN_NORMAL:
        raise OutOfModelRange(
            f"dark: the photograph has up to {largest:.0f} counts, and {1 - normal:.1%} of its pixels differ "
            f"from the rest; a dark one is uniform and below {limit:.0f}. Put the cap on and cover the "
            "viewfinder"
        )
    return float(np.nanmean(kept)), float(fields.std(ddof=1))


def circle_mask(shape: tuple[int, int], x: float, y: float, radius: float) -> BoolArray:
    """Pixels (H, W) within a circle [px]."""
    rows, columns = np.indices(shape)
    return np.asarray(np.hypot(columns - x, rows - y) <= radius)


def fit_glare(
    lights: Sequence[Array],
    traps: Sequence[tuple[float, float, float]],
    seen: BoolArray,
    *,
    trap_sigma: float = TRAP_SIGMA,
) -> VeilingGlare:
    """Veiling glare from photographs of a bright surround with a light trap in it.

    Parameters
    ----------
    lights : (H, W) or (H, W, C) each, as from `linear_light`; NaN where saturated.
    traps : per photograph the inside of the trap, clear of its rim: x, y, radius [px].
    seen : (H, W) the image circle, whose mean causes the glare.
    trap_sigma : light that the trap may reflect itself, as a share of the mean.

    Raises
    ------
    InputError
        A trap lies outside the picture.
    NotEnoughData
        A trap or its surround is too small or saturated.
    OutOfModelRange
        A trap is lit, is none, or is darker than black.

    Notes
    -----
    The standard error includes noise, the trap's own light, the scatter of the channels, and that of the
    photographs by Student's t, since glare varies over the picture. For a single photograph that
    variation is assumed to be `GLARE_VARIATION` of the glare.
    """
    found = []
    for number, (light, trap) in enumerate(zip(lights, traps, strict=True), start=1):
        inside = circle_mask(seen.shape, *trap)
        found.append(
            _glare(f"photograph {number}", np.atleast_3d(light), (inside, seen), trap_sigma)
        )
    each, noise = np.array(found).T
    glare, count = float(each.mean()), len(each)
    variation = GLARE_VARIATION * glare
    if count > 1:
        variation = float(each.std(ddof=1) * stdtrit(count - 1, ONE_SIGMA))
    parts = (trap_sigma, variation, float(np.sqrt(np.mean(noise**2))))
    return VeilingGlare(max(glare, 0.0), float(np.linalg.norm(parts)), tuple(each.tolist()))


def _glare(
    name: str, light: Array, masks: tuple[BoolArray, BoolArray], trap_sigma: float
) -> tuple[float, float]:
    """Glare of one photograph, and its standard error from noise and channels."""
    inside, seen = masks
    mean = _surround(name, light, seen)
    if not inside.any() or (inside & ~seen).any():
        raise InputError(
            f"glare: {name}: the trap is not within the image circle; correct its x, y and radius"
        )
    values = light[inside] / mean
    if len(values) < MIN_TRAP_PIXELS or not np.isfinite(values).all():
        raise NotEnoughData(
            f"glare: {name}: the trap has {len(values)} pixels, {int(np.isnan(values).sum())} of them "
            f"saturated; it needs {MIN_TRAP_PIXELS} or more without saturation. Move the trap closer"
        )
    glare = values.mean(axis=0)
    error = values.std(axis=0) / np.sqrt(len(values))
    _check_trap(name, values.mean(axis=1), inside, trap_sigma)
    scatter = float(glare.std(ddof=1)) if len(glare) > 1 else 0.0
    return float(glare.mean()), float(np.hypot(scatter, np.sqrt(np.mean(error**2))))


def _surround(name: str, light: Array, seen: BoolArray) -> Array:
    """Mean light (C,) over the image circle."""
    values = light[seen]
    lost = float(np.isnan(values).any(axis=1).mean())
    if lost > MAX_SATURATED:
        raise NotEnoughData(
            f"glare: {name}: {lost:.1%} of the picture is saturated, more than {MAX_SATURATED:.1%}; all of "
            "its light causes glare, so expose shorter or dim the brightest part"
        )
    mean = np.nanmean(values, axis=0)
    if not (mean > 0).all():
        raise NotEnoughData(
            f"glare: {name}: the mean is {mean.min():.3g} above black, but there must be light around the "
            "trap; check black_level"
        )
    return np.asarray(mean)


def _check_trap(name: str, values: Array, inside: BoolArray, trap_sigma: float) -> None:
    """Refuse a trap that is bright, darker than black, or lit in a part of it."""
    mean, noise = float(values.mean()), float(values.std())
    if mean > MAX_TRAP_LIGHT:
        raise OutOfModelRange(
            f"glare: {name}: the trap has {mean:.1%} of the mean light, more than {MAX_TRAP_LIGHT:.0%}; "
            "line the box black, make its opening small, and set x, y and radius to the hole"
        )
    if mean < -trap_sigma - SIGNIFICANT_SIGMAS * noise / np.sqrt(len(values)):
        raise OutOfModelRange(
            f"glare: {name}: the trap is darker than black by {-mean:.2%} of the mean; take a photograph "
            "with the cap on and give it with --dark"
        )
    y, x = np.argwhere(inside).T
    y, x = y - y.mean(), x - x.mean()
    rim = np.hypot(x, y)
    for part in (x < 0, x > 0, y < 0, y > 0, rim < np.median(rim), rim > np.median(rim)):
        off = float(values[part].mean()) - mean
        chance = SIGNIFICANT_SIGMAS * noise / np.sqrt(part.sum())
        if abs(off) > max(MAX_TRAP_VARIATION * mean, chance, trap_sigma):
            raise OutOfModelRange(
                f"glare: {name}: the trap has {mean:.2%} of the mean light but {mean + off:.2%} in a part "
                f"of it, more than {MAX_TRAP_VARIATION:.0%} apart. It is lit, or the circle touches its "
                "rim: deepen the box, or reduce the radius"
            )


def fit_vignetting(lights: Sequence[Array], rays: Array, seen: BoolArray) -> Vignetting:
    """Vignetting from photographs of a uniformly lit surface that fills the picture.

    Parameters
    ----------
    lights : (H, W) or (H, W, C) each, linear, black subtracted; NaN where saturated. Take four and
        rotate the camera by 90 degrees about its axis after each, which averages uneven light out.
    rays : (H, W, 3) of the lens.
    seen : (H, W) the image circle.

    Raises
    ------
    NotEnoughData
        Too few usable pixels.
    OutOfModelRange
        The mean light is uneven, does not follow the polynomial, or is brighter at the rim.

    Notes
    -----
    The polynomial is fitted to means over rings and sectors. The standard errors are a jackknife over the
    sectors, so they include variation round the axis.
    """
    theta = np.arccos(np.clip(rays[..., 2], -1, 1))
    light = _averaged(lights, theta, seen)
    use = seen & np.isfinite(light)
    reach = float(theta[use].max())
    ring = np.minimum(RINGS * theta[use] / reach, RINGS - 1).astype(int)
    azimuth = np.arctan2(rays[use][:, 1], rays[use][:, 0])
    sector = np.minimum(SECTORS * (azimuth + np.pi) / (2 * np.pi), SECTORS - 1).astype(int)
    cells = _cells(ring * SECTORS + sector, theta[use], light[use])
    fitted = _polynomial(cells, np.ones(RINGS * SECTORS, bool))
    sectors = np.arange(RINGS * SECTORS) % SECTORS
    left_out = np.array([_polynomial(cells, sectors != s) for s in range(SECTORS)])
    deviation = left_out - left_out.mean(axis=0)
    sigma = np.sqrt((SECTORS - 1) / SECTORS * np.sum(deviation**2, axis=0))
    uneven = _check_field(cells, fitted, reach)
    return Vignetting(fitted[1:], sigma[1:], reach, uneven)


def _averaged(lights: Sequence[Array], theta: Array, seen: BoolArray) -> Array:
    """Mean of the photographs (H, W), each scaled to 1 near the axis."""
    total = np.zeros(seen.shape)
    near = seen & (theta <= theta[seen].max() / 4) if seen.any() else seen
    for number, light in enumerate(lights, start=1):
        grey = np.atleast_3d(light).mean(axis=2)
        lost = float(np.isnan(grey[seen]).mean()) if seen.any() else 1.0
        if lost > MAX_SATURATED:
            raise NotEnoughData(
                f"vignetting: photograph {number}: {lost:.1%} of it is saturated, more than "
                f"{MAX_SATURATED:.1%}; expose shorter"
            )
        level = float(np.nanmean(grey[near])) if near.any() else 0.0
        if level <= 0:
            raise NotEnoughData(
                f"vignetting: photograph {number}: the light near the lens's axis is {level:.3g} above "
                "black; check f, c and black_level"
            )
        total += grey / level
    return total / len(lights)


@dataclass(frozen=True, slots=True)
class _RingSectors:
    """Means over K ring sectors: `terms` (K, 3) of 1, theta^2, theta^4, `light` (K,), number of pixels."""

    terms: Array
    light: Array
    pixels: Array


def _cells(index: IndexArray, theta: Array, light: Array) -> _RingSectors:
    count = RINGS * SECTORS
    pixels = np.bincount(index, minlength=count).astype(float)
    powers = [theta ** (2 * power) for power in range(TERMS + 1)]
    sums = [np.bincount(index, values, count) for values in (*powers, light)]
    means = np.stack(sums, axis=1) / np.maximum(pixels, 1)[:, None]
    return _RingSectors(means[:, :-1], means[:, -1], np.where(pixels >= MIN_CELL_PIXELS, pixels, 0))


def _polynomial(cells: _RingSectors, use: BoolArray) -> Array:
    """Scale, v1 and v2; all ring sectors have equal weight."""
    use = use & (cells.pixels > 0)
    if use.sum() < RINGS:
        raise NotEnoughData(
            f"vignetting: only {int(use.sum())} places in the picture have enough pixels; {RINGS} are "
            "needed. Use whole photographs, and check the camera's f, c and size"
        )
    found = np.linalg.lstsq(cells.terms[use], cells.light[use], rcond=None)[0]
    return np.concatenate([found[:1], found[1:] / found[0]])


def _check_field(cells: _RingSectors, fitted: Array, reach: float) -> float:
    """Rms variation round the axis; refuses light that contradicts the polynomial."""
    model = cells.terms @ (fitted[0] * np.concatenate([[1.0], fitted[1:]]))
    residual = np.where(cells.pixels > 0, cells.light / np.maximum(model, 0.01) - 1, np.nan)
    rings = residual.reshape(RINGS, SECTORS)
    whole = rings[np.isfinite(rings).sum(axis=1) > SECTORS / 2]
    means = np.nanmean(whole, axis=1)
    uneven = float(np.sqrt(np.nanmean((whole - means[:, None]) ** 2)))
    if uneven > MAX_UNEVEN:
        raise OutOfModelRange(
            f"vignetting: the light varies by {uneven:.1%} round the axis, more than {MAX_UNEVEN:.0%}; light "
            "the surface uniformly, and take four photographs, rotating the camera by 90 degrees after each"
        )
    if (worst := float(np.abs(means).max())) > MAX_MISFIT:
        raise OutOfModelRange(
            f"vignetting: the light is {worst:.1%} off 1 + v1 theta^2 + v2 theta^4, more than "
            f"{MAX_MISFIT:.0%}; check that the surface fills the picture and that f, c and k are right"
        )
    rim = float(np.polynomial.polynomial.polyval(reach**2, [1.0, *fitted[1:]]))
    if rim > 1 + MAX_RIM_GAIN:
        raise OutOfModelRange(
            f"vignetting: the rim is at {rim:.1%} of the centre, more than {1 + MAX_RIM_GAIN:.0%}, but "
            "lenses darken it; light the surface uniformly"
        )
    return uneven
