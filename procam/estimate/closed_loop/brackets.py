"""Exposure brackets for the closed loop, where one exposure is too noisy in the dark parts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import AnyArray, Array
from procam.estimate.camera.exposure import MAX_EXPOSURE_S, MAX_EXPOSURES, RATIO
from procam.estimate.camera.hdr import merge_exposures
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.closed_loop.patches import (
    CELL_QUANTILE,
    MIN_PHOTOGRAPHS,
    TWO_SIDED,
    just_noticeable,
)
from procam.model.frame import Frame
from procam.model.optics import Sensor


def bracket_for(light: Array, sigma: Array, exposure_s: float) -> tuple[float, ...]:
    """Exposures [s] for a picture whose cells (n,) have `light` and, at `exposure_s`, `sigma` [rel].

    One exposure is enough if `MIN_PHOTOGRAPHS` of them resolve one JND in the dark cells, those that the
    next longer exposure would not clip. Otherwise each next one is `RATIO` times longer, until it would
    clip the darkest cells.
    """
    brightest, darkest = float(light.max()), float(np.quantile(light, 1 - CELL_QUANTILE))
    dark = light * RATIO <= brightest
    if not dark.any():
        return (exposure_s,)
    error_jnd = TWO_SIDED * sigma[dark] / just_noticeable(light[dark])
    if np.quantile(error_jnd, CELL_QUANTILE) <= np.sqrt(MIN_PHOTOGRAPHS):
        return (exposure_s,)
    longer = (
        exposure_s * RATIO**k for k in range(1, MAX_EXPOSURES) if darkest * RATIO**k <= brightest
    )
    return (exposure_s, *(e for e in longer if e <= MAX_EXPOSURE_S))


def merged_frame(frames: Sequence[Frame], sensor: Sensor, noise: NoiseLaw) -> Frame:
    """Merge frames (H, W, C) of one picture into one at the shortest exposure, with fractional counts.

    Pixels that all exposures clip are saturated in the result.
    """
    shortest = min(frames, key=lambda frame: frame.settings.exposure_s)
    exposures_s = [frame.settings.exposure_s for frame in frames]
    scale = sensor.full_scale * shortest.settings.exposure_s
    planes = []
    for c in range(shortest.counts.shape[-1]):
        counts = [frame.counts[..., c] for frame in frames]
        radiance, _ = merge_exposures(counts, exposures_s, sensor=sensor, noise=noise)
        planes.append(np.nan_to_num(radiance * scale, nan=sensor.full_scale) + sensor.black_level)
    merged: AnyArray = np.stack(planes, axis=-1)
    return replace(shortest, counts=merged, ended_s=frames[-1].ended_s)
