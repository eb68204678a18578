"""Photographs with noise of a known law, for the tests of the camera estimators."""

import numpy as np
from numpy.typing import NDArray

from procam.estimate.camera.noise import NoiseLaw
from procam.model.optics import Sensor

SENSOR = Sensor(bits=12, black_level=64.0)
LAW = NoiseLaw(floor=2.25, per_level=0.3)
SHAPE = (160, 200)
LIT = (slice(20, 140), slice(30, 170))
BLACK_SHARE = 1 / 1500

Array = NDArray[np.float64]


def photograph(
    rate: Array, exposure_s: float, rng: np.random.Generator, law: NoiseLaw = LAW
) -> NDArray[np.uint16]:
    """Counts [DN] of rates [DN/s]."""
    signal = rate * exposure_s
    noisy = signal + rng.normal(0, 1, rate.shape) * np.sqrt(law.variance(signal))
    return np.rint(np.clip(noisy + SENSOR.black_level, 0, 2**SENSOR.bits - 1)).astype(np.uint16)


def scene(brightest: float = 30_000.0, fall: float = 4.0) -> tuple[Array, Array]:
    """Rates (H, W) of white and of its direct part: a slope that falls `fall`-fold, and a haze."""
    direct = np.zeros(SHAPE)
    width = LIT[1].stop - LIT[1].start
    direct[LIT] = brightest * np.linspace(1, 1 / fall, width)
    return direct + 0.1 * direct.mean(), direct
