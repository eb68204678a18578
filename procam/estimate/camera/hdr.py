"""Several exposures of one picture merged to one radiance with its variance.

White, black and all patterns must be merged alike; the decoder takes merged pictures with variances.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter

from procam.arrays import AnyArray, Array, BoolArray, Image
from procam.estimate.camera.noise import NoiseLaw
from procam.model.optics import Sensor

WINDOW_PX = 5  # of the mean that selects exposures: a pixel's own noise must not select its own
CLEAR_SIGMAS = 4.0  # of noise between the expected level and saturation, for a sample to count


def merge_exposures(
    counts: Sequence[AnyArray], exposures_s: Sequence[float], *, sensor: Sensor, noise: NoiseLaw
) -> tuple[Image, Image]:
    """Merge exposures of one picture.

    Parameters
    ----------
    counts : K arrays (H, W) of raw counts [DN].
    exposures_s : (K,) [s], in any order.
    sensor : bits and black level.
    noise : variance of a signal above black [DN^2].

    Returns
    -------
    radiance, variance : (H, W) [full scale/s] and its square; NaN where all samples are saturated.

    Notes
    -----
    The weights are inverse variances at the level that a first, unweighted mean predicts. Variances at
    the noisy sample itself would give low samples more weight and bias the mean. For the same reason a
    sample is also rejected where the shorter exposures predict that noise may saturate it: only the low
    samples would remain. The residual bias near that limit is below a tenth of a sigma.

    >>> sensor, noise = Sensor(bits=8, black_level=10), NoiseLaw(1.0, 0.0)
    >>> pair = [np.full((1, 1), 34), np.full((1, 1), 106)]
    >>> radiance, _ = merge_exposures(pair, [0.1, 0.4], sensor=sensor, noise=noise)
    >>> round(float(radiance[0, 0] * sensor.full_scale), 3)  # 240 per second in both
    240.0
    """
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


def _usable(
    signal: list[Array], seconds: Array, full_scale: float, noise: NoiseLaw
) -> list[BoolArray]:
    """Masks (K of (H, W)) of the samples to use, judged by themselves and by shorter exposures."""
    use = [signal[0] < full_scale]
    for k in range(1, len(signal)):
        weights = [u * e * e for u, e in zip(use, seconds[:k], strict=True)]
        rate, total = _mean(signal[:k], seconds[:k], weights)
        rate = uniform_filter(np.nan_to_num(rate, nan=full_scale / seconds[0]), WINDOW_PX)
        expected = np.maximum(rate, 0) * seconds[k]
        summed = sum(
            w * noise.variance(expected * e / seconds[k])
            for w, e in zip(weights, seconds[:k], strict=True)
        )
        predicted = summed * (seconds[k] / np.maximum(total, 1e-12) / WINDOW_PX) ** 2
        sigma = np.sqrt(predicted + noise.variance(expected))
        clear = (total > 0) & (expected + CLEAR_SIGMAS * sigma < full_scale)
        use.append(clear & (signal[k] < full_scale))
    return use


def _mean(signal: list[Array], seconds: Array, weights: list[Array]) -> tuple[Array, Array]:
    """Weighted mean rate (H, W) [DN/s], NaN where all weights are 0, and the sum of weights."""
    total = np.sum(weights, axis=0, dtype=float)
    summed = np.sum([w * (s / e) for w, s, e in zip(weights, signal, seconds, strict=True)], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(total > 0, summed / total, np.nan), total
