"""Brackets for the closed loop: one photograph from several where one exposure cannot hold the picture."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.camera.exposure import MAX_EXPOSURE_S, MAX_EXPOSURES, RATIO
from procam.estimate.camera.hdr import merge_exposures
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.closed_loop.patches import ALMOST_ALL, FEWEST, TWO_SIDED, just_noticeable
from procam.model.frame import Frame
from procam.model.optics import Sensor

Array = NDArray[np.float64]


def bracket_for(light: Array, sigma: Array, exposure_s: float) -> tuple[float, ...]:
    """Exposures [s] that hold a picture's cells of `light` (n,) with `sigma` (n,) at `exposure_s` [rel].

    One alone if it shows the dark cells, those that a longer one would not clip, to a JND with as many
    photographs as are taken anyway. Else each next is `RATIO` times longer, until it would clip the darkest.
    """
    brightest, darkest = float(light.max()), float(np.quantile(light, 1 - ALMOST_ALL))
    dark = light * RATIO <= brightest
    if not dark.any():
        return (exposure_s,)
    blur = TWO_SIDED * sigma[dark] / just_noticeable(light[dark])
    if np.quantile(blur, ALMOST_ALL) <= np.sqrt(FEWEST):
        return (exposure_s,)
    longer = (
        exposure_s * RATIO**k for k in range(1, MAX_EXPOSURES) if darkest * RATIO**k <= brightest
    )
    return (exposure_s, *(e for e in longer if e <= MAX_EXPOSURE_S))


def merged_frame(frames: Sequence[Frame], sensor: Sensor, noise: NoiseLaw) -> Frame:
    """Frames (H, W, C) of one picture as a single one at the shortest exposure, in finer counts.

    What all exposures clip has the counts of saturation.
    """
    shortest = min(frames, key=lambda frame: frame.settings.exposure_s)
    exposures_s = [frame.settings.exposure_s for frame in frames]
    scale = sensor.full_scale * shortest.settings.exposure_s
    planes = []
    for c in range(shortest.counts.shape[-1]):
        counts = [frame.counts[..., c] for frame in frames]
        radiance, _ = merge_exposures(counts, exposures_s, sensor=sensor, noise=noise)
        planes.append(np.nan_to_num(radiance * scale, nan=sensor.full_scale) + sensor.black_level)
    merged: NDArray[Any] = np.stack(planes, axis=-1)
    return replace(shortest, counts=merged, ended_s=frames[-1].ended_s)
