"""Bracketed photographs of cameras that no estimator of procam has a model of.

A scene of flat and textured surfaces is photographed at several exposures. Electrons arrive with shot
noise, are read with read noise and saturate; a tone curve of the trade, per channel, and rounding to 8 bits
follow. Shutters deviate from their names. Nothing here uses procam.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
ToneCurve = Callable[[Array], Array]
FULL_WELL_E, READ_E = 30000.0, 6.0  # electrons at saturation, and of read noise
SHAPE = (180, 270)
BALANCE = (0.75, 1.0, 0.6)  # light of the channels on grey
SHUTTER_ERROR = 0.01  # relative standard deviation
WRONG_EXPOSURE = 1.6  # factor of the photograph with a wrong exposure
PATCHES = (9, 13)
DECADES = 3.0  # of light in the scene
FINE = np.linspace(0, 1, 200_001)


def srgb(light: Array) -> Array:
    """IEC 61966-2-1."""
    return np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gamma_toe(light: Array) -> Array:
    """Gamma 2.2 above a toe that presses the shadows."""
    return np.asarray(light ** (1 / 2.2) * (light + 0.004) / (light + 0.02) * 1.02 / 1.004)


def hable(light: Array) -> Array:
    """The filmic curve of J. Hable (Uncharted 2, 2010) with white at 4, then gamma 2.2."""

    def tone(x: Array) -> Array:
        above = x * (0.15 * x + 0.05) + 0.004
        return np.asarray(above / (x * (0.15 * x + 0.5) + 0.06) - 0.004 / 0.06)

    return np.asarray((tone(4 * light) / tone(np.array(4.0))) ** (1 / 2.2))


def logistic(light: Array) -> Array:
    """A film's S in the logarithm of light, with toe and shoulder."""

    def tone(x: Array) -> Array:
        return np.asarray(x**1.3 / (x**1.3 + 0.2**1.3))

    return np.asarray(tone(light + 0.004) - tone(np.array(0.004))) / float(
        tone(np.array(1.004)) - tone(np.array(0.004))
    )


def knee(light: Array) -> Array:
    """Gamma 2.2 up to 0.7 of saturation; above this knee the slope falls to 0.4 of its value."""
    at, power = 0.7, 1 / 2.2
    slope = 0.4 * power * at ** (power - 1)
    top = at**power + slope * (1 - at)
    return np.where(light < at, light**power, at**power + slope * (light - at)) / top


def contrast(light: Array) -> Array:
    """SRGB with a contrast curve on top."""
    level = srgb(light)
    return np.asarray(0.7 * level + 0.3 * level**2 * (3 - 2 * level))


@dataclass(frozen=True)
class Case:
    """A camera's curves (one, or one per channel), its stops, and what went wrong during photography."""

    name: str
    curves: tuple[ToneCurve, ...]
    stops: float
    photographs: int
    moving: bool = False
    wrong: bool = False


CASES = (
    Case("sRGB, 1 stop", (srgb,), 1, 7),
    Case("gamma with toe, 1 stop", (gamma_toe,), 1, 7),
    Case("filmic (Hable), 1 stop", (hable,), 1, 7),
    Case("filmic (Hable), 2 stops", (hable,), 2, 5),
    Case("filmic (Hable), 3 stops", (hable,), 3, 4),
    Case("film (logistic), 2 stops", (logistic,), 2, 5),
    Case("film (logistic), 3 stops", (logistic,), 3, 4),
    Case("knee, 1 stop", (knee,), 1, 7),
    Case("knee, 2 stops", (knee,), 2, 5),
    Case("sRGB, 3 stops", (srgb,), 3, 4),
    Case("per channel, 2 stops", (contrast, srgb, gamma_toe), 2, 5),
    Case("something moves, 1 stop", (contrast,), 1, 7, moving=True),
    Case("one exposure wrong, 1 stop", (srgb,), 1, 7, wrong=True),
)


@dataclass(frozen=True)
class Brackets:
    """Photographs (H, W, 3), the shutter times on the dial [s], and the one that does not fit."""

    photographs: list[Pixels]
    nominal_s: Array
    wrong: int | None


def true_light(curve: ToneCurve, levels: Array) -> Array:
    """Light (K,) at levels (K,), 1 where the sensor saturates."""
    return np.interp(levels, curve(FINE), FINE)


def shoot(case: Case, seed: int) -> Brackets:
    """The photographs of a case with the scene, shutters and noise of a seed."""
    rng = np.random.default_rng([seed, len(case.name), int(10 * case.stops)])
    radiance = _scene(rng)
    order = np.arange(case.photographs)
    nominal = 2.0 ** (case.stops * (order - (case.photographs - 1))) / 4
    wrong = int(rng.integers(1, case.photographs - 1)) if case.wrong else None
    actual = nominal * np.exp(SHUTTER_ERROR * rng.normal(size=case.photographs))
    if wrong is not None:
        actual[wrong] *= WRONG_EXPOSURE
    pictures = []
    for number, exposure in enumerate(actual):
        seen = _with_passer_by(radiance, number, rng) if case.moving else radiance
        pictures.append(_develop(case, _expose(4 * exposure * seen, rng)))
    return Brackets(pictures, nominal, wrong)


def _scene(rng: np.random.Generator) -> Array:
    """Light (H, W, 3) of surfaces, a shaded wall and texture, saturated in part at the longest exposure."""
    height, width = SHAPE
    rows, columns = PATCHES
    chart = rng.permutation(np.linspace(-DECADES, 0.5, rows * columns)).reshape(rows, columns)
    surfaces = np.kron(chart, np.ones((height // rows, -(-width // columns))))[:, :width]
    wall = zoom(rng.uniform(-DECADES, 0.5, size=(4, 6)), (height / 4, width / 6), order=1)
    texture = 0.01 * gaussian_filter(rng.normal(size=SHAPE), 1.0)
    left = np.arange(width) < width // 2
    log_light = np.where(left, surfaces, wall) + texture
    return np.asarray(10 ** gaussian_filter(log_light, 0.7)[..., None] * np.array(BALANCE))


def _with_passer_by(radiance: Array, number: int, rng: np.random.Generator) -> Array:
    """Someone in front of the scene, elsewhere in every photograph."""
    seen, (height, width) = radiance.copy(), SHAPE
    left = (17 * number + int(rng.integers(0, 9))) % (width - 30)
    seen[height // 2 :, left : left + 22] = 0.05 * np.array(BALANCE)
    return seen


def _expose(light: Array, rng: np.random.Generator) -> Array:
    """Light of a sensor with shot and read noise that saturates at 1."""
    electrons = rng.poisson(FULL_WELL_E * light) + READ_E * rng.normal(size=light.shape)
    return np.asarray(np.clip(electrons / FULL_WELL_E, 0, 1))


def _develop(case: Case, light: Array) -> Pixels:
    """The camera's curves and rounding."""
    curves = case.curves if len(case.curves) == 3 else case.curves * 3
    levels = [curve(light[..., c]) for c, curve in enumerate(curves)]
    return np.rint(255 * np.stack(levels, axis=-1)).astype(np.uint8)
