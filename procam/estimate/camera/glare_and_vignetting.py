"""A camera and its lens measured at a desk: black level, veil of glare, vignetting.

The model is that of `procam.estimate.camera.radiance`: photographed = (1 - g) true + g mean(true) over the
image circle, then vignetting, exposure and black level. ISO 9358 measures the veil likewise: what is
seen in a black hole within a bright surround.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from procam.errors import InputError, NotEnoughData, OutOfModelRange, ShapeError
from procam.estimate.camera.radiance import Radiometer

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Pixels = NDArray[Any]

TRAP_SIGMA = 5e-4  # light of a trap's own, as a share of the mean around it
FEWEST_TRAP_PIXELS = 100
BRIGHTEST_TRAP = 0.05
UNEVEN_TRAP, SIGNIFICANT = 0.25, 5.0  # of its veil; standard errors
UNEVEN_VEIL = 0.3  # of the veil, elsewhere in the picture: one photograph cannot tell
MOST_SATURATED = 0.001
BRIGHTEST_DARK, FEWEST_DARK = 0.1, 1000
ONE_SIGMA = 0.8413  # of a normal distribution
TERMS, RINGS, SECTORS = 2, 8, 12
FEWEST_IN_RING = 20
MOST_UNEVEN, MOST_MISFIT, BRIGHTEST_RIM = 0.03, 0.02, 0.02


@dataclass(frozen=True, slots=True)
class VeilingGlare:
    """Share of the frame's mean that veils every pixel, with its standard error; `each` photograph's."""

    glare: float
    sigma: float
    each: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Vignetting:
    """1 + v1 theta^2 + v2 theta^4: `coefficients` and `sigma` (2,), seen as far out as `reach` [rad].

    `uneven`, a share of the light, is what differs round the axis: the source's fault, or the axis's.
    """

    coefficients: Array
    sigma: Array
    reach: float
    uneven: float


def linear_light(counts: Pixels, radiometer: Radiometer) -> Array:
    """Light (H, W, C) of raw counts, vignetting taken off, glare left in; NaN where saturated.

    Counts in floating point are light already, as merged exposures are: no black level is taken off,
    and nothing is saturated.
    """
    sensor, light = radiometer.camera.sensor, np.atleast_3d(counts).astype(float)
    if light.shape[:2] != radiometer.seen.shape:
        raise ShapeError("photograph", light.shape, f"{radiometer.seen.shape} as the camera's size")
    if not np.issubdtype(counts.dtype, np.floating):
        light[light >= 2**sensor.bits - 1] = np.nan
        light -= sensor.black_level
    theta2 = np.arccos(np.clip(radiometer.rays[..., 2], -1, 1)) ** 2
    fall = np.polynomial.polynomial.polyval(theta2, [1.0, *sensor.vignetting])
    return np.asarray(light / np.where(radiometer.seen, fall, 1.0)[..., None])


def black_level(dark: Pixels, bits: int) -> tuple[float, float]:
    """Counts without light and their standard error [DN], from a photograph with the cap on.

    Raises
    ------
    OutOfModelRange : it is not dark.

    Notes
    -----
    Hot pixels are left out. The standard error is that of a place in the picture, for banding and
    warm corners are no noise that averages: the spread of the means of 8x8 fields.
    """
    values = np.asarray(dark, float)
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - middle))) + 0.5
    if values.size < FEWEST_DARK:
        raise NotEnoughData(
            f"dark: got {values.size} pixels, expected {FEWEST_DARK} or more; give a whole photograph"
        )
    kept = np.where(np.abs(values - middle) < 6 * spread, values, np.nan)
    fields = np.array(
        [
            np.nanmean(field)
            for rows in np.array_split(kept, 8, axis=0)
            for field in np.array_split(rows, 8, axis=1)
            if np.isfinite(field).any()
        ]
    )
    largest, limit = float(fields.max()), BRIGHTEST_DARK * (2**bits - 1)
    shares = float(np.isfinite(kept).mean())
    if largest > limit or shares < 0.99:
        raise OutOfModelRange(
            f"dark: got up to {largest:.0f} counts, {1 - shares:.1%} of the pixels far from the rest, "
            f"expected an even photograph below {limit:.0f}; put the cap on, cover the viewfinder"
        )
    return float(np.nanmean(kept)), float(fields.std(ddof=1))


def circle_mask(shape: tuple[int, int], x: float, y: float, radius: float) -> Mask:
    """Pixels (H, W) within a circle [px]."""
    rows, columns = np.indices(shape)
    return np.asarray(np.hypot(columns - x, rows - y) <= radius)


def fit_glare(
    lights: Sequence[Array],
    traps: Sequence[Mask | tuple[float, float, float]],
    seen: Mask,
    *,
    trap_sigma: float = TRAP_SIGMA,
) -> VeilingGlare:
    """Veil of glare from photographs of a bright surround with a light trap in it.

    Parameters
    ----------
    lights : (H, W) or (H, W, C) each, linear, black and vignetting taken off; NaN where saturated.
    traps : of each photograph the trap's inside, well off its rim: a mask (H, W) or x, y, radius [px].
    seen : (H, W) the image circle, whose mean veils.
    trap_sigma : what light the trap may give off itself, as a share of the mean.

    Raises
    ------
    InputError : a trap outside the picture. NotEnoughData : a trap or a surround that is too small or
        saturated. OutOfModelRange : a trap that is lit or no trap, or darker than black.

    Notes
    -----
    In the sigma are noise, the trap's own light, the spread of the channels, and that of the
    photographs, as far as so few tell it (Student's t): a veil that differs over the picture. One
    photograph tells nothing of that; a third of the veil is taken.
    """
    if not lights or len(lights) != len(traps):
        raise InputError(
            f"glare: got {len(lights)} photographs and {len(traps)} traps, expected one trap for each"
        )
    found = []
    for number, (light, trap) in enumerate(zip(lights, traps, strict=True), start=1):
        inside = trap if isinstance(trap, np.ndarray) else circle_mask(seen.shape, *trap)
        found.append(
            _veil(f"photograph {number}", np.atleast_3d(light), (inside, seen), trap_sigma)
        )
    each, noise = np.array(found).T
    glare, count = float(each.mean()), len(each)
    uneven = UNEVEN_VEIL * glare
    if count > 1:
        uneven = float(each.std(ddof=1) * student.ppf(ONE_SIGMA, count - 1))
    parts = (trap_sigma, uneven, float(np.sqrt(np.mean(noise**2))))
    return VeilingGlare(max(glare, 0.0), float(np.linalg.norm(parts)), tuple(each.tolist()))


def _veil(
    name: str, light: Array, masks: tuple[Mask, Mask], trap_sigma: float
) -> tuple[float, float]:
    """Veil of one photograph, and its standard error by noise and channels."""
    inside, seen = masks
    if light.shape[:2] != seen.shape or inside.shape != seen.shape:
        raise ShapeError(name, light.shape[:2], f"{seen.shape} as what is seen and its trap")
    mean = _surround(name, light, seen)
    if not inside.any() or (inside & ~seen).any():
        raise InputError(
            f"glare: {name}: got a trap that is not within the picture's circle, expected all of it "
            "inside; correct x, y and radius"
        )
    values = light[inside] / mean
    if len(values) < FEWEST_TRAP_PIXELS or not np.isfinite(values).all():
        raise NotEnoughData(
            f"glare: {name}: got {len(values)} pixels of the trap, {int(np.isnan(values).sum())} of them "
            f"saturated, expected {FEWEST_TRAP_PIXELS} or more and none; go nearer with the trap"
        )
    veil = values.mean(axis=0)
    error = values.std(axis=0) / np.sqrt(len(values))
    _check_trap(name, values.mean(axis=1), inside, trap_sigma)
    spread = float(veil.std(ddof=1)) if len(veil) > 1 else 0.0
    return float(veil.mean()), float(np.hypot(spread, np.sqrt(np.mean(error**2))))


def _surround(name: str, light: Array, seen: Mask) -> Array:
    """Mean (C,) over what is seen."""
    values = light[seen]
    lost = float(np.isnan(values).any(axis=1).mean())
    if lost > MOST_SATURATED:
        raise NotEnoughData(
            f"glare: {name}: got {lost:.1%} of the picture saturated, expected {MOST_SATURATED:.1%} at "
            "most, for all of it veils; expose shorter, or dim what is brightest"
        )
    mean = np.nanmean(values, axis=0)
    if not (mean > 0).all():
        raise NotEnoughData(
            f"glare: {name}: got a mean of {mean.min():.3g} above black, expected light around the "
            "trap; is black_level right?"
        )
    return np.asarray(mean)


def _check_trap(name: str, values: Array, inside: Mask, trap_sigma: float) -> None:
    """Refuse what is no black hole: bright, darker than black, or lit in a part of it."""
    mean, noise = float(values.mean()), float(values.std())
    if mean > BRIGHTEST_TRAP:
        raise OutOfModelRange(
            f"glare: {name}: got a trap with {mean:.1%} of the mean light, expected {BRIGHTEST_TRAP:.0%} "
            "at most; line the box black, make its opening small, and aim x, y, radius at the hole"
        )
    if mean < -trap_sigma - SIGNIFICANT * noise / np.sqrt(len(values)):
        raise OutOfModelRange(
            f"glare: {name}: got a trap darker than black by {-mean:.2%} of the mean, expected black or "
            "more; photograph with the cap on and give it with --dark"
        )
    y, x = np.argwhere(inside).T
    y, x = y - y.mean(), x - x.mean()
    rim = np.hypot(x, y)
    for part in (x < 0, x > 0, y < 0, y > 0, rim < np.median(rim), rim > np.median(rim)):
        off = float(values[part].mean()) - mean
        chance = SIGNIFICANT * noise / np.sqrt(part.sum())
        if abs(off) > max(UNEVEN_TRAP * mean, chance, trap_sigma):
            raise OutOfModelRange(
                f"glare: {name}: got a trap with {mean:.2%} of the mean light and {mean + off:.2%} in a "
                f"part of it, expected them within {UNEVEN_TRAP:.0%}; it is lit, or the circle touches "
                "its rim: deepen the box, or make the radius smaller"
            )


def fit_vignetting(lights: Sequence[Array], rays: Array, seen: Mask) -> Vignetting:
    """Vignetting from photographs of an evenly lit surface that fills the picture.

    Parameters
    ----------
    lights : (H, W) or (H, W, C) each, linear, black taken off; NaN where saturated. Take four, the
        camera turned by 90 degrees about its axis after each: uneven light averages out, save what is
        uneven round the axis itself.
    rays : (H, W, 3) of the lens. seen : (H, W) what counts.

    Raises
    ------
    NotEnoughData : nothing seen, or saturated. OutOfModelRange : light that is uneven even so, or that
        no polynomial of theta^2 and theta^4 follows, or a rim brighter than the middle.

    Notes
    -----
    Fitted to the means of rings and sectors; the standard errors are a jackknife over the sectors, so
    that what differs round the axis is in them.
    """
    theta = np.arccos(np.clip(rays[..., 2], -1, 1))
    light = _averaged(lights, theta, seen)
    use = seen & np.isfinite(light)
    reach = float(theta[use].max())
    ring = np.minimum(RINGS * theta[use] / reach, RINGS - 1).astype(int)
    turn = np.arctan2(rays[use][:, 1], rays[use][:, 0])
    sector = np.minimum(SECTORS * (turn + np.pi) / (2 * np.pi), SECTORS - 1).astype(int)
    cells = _cells(ring * SECTORS + sector, theta[use], light[use])
    fitted = _polynomial(cells, np.ones(RINGS * SECTORS, bool))
    sectors = np.arange(RINGS * SECTORS) % SECTORS
    left_out = np.array([_polynomial(cells, sectors != s) for s in range(SECTORS)])
    spread = left_out - left_out.mean(axis=0)
    sigma = np.sqrt((SECTORS - 1) / SECTORS * np.sum(spread**2, axis=0))
    uneven = _check_field(cells, fitted, reach)
    return Vignetting(fitted[1:], sigma[1:], reach, uneven)


def _averaged(lights: Sequence[Array], theta: Array, seen: Mask) -> Array:
    """Mean of the photographs (H, W), each 1 near the axis."""
    total = np.zeros(seen.shape)
    near = seen & (theta <= theta[seen].max() / 4) if seen.any() else seen
    for number, light in enumerate(lights, start=1):
        if light.shape[:2] != seen.shape:
            raise ShapeError(
                f"photograph {number}", light.shape[:2], f"{seen.shape} as what is seen"
            )
        grey = np.atleast_3d(light).mean(axis=2)
        lost = float(np.isnan(grey[seen]).mean()) if seen.any() else 1.0
        if lost > MOST_SATURATED:
            raise NotEnoughData(
                f"vignetting: photograph {number}: got {lost:.1%} of it saturated, expected "
                f"{MOST_SATURATED:.1%} at most; expose shorter"
            )
        level = float(np.nanmean(grey[near])) if near.any() else 0.0
        if level <= 0:
            raise NotEnoughData(
                f"vignetting: photograph {number}: got {level:.3g} above black near the lens's axis, "
                "expected light; are f, c and black_level right?"
            )
        total += grey / level
    if not len(lights):
        raise NotEnoughData("vignetting: got no photographs, expected one or more, best four")
    return total / len(lights)


@dataclass(frozen=True, slots=True)
class _Cells:
    """Means over rings and sectors: `terms` (K, 3) of 1, theta^2, theta^4, `light`, number of pixels."""

    terms: Array
    light: Array
    pixels: Array


def _cells(index: NDArray[np.intp], theta: Array, light: Array) -> _Cells:
    count = RINGS * SECTORS
    pixels = np.bincount(index, minlength=count).astype(float)
    powers = [theta ** (2 * power) for power in range(TERMS + 1)]
    sums = [np.bincount(index, values, count) for values in (*powers, light)]
    means = np.stack(sums, axis=1) / np.maximum(pixels, 1)[:, None]
    return _Cells(means[:, :-1], means[:, -1], np.where(pixels >= FEWEST_IN_RING, pixels, 0))


def _polynomial(cells: _Cells, use: Mask) -> Array:
    """Scale, v1 and v2; every cell counts alike, be its ring wide or narrow."""
    use = use & (cells.pixels > 0)
    if use.sum() < RINGS:
        raise NotEnoughData(
            f"vignetting: got {int(use.sum())} places in the picture with enough pixels, expected "
            f"{RINGS} or more; use the whole photographs, and check the camera's f, c and size"
        )
    found = np.linalg.lstsq(cells.terms[use], cells.light[use], rcond=None)[0]
    return np.concatenate([found[:1], found[1:] / found[0]])


def _check_field(cells: _Cells, fitted: Array, reach: float) -> float:
    """How uneven the light is round the axis (rms); refuses what the polynomial does not tell."""
    model = cells.terms @ (fitted[0] * np.concatenate([[1.0], fitted[1:]]))
    left = np.where(cells.pixels > 0, cells.light / np.maximum(model, 0.01) - 1, np.nan)
    rings = left.reshape(RINGS, SECTORS)
    whole = rings[np.isfinite(rings).sum(axis=1) > SECTORS / 2]
    means = np.nanmean(whole, axis=1)
    uneven = float(np.sqrt(np.nanmean((whole - means[:, None]) ** 2)))
    if uneven > MOST_UNEVEN:
        raise OutOfModelRange(
            f"vignetting: got light that differs by {uneven:.1%} round the axis, expected "
            f"{MOST_UNEVEN:.0%} at most; light it evenly, and take four photographs with the camera turned "
            "by 90 degrees after each"
        )
    if (worst := float(np.abs(means).max())) > MOST_MISFIT:
        raise OutOfModelRange(
            f"vignetting: got light {worst:.1%} off 1 + v1 theta^2 + v2 theta^4, expected "
            f"{MOST_MISFIT:.0%} at most; does the surface fill the picture, and do f, c and k fit?"
        )
    rim = float(np.polynomial.polynomial.polyval(reach**2, [1.0, *fitted[1:]]))
    if rim > 1 + BRIGHTEST_RIM:
        raise OutOfModelRange(
            f"vignetting: got a rim at {rim:.1%} of the middle, expected {1 + BRIGHTEST_RIM:.0%} at most, "
            "for lenses darken it; the surface is lit unevenly"
        )
    return uneven
