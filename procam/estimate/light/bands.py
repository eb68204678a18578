"""Bands across a camera's photographs that lie in the same place in all of them.

A rolling shutter reads one row after the other. Where the light pulses, as projectors' and lamps' does,
rows are bright and dark in turn, and if the pulses keep step with the camera, the same rows are in all
photographs. No two photographs contradict each other then, but the bands run straight across the picture,
which neither paint, dirt nor the lens does.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.model.provenance import Note

FEWEST = 2.0  # bands over the picture: fewer look like paint or vignetting
BAND_PX = 16  # narrowest band [px]; narrower ones are smoothed away with the noise
STEP = 0.5  # between the numbers of bands that are tried
TREND = 4  # terms of the polynomial that paint and vignetting leave along the picture
# amplitude, of the light: gains follow it, and are promised to 2 %; drawn rooms without bands have less than
# 0.004
NOTED = 0.008
LOUDER = 3.0  # times the largest amplitude across: seams, rings and dirt make both alike
STANDS_OUT = 0.2  # logarithm of light over the line's, of a person or a spot: paint differs by 0.1
MIN_LINE = 0.2  # of the longest row or column: shorter ones do not count
ADVICE = (
    "set exposure_s to a multiple of the pulse, 0.01 s or 0.00833 s for mains and the projector's frame time "
    "for its lamp, or take a global shutter, and photograph again"
)


@dataclass(frozen=True, slots=True)
class Bands:
    """Bands of rows (`across` 0) or columns (1) of a camera's picture.

    `count`: over the picture. `amplitude`: of the light, relative, and its standard error `sigma`.
    `profile`: (H, 1) or (1, W) logarithm. `share`: of the variance of rows or columns that they explain.
    """

    across: int
    count: float
    amplitude: float
    sigma: float
    profile: Array
    share: float

    @property
    def text(self) -> str:
        """What is seen, and its cause."""
        lines = ("rows", "columns")[self.across]
        return (
            f"{lines} of its photographs are brighter and darker in turn by {self.amplitude:.1%}, about "
            f"{self.count:.0f} bands and the same in all photographs: its rolling shutter reads light that "
            "pulses (banding)"
        )

    def note(self, camera: str) -> Note:
        """What the report says."""
        text = f"{self.text}. Gains are wrong by as much: {ADVICE}"
        return Note("banding", f"camera {camera}", text, self.amplitude / NOTED)


def find_bands(departure: Image, use: BoolArray) -> Bands | None:
    """Bands in the departure (H, W) of light from a smooth one, a logarithm, where `use`; None if none."""
    fits = [_best_wave(departure, use, across) for across in (0, 1)]
    if None in fits:
        return None
    first, second = sorted((fit for fit in fits if fit), key=lambda fit: -fit.amplitude)
    found = first.amplitude > max(NOTED, LOUDER * second.amplitude)
    return first if found else None


def _best_wave(departure: Image, use: BoolArray, across: int) -> Bands | None:
    """The wave that explains most of the medians of rows or columns; None of too few."""
    count = use.sum(axis=1 - across)
    lines = np.flatnonzero(count > MIN_LINE * count.max())
    length = departure.shape[across]
    numbers = np.arange(FEWEST, length / BAND_PX, STEP)
    if len(lines) < 2 * BAND_PX or not numbers.size:
        return None
    only = np.where(use, departure, np.nan).take(lines, axis=across)
    middle = _line_means(only, 1 - across)
    place = np.arange(length) / length
    trend = np.linalg.qr(np.polynomial.legendre.legvander(2 * place[lines] - 1, TREND - 1))[0]
    middle -= trend @ (trend.T @ middle)
    explained = [_explained(_wave(place[lines], n), trend, middle) for n in numbers]
    best = int(np.argmax([rms for rms, _ in explained]))
    rms, wave = explained[best]
    profile = np.expand_dims(_wave(place, numbers[best]) @ wave, 1 - across)
    whole = float(np.mean(middle**2))
    rest = np.sqrt(max(whole - rms**2, 0) * BAND_PX / len(lines))  # alike within the narrowest band
    amplitude, sigma = (float(np.sqrt(2) * x) for x in (rms, rest))
    share = float(rms**2 / max(whole, np.finfo(float).tiny))
    return Bands(across, float(numbers[best]), amplitude, sigma, profile, share)


def _line_means(departure: Image, along: int) -> Array:
    """Means (n,) of lines of a picture along an axis, without what stands in a part of a line."""
    median = np.nanmedian(departure, axis=along, keepdims=True)
    with np.errstate(invalid="ignore"):
        like = np.abs(departure - median) < STANDS_OUT
    return np.asarray(np.nanmean(np.where(like, departure, np.nan), axis=along), float)


def _explained(wave: Array, trend: Array, middle: Array) -> tuple[float, Array]:
    """Rms of what a wave (n, 2) explains of medians (n,) beside a trend (n, K), and its weights (2,)."""
    beside = wave - trend @ (trend.T @ wave)
    weights = np.linalg.lstsq(beside, middle, rcond=None)[0]
    return float(np.sqrt(np.mean((beside @ weights) ** 2))), np.asarray(weights, float)


def _wave(place: Array, number: float) -> Array:
    """Sine and cosine (n, 2) of a number of waves at places (n,) of the picture, 0..1."""
    angle = 2 * np.pi * number * place
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)
