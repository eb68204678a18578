"""Sinusoidal codes: their error bound, and fits that reach it."""

import numpy as np
import pytest
from scipy.stats import chi2
from tolerances import SIGMAS, SOLVER

from procam.maths.codes.phase import (
    HETERODYNE_PERIODS,
    MICRO_PERIODS,
    WaveDistortion,
    Waves,
    cramer_rao_variance,
    equal_steps,
    fit_waves,
    heterodyne_waves,
    micro_waves,
    period_scale,
    search_columns,
    shared_sensitivity,
)

SIZE = (960, 600)
MICRO = micro_waves(SIZE)
DISTORTION = WaveDistortion(blur_px2=1.5, harmonic=0.04)


def photograph(
    waves: Waves,
    distortion: WaveDistortion,
    x: np.ndarray,
    offset: float | np.ndarray,
    amplitude: float,
) -> np.ndarray:
    """Samples (n, K) by the definition, without noise; `amplitude` is that of the first period."""
    angles = 2 * np.pi * x[:, None] / waves.periods - waves.shifts
    spread = 2 * np.pi**2 * distortion.blur_px2
    depth = np.exp(-spread * (waves.periods**-2 - waves.periods[0] ** -2))
    second = distortion.harmonic * np.exp(
        -spread * (4 * waves.periods**-2 - waves.periods[0] ** -2)
    )
    wave = depth * np.cos(angles) + second * np.cos(2 * angles)
    return np.reshape(offset, (-1, 1)) + amplitude * wave


def columns(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(0, SIZE[0] - 1, count)


class TestCodes:
    def test_periods_grow_with_the_panel_but_never_below_16_px(self) -> None:
        assert period_scale((1920, 1080)) == 1
        assert period_scale((1080, 3840)) == 2
        assert period_scale((320, 200)) == period_scale((16, 16)) == 1 / 3
        for periods in (MICRO_PERIODS, HETERODYNE_PERIODS):
            assert min(periods) / 3 > 16

    @pytest.mark.parametrize("size", [(320, 200), (1920, 1200), (3840, 2160)])
    @pytest.mark.parametrize("make", [micro_waves, heterodyne_waves])
    def test_no_two_columns_have_similar_samples(self, make: object, size: tuple[int, int]) -> None:
        """Samples of columns a period or more apart differ by 0.7 of the amplitude at least."""
        waves = make(size)
        # columns that agree in the first period are whole periods apart
        period = waves.periods[0]
        x = np.arange(0.0, max(size), 0.25)
        seen = np.cos(waves.angles(x))
        nearest = np.inf
        for turns in range(1, int(max(size) / period) + 1):
            other = np.cos(waves.angles(x + turns * period))[x + turns * period < max(size)]
            if len(other):
                nearest = min(nearest, np.linalg.norm(other - seen[: len(other)], axis=1).min())
        assert nearest > 0.7


class TestDistortion:
    def test_blur_is_the_transfer_of_a_gaussian(self) -> None:
        """Against a wave smeared numerically."""
        distortion, offsets = WaveDistortion(2.5, 0.06), np.linspace(-30, 30, 6001)
        weight = np.exp(-(offsets**2) / (2 * distortion.blur_px2))
        weight /= weight.sum()
        angle = 2 * np.pi * offsets[:, None] / MICRO.periods
        first = weight @ np.cos(angle)
        np.testing.assert_allclose(distortion.depth(MICRO), first[0], rtol=1e-9)
        np.testing.assert_allclose(distortion.modulation(MICRO), first / first[0], rtol=1e-9)
        second = weight @ np.cos(2 * angle)
        np.testing.assert_allclose(distortion.harmonics(MICRO), 0.06 * second / first[0], rtol=1e-9)


class TestFit:
    @pytest.mark.parametrize("distortion", [WaveDistortion(), DISTORTION], ids=["sharp", "blurred"])
    def test_perfect_samples_are_recovered(
        self, rng: np.random.Generator, distortion: WaveDistortion
    ) -> None:
        x = columns(rng, 300)
        offset = rng.uniform(90, 200, 300)
        samples = photograph(MICRO, distortion, x, offset, 70.0)
        fit = fit_waves(samples, MICRO, distortion, x + rng.uniform(-1, 1, 300))
        np.testing.assert_allclose(fit.x, x, atol=SOLVER)
        # three steps from a pixel away leave a small error
        np.testing.assert_allclose(fit.offset, offset, rtol=1e-6)
        np.testing.assert_allclose(fit.amplitude, 70, rtol=1e-6)
        np.testing.assert_allclose(fit.residual, 0, atol=SOLVER)

    @pytest.mark.parametrize("lost", [(1, 4), (0, 1, 2)])
    @pytest.mark.parametrize("waves", [MICRO, heterodyne_waves(SIZE)], ids=["micro", "heterodyne"])
    def test_fewer_samples_are_less_certain(
        self, rng: np.random.Generator, lost: tuple[int, ...], waves: Waves
    ) -> None:
        x = columns(rng, 200)
        samples = photograph(waves, DISTORTION, x, 120.0, 60.0)
        keep = ~np.isin(np.arange(samples.shape[1]), lost)
        whole, _ = search_columns(samples, waves, DISTORTION, SIZE[0])
        fit, margin = search_columns(samples[:, keep], waves.kept(keep), DISTORTION, SIZE[0])
        np.testing.assert_allclose(fit.x, x, atol=1e-5)
        assert (margin > 0).all()
        assert fit.variance.mean() > whole.variance.mean()

    def test_margin_is_how_much_worse_the_runner_up_fits(self, rng: np.random.Generator) -> None:
        """Against all columns in steps of 0.02 px."""
        samples = photograph(MICRO, DISTORTION, columns(rng, 40), 100.0, 50.0)
        samples += rng.normal(0, 2, samples.shape)
        fit, margin = search_columns(samples, MICRO, DISTORTION, SIZE[0])
        grid = np.arange(-0.5, SIZE[0], 0.02)
        curve = photograph(MICRO, DISTORTION, grid, 0.0, 1.0)
        for i in range(40):
            wave = curve - curve.mean(axis=1, keepdims=True)
            seen = samples[i] - samples[i].mean()
            amplitude = np.maximum(wave @ seen, 0) / np.sum(wave**2, axis=1)
            left = np.sum((seen - amplitude[:, None] * wave) ** 2, axis=1)
            best = int(np.argmin(left))
            assert fit.x[i] == pytest.approx(grid[best], abs=0.02)
            far = np.abs(grid - grid[best]) > MICRO.periods[0] / 2
            # a candidate may move outside the panel, or hop to one that is even better; far worse ones
            # are judged on a grid of half pixels
            assert margin[i] <= 1.05 * (left[far].min() - left[best]) + 0.1
            assert margin[i] >= 0.5 * (left[far].min() - left[best])  # less only drops a pixel

    @pytest.mark.parametrize("lost", [(0, 1, 2), (1, 4, 6)])
    @pytest.mark.parametrize("noise", [0.01, 1.0])
    def test_few_samples_are_right_or_have_a_small_margin(
        self, rng: np.random.Generator, lost: tuple[int, ...], noise: float
    ) -> None:
        """With five samples many columns fit; half a pixel off, the right one fits badly."""
        x = columns(rng, 2000)
        samples = photograph(MICRO, DISTORTION, x, 120.0, 60.0) + rng.normal(0, noise, (2000, 8))
        keep = ~np.isin(np.arange(8), lost)
        fit, margin = search_columns(samples[:, keep], MICRO.kept(keep), DISTORTION, SIZE[0])
        trusted = margin > 12 * noise**2
        assert trusted.mean() > 0.5
        assert np.mean(np.abs(fit.x - x)[trusted] > 1) <= 1e-3

    @pytest.mark.parametrize("length", [2, 20])
    def test_a_panel_of_less_than_a_period(self, rng: np.random.Generator, length: int) -> None:
        x = rng.uniform(0, length - 1, 100)
        samples = photograph(MICRO, DISTORTION, x, 100.0, 50.0)
        fit, margin = search_columns(samples, MICRO, DISTORTION, length)
        np.testing.assert_allclose(fit.x, x, atol=1e-4)
        assert (margin > 0).all()

    def test_waves_of_one_period_have_no_runner_up(self, rng: np.random.Generator) -> None:
        waves = Waves(np.full(6, 30.0), equal_steps(6), 6)
        x = columns(rng, 100)
        samples = photograph(waves, WaveDistortion(), x, 100.0, 50.0)
        keep = np.arange(6) != 2
        fit, margin = search_columns(samples[:, keep], waves.kept(keep), WaveDistortion(), SIZE[0])
        turns = (fit.x - x) / 30
        np.testing.assert_allclose(turns, np.rint(turns), atol=1e-6)
        assert np.isposinf(margin).all()


class TestNoise:
    """The bound, the errors and the standard errors of the fits agree."""

    noise, amplitude = 1.5, 60.0
    places, times = 12, 1000

    def _fits(
        self, waves: Waves, distortion: WaveDistortion, lost: tuple[int, ...] = ()
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns (12,), errors and claimed variances (12, 1000)."""
        rng = np.random.default_rng(5)
        places = columns(rng, self.places)
        x = np.repeat(places, self.times)
        samples = photograph(waves, distortion, x, 120.0, self.amplitude)
        samples += rng.normal(0, self.noise, samples.shape)
        keep = ~np.isin(np.arange(samples.shape[1]), lost)
        fit = fit_waves(samples[:, keep], waves.kept(keep), distortion, x)
        shape = self.places, self.times
        return places, (fit.x - x).reshape(shape), (self.noise**2 * fit.variance).reshape(shape)

    @pytest.mark.parametrize("waves", [MICRO, heterodyne_waves(SIZE)], ids=["micro", "heterodyne"])
    def test_errors_reach_the_cramer_rao_bound(self, waves: Waves) -> None:
        distortion = WaveDistortion(1.5, 0.0)  # the bound is that of pure waves
        x, miss, _ = self._fits(waves, distortion)
        depth = np.broadcast_to(
            self.amplitude * distortion.modulation(waves), (12, len(waves.periods))
        )
        noise = np.full(len(waves.periods), self.noise**2)
        bound = cramer_rao_variance(waves, x, depth, noise)
        z = (np.mean(miss**2, axis=1) / bound - 1) / np.sqrt(2 / self.times)
        assert np.abs(z).max() < SIGMAS
        together = np.mean(miss**2 / bound[:, None]) - 1
        assert abs(together) < SIGMAS * np.sqrt(2 / miss.size)
        assert np.abs(miss.mean(axis=1) / np.sqrt(bound / self.times)).max() < SIGMAS

    def test_the_bound_weighs_samples_by_their_noise(self, rng: np.random.Generator) -> None:
        """A sample of infinite noise is a missing one."""
        x, noise = columns(rng, 20), np.full(8, 2.0)
        noise[5] = 1e12
        keep = np.arange(8) != 5
        np.testing.assert_allclose(
            cramer_rao_variance(MICRO, x, 60.0, noise),
            cramer_rao_variance(MICRO.kept(keep), x, 60.0, noise[keep]),
            rtol=1e-6,
        )

    @pytest.mark.parametrize("lost", [(), (2, 6)])
    def test_claimed_standard_errors_hold(self, lost: tuple[int, ...]) -> None:
        _, miss, variance = self._fits(MICRO, DISTORTION, lost)
        squares = miss**2 / variance
        low, high = chi2.interval(0.9999, squares.size) / np.float64(squares.size)
        assert 0.9 < low < squares.mean() < high < 1.1
        assert np.mean(squares < 1) == pytest.approx(0.683, abs=0.02)
        assert np.mean(squares < 9) > 0.995

    def test_closed_form_of_equal_steps(self) -> None:
        """N steps of one period: sigma = period noise / (2 pi amplitude) sqrt(2 / N)."""
        waves = Waves(np.full(5, 30.0), equal_steps(5), 5)
        variance = cramer_rao_variance(waves, np.linspace(0, 30, 7), 10.0, np.full(5, 0.04))
        expected = (30 / (2 * np.pi * 10)) ** 2 * 0.04 * 2 / 5
        np.testing.assert_allclose(variance, expected, rtol=1e-10)


class TestSharedSensitivity:
    def test_is_the_change_of_residuals_of_refitted_pixels(self, rng: np.random.Generator) -> None:
        """Against central differences."""
        x = columns(rng, 30)
        scattered = rng.uniform(0, 80, 30)
        samples = photograph(MICRO, DISTORTION, x, 120.0, 60.0) + rng.normal(0, 0.01, (30, 8))
        fit = fit_waves(samples, MICRO, DISTORTION, x)
        left, by_distortion, basis = shared_sensitivity(samples, MICRO, DISTORTION, fit)
        own = np.einsum("bnk,bnl->nkl", basis, basis)
        by_flux = scattered[:, None, None] * (np.eye(8) - own)
        shared = np.concatenate([np.moveaxis(by_distortion, 0, -1), by_flux], axis=-1)
        np.testing.assert_allclose(np.einsum("bnk,nk->bn", basis, left), 0, atol=1e-12)
        step = 1e-4
        for i in range(10):
            sides = []
            for sign in (1, -1):
                distortion, seen = DISTORTION, samples
                if i == 0:
                    distortion = WaveDistortion(
                        DISTORTION.blur_px2 + sign * step, DISTORTION.harmonic
                    )
                elif i == 1:
                    distortion = WaveDistortion(
                        DISTORTION.blur_px2, DISTORTION.harmonic + sign * step
                    )
                else:
                    seen = samples - sign * step * scattered[:, None] * np.eye(8)[i - 2]
                again = fit_waves(seen, MICRO, distortion, fit.x)
                model = photograph(MICRO, distortion, again.x, again.offset, 1.0)
                model += (again.amplitude - 1)[:, None] * photograph(
                    MICRO, distortion, again.x, 0.0, 1.0
                )
                sides.append(seen - model)
            found = -(sides[0] - sides[1]) / (2 * step)
            # residuals bend with the noise that is left
            np.testing.assert_allclose(shared[..., i], found, atol=2e-3 * np.abs(found).max())
