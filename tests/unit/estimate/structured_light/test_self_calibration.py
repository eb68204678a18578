"""Self-calibration of simulated sinusoidal pictures: blur, harmonic, flux surplus and noise."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from tolerances import SIGMAS

from procam.errors import NotEnoughData
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.structured_light.self_calibration import (
    SelfCalibration,
    SinusoidImages,
    find_columns,
    self_calibrate,
)
from procam.maths.codes.phase import (
    WaveDistortion,
    Waves,
    equal_steps,
    heterodyne_waves,
    micro_waves,
)

LENGTH = 960
MICRO = micro_waves((LENGTH, 600))
HETERODYNE = heterodyne_waves((LENGTH, 600))
SHARP, CAMERA = WaveDistortion(), NoiseLaw(1.0, 0.02)
SHAPE = (30, 80)
RUNS = 4


def images(
    frames: list[np.ndarray], waves: Waves, span: np.ndarray, usable: np.ndarray
) -> SinusoidImages:
    dropped = [np.zeros(SHAPE, bool)] * len(frames)
    return SinusoidImages(frames, waves, LENGTH, span, usable, dropped)


@dataclass(frozen=True)
class Pixels:
    """Pixels that obey the model: direct and scattered light of all sizes, any column."""

    waves: Waves = MICRO
    distortion: WaveDistortion = SHARP
    surplus: np.ndarray | float = 0.0
    noise: NoiseLaw = CAMERA
    odd: float = 0.0  # share of pixels without a wave
    direct: tuple[float, float] = (60, 400)

    def calibration(self, seed: int) -> SelfCalibration:
        rng = np.random.default_rng(seed)
        count = SHAPE[0] * SHAPE[1]
        x = rng.uniform(0, LENGTH - 1, count)
        direct, scattered = rng.uniform(*self.direct, count), rng.uniform(0, 150, count)
        angle = 2 * np.pi * x[:, None] / self.waves.periods - self.waves.shifts
        wave = self.distortion.modulation(self.waves) * np.cos(angle)
        wave += self.distortion.harmonics(self.waves) * np.cos(2 * angle)
        level = 100 + (direct / 2 + scattered / 2)[:, None]
        level = level + (direct / 2 * self.distortion.depth(self.waves))[:, None] * wave
        level = level + scattered[:, None] * self.surplus
        strange = rng.random(count) < self.odd
        level[strange] = rng.uniform(100, 500, (strange.sum(), level.shape[1]))
        samples = level + np.sqrt(self.noise.variance(level)) * rng.standard_normal(level.shape)
        frames = [np.rint(s).astype(np.uint16).reshape(SHAPE) for s in samples.T]
        span = (direct + scattered).reshape(SHAPE).astype(np.float32)
        return self_calibrate(images(frames, self.waves, span, np.ones(SHAPE, bool)))


def runs(pixels: Pixels) -> list[SelfCalibration]:
    return [pixels.calibration(seed) for seed in range(RUNS)]


def check_unbiased(found: list[float] | np.ndarray, expected: float, largest_error: float) -> None:
    """Every run is near, and the error of the mean is within its standard error."""
    miss = np.array(found) - expected
    assert np.abs(miss).max() < largest_error
    # the scatter of so few runs is uncertain by half
    assert abs(miss.mean()) < SIGMAS * max(1.5 * miss.std(ddof=1), 0.1 * largest_error) / RUNS**0.5


@pytest.mark.parametrize(
    ("waves", "blur_px2", "harmonic"),
    [(MICRO, 1.5, 0.03), (MICRO, 6.0, -0.05), (HETERODYNE, 4.0, 0.04)],
    ids=["blurred", "much", "heterodyne"],
)
def test_blur_and_harmonic(waves: Waves, blur_px2: float, harmonic: float) -> None:
    found = runs(Pixels(waves, WaveDistortion(blur_px2, harmonic)))
    check_unbiased([c.distortion.blur_px2 for c in found], blur_px2, 0.25)
    check_unbiased([c.distortion.harmonic for c in found], harmonic, 2e-3)


@pytest.mark.parametrize("waves", [MICRO, HETERODYNE], ids=["micro", "heterodyne"])
def test_surplus_of_flux(waves: Waves) -> None:
    count = len(waves.periods)
    surplus = np.random.default_rng(4).normal(0, 0.02, count)
    surplus -= surplus.mean()  # a common part is offset
    found = runs(Pixels(waves, WaveDistortion(2.0, 0.02), surplus))
    for i in range(count):
        check_unbiased([c.surplus[i] - c.surplus.mean() for c in found], surplus[i], 3e-3)


@pytest.mark.parametrize(
    "law", [NoiseLaw(1.0, 0.02), NoiseLaw(4.0, 0.0), NoiseLaw(0.0, 0.05)], ids=str
)
def test_noise_law(law: NoiseLaw) -> None:
    found = runs(Pixels(distortion=WaveDistortion(2.0, 0.02), noise=law))
    rounding = 1 / 12
    for level in (150.0, 250.0, 370.0):
        variance = [c.noise.variance(level) for c in found]
        assert np.mean(variance) == pytest.approx(law.variance(level) + rounding, rel=0.06)
    assert all(c.noise.floor >= 0 and c.noise.per_level >= 0 for c in found)


@pytest.mark.parametrize("law", [NoiseLaw(0.0, 0.05), NoiseLaw(5.0, 0.0)], ids=str)
def test_one_level_only(law: NoiseLaw) -> None:
    """At a single level floor and slope are not separable, but their sum is known."""
    for known in runs(Pixels(noise=law, direct=(200.0, 200.5))):
        expected = law.variance(100 + 100 + 37.5) + 1 / 12
        assert known.noise.variance(237.5) == pytest.approx(expected, rel=0.05)


def test_pixels_without_a_wave_are_ignored() -> None:
    sound = Pixels(distortion=WaveDistortion(3.0, 0.03))
    for clean, known in zip(runs(sound), runs(replace(sound, odd=0.1)), strict=True):
        assert known.distortion.blur_px2 == pytest.approx(clean.distortion.blur_px2, abs=0.3)
        assert known.distortion.harmonic == pytest.approx(0.03, abs=3e-3)
        assert known.noise.variance(250.0) == pytest.approx(clean.noise.variance(250.0), rel=0.1)


def test_too_few_pixels_are_refused() -> None:
    frames = [np.ones(SHAPE, np.float32)] * 8
    usable = np.zeros(SHAPE, bool)
    usable[0, :49] = True
    with pytest.raises(NotEnoughData, match=r"only 49 pixels .* at least 50"):
        self_calibrate(images(frames, MICRO, np.ones(SHAPE, np.float32), usable))


class TestSearch:
    """Without a base set all columns are tried; with one, a kernel starts from its phase."""

    def _frames(
        self, waves: Waves, rng: np.random.Generator
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        x = rng.uniform(0, LENGTH - 1, (6, 50))
        samples = 200 + 80 * np.cos(2 * np.pi * x[..., None] / waves.periods - waves.shifts)
        samples += rng.normal(0, 0.5, samples.shape)
        return x, [s.astype(np.float32) for s in np.moveaxis(samples, -1, 0)]

    @pytest.mark.parametrize("lost", [[], [7], [0], [1, 5]])
    def test_both_searches_find_the_column(self, rng: np.random.Generator, lost: list[int]) -> None:
        keep = ~np.isin(np.arange(8), lost)
        x, frames = self._frames(MICRO, rng)
        left = [f for f, k in zip(frames, keep, strict=True) if k]
        found = find_columns(left, MICRO.kept(keep), WaveDistortion(), LENGTH)
        assert found.position.shape == x.shape
        error = 0.5 * np.sqrt(found.variance)
        assert np.mean(((found.position - x) / error) ** 2) == pytest.approx(1, abs=0.35)
        assert (found.margin > 0).all()

    def test_a_single_period_gives_the_column_within_it(self, rng: np.random.Generator) -> None:
        waves = Waves(np.full(5, 30.0), equal_steps(5), 5)
        x, frames = self._frames(waves, rng)
        found = find_columns(frames, waves, WaveDistortion(), LENGTH)
        off = np.mod(found.position - x + 15, 30) - 15
        assert np.abs(off).max() < 0.3
