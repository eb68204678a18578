"""The search for columns in NumPy: the reference implementation of `search_phase`.

Arguments are checked and described in `procam.kernels.search.api`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, Image

TURN = 2 * np.pi
DARK = 1e-4  # an amplitude below this share of the offset carries no phase
SINGULAR = 1e-5  # determinant of the normal matrix over the product of its diagonal


class PhaseFit(NamedTuple):
    """Projector coordinate and its quality, float32, one shape; see `search_phase`."""

    position: Image
    variance: Image
    amplitude: Image
    offset: Image
    residual: Image
    margin: Image


def sinusoid_weights(shifts: Array) -> Array:
    """Weights (3, N) that map N frames a + b cos(phase - shift) to a, b cos(phase), b sin(phase).

    Least squares: the pseudo-inverse of the rows (1, cos shift, sin shift).
    """
    return np.linalg.pinv(np.stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)], axis=1))


def search_phase(  # noqa: PLR0913, PLR0917
    frames: Sequence[AnyArray],
    periods: Array,
    shifts: Array,
    modulation: Array,
    harmonic: Array,
    base: int,
    length: float,
    steps: int = 2,
) -> PhaseFit:
    """See `procam.kernels.search_phase`."""
    images = np.stack([frame.astype(float) for frame in frames])
    each = (-1,) + (1,) * frames[0].ndim
    terms = [values.reshape(each) for values in (periods, shifts, modulation, harmonic)]
    with np.errstate(all="ignore"):
        offset, cosine, sine = _fit_sinusoid(frames[:base], shifts[:base])
        amplitude = np.hypot(cosine, sine) / modulation[0]
        start = np.arctan2(sine, cosine) % TURN * periods[0] / TURN
        start -= periods[0] * (start >= 0.75 * periods[0])
        later = [values[base:] for values in terms]
        x, margin = _search(images[base:] - offset, amplitude, start, later, periods[0], length)
        lost = ~(amplitude > DARK * abs(offset))
        limit = periods.min() / 4
        for _ in range(steps):
            step, _, _, singular = _gauss_newton(images, offset, amplitude, x, terms)
            lost |= singular
            move = np.clip(step[2] / amplitude, -limit, limit)
            offset, amplitude, x = (
                np.where(lost, old, old + new)
                for old, new in ((offset, step[0]), (amplitude, step[1]), (x, move))
            )
            lost |= ~(amplitude > DARK * abs(offset))
        _, inverse_xx, residual, singular = _gauss_newton(images, offset, amplitude, x, terms)
        lost |= singular
        x, variance = np.where(lost, np.nan, x), np.where(lost, np.nan, inverse_xx / amplitude**2)
        unknown = ~np.isfinite(images.sum(axis=0))
    results = (x, variance, amplitude, offset, residual, margin)
    return PhaseFit(*(np.where(unknown, np.nan, r).astype(np.float32) for r in results))


def _fit_sinusoid(frames: Sequence[AnyArray], shifts: Array) -> list[Array]:
    """Offset, amplitude * cos(phase), amplitude * sin(phase) of every pixel."""
    weights = sinusoid_weights(np.asarray(shifts, dtype=float))
    return [sum(w * frame for w, frame in zip(row, frames, strict=True)) for row in weights]


def _search(
    above: Array,
    amplitude: Array,
    start: Array,
    later: list[Array],
    first_period: float,
    length: float,
) -> tuple[Array, Array]:
    """Which of start, start + first_period, ... fits the later frames best, and by what margin."""
    periods, shifts, modulation, _ = later
    wave = amplitude * modulation * np.exp(1j * (TURN * start / periods - shifts))
    best, second = np.full(start.shape, np.inf), np.full(start.shape, np.inf)
    x = start
    for k in range(candidate_count(first_period, length)):
        turned = wave * np.exp(1j * TURN * k * first_period / periods)
        residual = ((above - turned.real) ** 2).sum(axis=0)
        better = residual < best
        second = np.minimum(second, np.maximum(best, residual))
        x = np.where(better, start + k * first_period, x)
        best = np.where(better, residual, best)
    return x, second - best


def candidate_count(first_period: float, length: float) -> int:
    """Periods that begin on a panel of `length` pixels, which starts a quarter period late."""
    return int(np.ceil((length + first_period / 4) / first_period))


def _gauss_newton(
    images: Array, offset: Array, amplitude: Array, x: Array, terms: list[Array]
) -> tuple[Array, Array, Array, BoolArray]:
    """Step of (offset, amplitude, amplitude * x), inverse normal matrix [x, x], sum of squares.

    The rows of the design are (1, g, dg/dx) with g = m cos t + h cos 2t, so that the normal matrix
    does not depend on the amplitude. The last result is where it is singular.
    """
    periods, shifts, modulation, harmonic = terms
    t = TURN * x / periods - shifts
    g = modulation * np.cos(t) + harmonic * np.cos(2 * t)
    slope = -TURN / periods * (modulation * np.sin(t) + 2 * harmonic * np.sin(2 * t))
    left = images - offset - amplitude * g
    g0, slope0 = g - g.mean(axis=0), slope - slope.mean(axis=0)
    gg, gs, ss = (g0 * g0).sum(axis=0), (g0 * slope0).sum(axis=0), (slope0 * slope0).sum(axis=0)
    rg, rs = (g0 * left).sum(axis=0), (slope0 * left).sum(axis=0)
    determinant = gg * ss - gs**2
    singular = ~(determinant > SINGULAR * (g * g).sum(axis=0) * (slope * slope).sum(axis=0))
    da = (ss * rg - gs * rs) / determinant
    dx = (gg * rs - gs * rg) / determinant
    do = left.mean(axis=0) - g.mean(axis=0) * da - slope.mean(axis=0) * dx
    return np.stack([do, da, dx]), gg / determinant, (left**2).sum(axis=0), singular
