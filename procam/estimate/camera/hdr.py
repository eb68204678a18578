"""Several exposures of one picture to one radiance with a variance that holds.

Merge white, black and every plane alike; the decoder takes a merged picture with its variance.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from procam.errors import InputError, ShapeError
from procam.estimate.camera.noise import NoiseLaw
from procam.model.optics import Sensor

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
AROUND = 5  # pixels whose mean predicts: a pixel's own noise must not choose its exposures
CLEAR_SIGMAS = 4.0  # a longer exposure is used only where it cannot have saturated by noise


def merge_exposures(
    counts: Sequence[NDArray[Any]],
    exposures_s: Sequence[float],
    *,
    sensor: Sensor,
    noise: NoiseLaw,
) -> tuple[Image, Image]:
    """Radiance and its variance from exposures of the same picture.

    Parameters
    ----------
    counts : K arrays (H, W) of raw counts [DN]. exposures_s : (K,) [s], in any order.
    sensor : bits and black level. noise : variance of a signal above black [DN^2].

    Returns
    -------
    radiance, variance : (H, W) [full scale/s] and its square; NaN where all samples are saturated.

    Notes
    -----
    Weights are inverse variances of the signal that the unweighted mean predicts, not of the noisy
    sample itself, or low samples would weigh more and bias the mean. For the same reason a sample is
    rejected for what the shorter exposures predict there, beside being saturated: where it would
    saturate by noise every other time, those left would be the low ones. What is left of that bias
    is below a tenth of a sigma, for signals within the noise of that limit.

    >>> sensor, noise = Sensor(bits=8, black_level=10), NoiseLaw(1.0, 0.0)
    >>> pair = [np.full((1, 1), 34), np.full((1, 1), 106)]
    >>> radiance, _ = merge_exposures(pair, [0.1, 0.4], sensor=sensor, noise=noise)
    >>> round(float(radiance[0, 0] * sensor.full_scale), 3)  # 240 per second in both
    240.0
    """
    _check(counts, exposures_s)
    order = np.argsort(exposures_s)
    seconds = np.asarray(exposures_s, float)[order]
    signal = [np.asarray(counts[i], float) - sensor.black_level for i in order]
    sound = _usable(signal, seconds, sensor.full_scale, noise)
    rate, _ = _mean(signal, seconds, [u * e * e for u, e in zip(sound, seconds, strict=True)])
    weights = [
        u * e * e / noise.variance(np.maximum(np.nan_to_num(rate), 0) * e)
        for u, e in zip(sound, seconds, strict=True)
    ]
    rate, total = _mean(signal, seconds, weights)
    with np.errstate(divide="ignore"):
        variance = np.where(total > 0, 1 / total, np.nan)
    scale = sensor.full_scale
    return (rate / scale).astype(np.float32), (variance / scale**2).astype(np.float32)


def _check(counts: Sequence[NDArray[Any]], exposures_s: Sequence[float]) -> None:
    if not counts or len(counts) != len(exposures_s) or min(exposures_s) <= 0:
        raise InputError(
            f"exposures: got {len(counts)} pictures at {list(exposures_s)} s, expected one or more, "
            "each with its positive exposure"
        )
    for i, picture in enumerate(counts):
        if picture.shape != counts[0].shape:
            raise ShapeError(f"exposure {i}", picture.shape, f"{counts[0].shape} like the first")


def _usable(
    signal: list[Array], seconds: Array, full_scale: float, noise: NoiseLaw
) -> list[NDArray[np.bool_]]:
    """Samples (K of (H, W)) that count; each is judged by itself and by the shorter ones."""
    use = [signal[0] < full_scale]
    for k in range(1, len(signal)):
        weights = [u * e * e for u, e in zip(use, seconds[:k], strict=True)]
        rate, total = _mean(signal[:k], seconds[:k], weights)
        rate = uniform_filter(np.nan_to_num(rate, nan=full_scale / seconds[0]), AROUND)
        expected = np.maximum(rate, 0) * seconds[k]
        known = sum(
            w * noise.variance(expected * e / seconds[k])
            for w, e in zip(weights, seconds[:k], strict=True)
        )
        predicted = known * (seconds[k] / np.maximum(total, 1e-12) / AROUND) ** 2
        spread = np.sqrt(predicted + noise.variance(expected))
        clear = (total > 0) & (expected + CLEAR_SIGMAS * spread < full_scale)
        use.append(clear & (signal[k] < full_scale))
    return use


def _mean(signal: list[Array], seconds: Array, weights: list[Array]) -> tuple[Array, Array]:
    """Weighted mean rate (H, W) [DN/s] and the sum of weights; NaN where that is zero."""
    total = np.sum(weights, axis=0, dtype=float)
    summed = np.sum([w * (s / e) for w, s, e in zip(weights, signal, seconds, strict=True)], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(total > 0, summed / total, np.nan), total
