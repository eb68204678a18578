"""Effects of a projector's settings, on screens that scatter in any way and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.projector_tests.analysis import (
    SIGNIFICANT,
    Effect,
    StripedView,
    clipped_black,
    clipped_white,
    colour_effects,
    load_effect,
    persistence_effect,
    sharpness_effect,
    slant_effect,
    step_light,
)
from procam.estimate.projector_tests.patches import (
    PatchLight,
    direct_light,
)
from procam.estimate.projector_tests.patterns import (
    BRIGHT_LEVELS,
    COUNT,
    DARK_LEVELS,
    GREYS,
    STRIPE_PX,
    PatchLayout,
    patch_bits,
)

BLACK = 3.0
FIRST = patch_bits(0)
PURE, MIXED = np.eye(3), 1 - np.eye(3)


class Screen:
    """Patches that light each other in any way, in two channels; light adds up."""

    def __init__(self, seed: int = 3) -> None:
        rng = np.random.default_rng(seed)
        self.bounces = rng.uniform(0, 8, (COUNT, COUNT)) + np.diag(rng.uniform(500, 1500, COUNT))
        self.elsewhere = rng.uniform(100, 400, COUNT)
        self.tint = rng.dirichlet(np.ones(3), 2)  # of the primaries in the channels

    def seen(
        self, levels: np.ndarray, elsewhere: float = 0, *, factor: float = 1, boost: float = 0
    ) -> PatchLight:
        """Of relative light (8,) or (8, 3) of the primaries."""
        colour = np.broadcast_to(levels.reshape(COUNT, -1), (COUNT, 3)).astype(float)
        colour = colour + boost * colour.min(axis=1, keepdims=True)
        light = self.bounces @ colour @ self.tint.T + elsewhere * self.elsewhere[:, None]
        return PatchLight(factor * (light + BLACK), np.full((COUNT, 2), 1e-6))

    def pair(self, elsewhere: float = 0, **how: float) -> tuple[PatchLight, PatchLight]:
        first = FIRST.astype(float)
        return self.seen(first, elsewhere, **how), self.seen(1 - first, elsewhere, **how)

    def colours(self, **how: float) -> list[PatchLight]:
        return [
            self.seen(np.where(FIRST[:, None], pure, mixed), **how)
            for pure, mixed in zip(PURE, MIXED, strict=True)
        ]


class TestEffect:
    @pytest.mark.parametrize(
        ("value", "sigma", "found"),
        [
            (0.02, 0.001, True),
            (-0.02, 0.001, True),
            (0.009, 1e-6, False),  # certain, but small
            (0.02, 0.02 / SIGNIFICANT * 1.01, False),  # large, but uncertain
            (np.nan, np.nan, False),
        ],
    )
    def test_needs_size_and_significance(self, value: float, sigma: float, found: bool) -> None:
        effect = Effect("any", value, sigma, 0.01)
        assert (effect.found, effect.known) == (found, np.isfinite(value))


class TestLight:
    @pytest.mark.parametrize("factor", [1.0, 0.93, 1.3])
    @pytest.mark.parametrize("elsewhere", [0.5])
    def test_load_changes_direct_light_whatever_scatters(
        self, factor: float, elsewhere: float
    ) -> None:
        screen = Screen()
        alone, loaded = screen.pair(), screen.pair(elsewhere, factor=factor)
        effect = load_effect("load", direct_light(loaded), direct_light(alone), 0.01)
        assert effect.value == pytest.approx(factor - 1, abs=1e-9)

    @pytest.mark.parametrize("boost", [0.0, 0.02, 0.25])
    def test_white_is_compared_with_colours(self, boost: float) -> None:
        screen = Screen()
        pair, colours = screen.pair(boost=boost), screen.colours(boost=boost)
        primaries, secondaries = colour_effects(colours, pair, 0.01)
        # what the other half of the patches lacks is missing in the scattered light too
        assert primaries.value == pytest.approx(boost, rel=0.1, abs=1e-9)
        assert secondaries.value == pytest.approx(boost, rel=0.1, abs=1e-9)
        assert primaries.found == secondaries.found == (boost > 0)

    def test_persistence_of_the_picture_before(self) -> None:
        screen = Screen()
        first, second = screen.pair()
        early = second.scaled(0.7) + first.scaled(0.3)
        effect = persistence_effect(early, second, direct_light((first, second)), 0.01, "early")
        assert effect.value == pytest.approx(0.3)

    @pytest.mark.parametrize("gamma", [1.8, 2.2, 2.6])
    def test_a_power_law_misses_no_step(self, gamma: float) -> None:
        white, black = self.ends(lambda code: (code / 255) ** gamma)
        assert abs(white.value) < 0.25 and abs(black.value) < 0.2
        assert not white.found and not black.found

    def test_limited_range_misses_both_ends(self) -> None:
        white, black = self.ends(lambda code: np.clip((code - 16) / 219, 0, 1) ** 2.2)
        assert white.value == pytest.approx(1, abs=0.1)
        assert black.value == pytest.approx(1, abs=0.2)
        assert white.found and black.found

    def test_a_range_without_any_dark_step(self) -> None:
        _, black = self.ends(lambda code: np.clip((code - 32) / 191, 0, 1) ** 2.2)
        assert black.value == pytest.approx(1, abs=0.2) and black.found

    def test_a_patch_out_of_view_leaves_a_test_undone(self) -> None:
        screen = Screen()
        hidden = np.isin(np.arange(COUNT), np.flatnonzero(np.array(BRIGHT_LEVELS) == 247))
        steps = screen.seen((np.array(BRIGHT_LEVELS) / 255) ** 2.2)
        steps = PatchLight(np.where(hidden[:, None], np.nan, steps.mean), steps.variance)
        found = step_light(BRIGHT_LEVELS, steps, screen.pair(), screen.seen(np.zeros(COUNT)))
        assert not clipped_white(found, 0.5).known
        assert np.isfinite(found[255][0])

    def ends(self, response) -> tuple[Effect, Effect]:
        """Both ends of the range of a projector, on a dome: scattered light is nearly uniform."""
        screen = uniform_screen()
        pair, black = screen.pair(), screen.seen(np.zeros(COUNT))
        bright, dark = (
            step_light(levels, screen.seen(response(np.array(levels, float))), pair, black)
            for levels in (BRIGHT_LEVELS, DARK_LEVELS)
        )
        return clipped_white(bright, 0.5), clipped_black(dark, 0.5)

    def test_sigma_is_the_spread_over_many_photographs(self) -> None:
        screen, rng = Screen(), np.random.default_rng(8)
        clean = [*screen.pair(), *screen.pair(1.0), *screen.colours()]
        scores = []
        for _ in range(400):
            noisy = [
                PatchLight(c.mean + rng.normal(0, 2, c.mean.shape), np.full(c.mean.shape, 4.0))
                for c in clean
            ]
            pair = noisy[0], noisy[1]
            load = load_effect("l", direct_light((noisy[2], noisy[3])), direct_light(pair), 0.01)
            scores.append(load.value / load.sigma)
        assert 0.75 < np.std(scores) < 1.05  # the larger of two sigmas is taken


def uniform_screen() -> Screen:
    """Patches of another brightness each; 1 % of white's light scatters evenly, to 3 %."""
    screen, rng = Screen(), np.random.default_rng(4)
    scattered = 10 * rng.normal(1, 0.03, (COUNT, COUNT))
    screen.bounces = np.where(np.eye(COUNT, dtype=bool), screen.bounces, scattered)
    return screen


class TestStripes:
    SCALE = 3
    NOISE = NoiseLaw(4.0, 0.05)
    SHAPE = (360, 480)

    def view(self) -> StripedView:
        return StripedView(
            np.full(self.SHAPE, 1500.0), np.full(self.SHAPE, 2.0), self.NOISE, self.SCALE
        )

    def stripes(self, slant: int, low: float, high: float, *, moved: float = 0.0) -> np.ndarray:
        """Light of stripes, blurred; half of it moved to the right and down [projector px]."""
        height, width = (size // self.SCALE for size in self.SHAPE)
        light = PatchLayout((width, height)).stripes(slant, low, high)[..., 0].astype(float)
        fine = gaussian_filter(np.kron(light, np.ones((self.SCALE,) * 2)), 1.0 * self.SCALE)
        copy = shift(fine, moved * self.SCALE, order=3, mode="nearest")
        return 2 + 1498 * (0.5 * (fine + copy) * 0.8 + 0.1)

    def power(self, *what: float, seed: int = 0, **how: float) -> np.ndarray:
        light = self.stripes(*what, **how)  # type: ignore[arg-type]
        rng = np.random.default_rng([seed, int(what[0]) + 1])
        noise = np.sqrt(self.NOISE.variance(light)) * rng.normal(size=light.shape)
        view = self.view()
        white = view.white + np.sqrt(self.NOISE.variance(view.white)) * rng.normal(size=light.shape)
        return replace(view, white=white).power(light + noise)

    def test_power_is_that_of_the_fundamental_wave(self) -> None:
        frequency = 2**0.5 / STRIPE_PX
        blur = np.exp(-2 * (np.pi * frequency) ** 2)
        pixel = np.sinc(1 / STRIPE_PX) ** 2  # a projector pixel is square
        steps = np.sin(np.pi / 2) / (STRIPE_PX / 2 * np.sin(np.pi / STRIPE_PX))
        amplitude = 0.8 * steps * pixel * blur
        found = np.nanmedian(self.power(1, 0.0, 1.0))
        assert found == pytest.approx(amplitude**2 / 2, rel=0.02)

    def test_noise_alone_has_no_power(self) -> None:
        assert abs(np.nanmean(self.power(1, 0.5, 0.5))) < 2e-5

    @pytest.mark.parametrize("moved", [0.0, 0.35, 0.5, 1.0])
    def test_a_shift_weakens_one_slant(self, moved: float) -> None:
        falling, rising = (self.power(s, 0.0, 1.0, moved=moved) for s in (1, -1))
        effect = slant_effect(falling, rising, 0.05)
        expected = -np.log(np.cos(2 * np.pi * moved / STRIPE_PX))
        assert effect.value == pytest.approx(expected, abs=0.006)
        assert effect.found == (moved > 0)

    def test_stripes_that_a_shift_wipes_out(self) -> None:
        falling, rising = (self.power(s, 0.0, 1.0, moved=1.5) for s in (1, -1))
        assert slant_effect(falling, rising, 0.05).value > 1.5

    @pytest.mark.parametrize("gain", [1.0, 1.06, 1.5])
    def test_grey_stripes_are_compared_with_their_levels(self, gain: float) -> None:
        low, high = 0.35, 0.65
        steps = {GREYS[0]: (low, 1e-8), GREYS[1]: (high, 1e-8), 255: (1.0, 1e-8)}
        half = gain * (high - low) / 2
        grey = self.power(1, 0.5 - half, 0.5 + half, seed=1)
        effect = sharpness_effect(grey, self.power(1, 0.0, 1.0), steps, 0.03)
        assert effect.value == pytest.approx(gain - 1, abs=0.01)
        assert effect.found == (gain > 1)

    def test_uncertain_levels_make_it_uncertain(self) -> None:
        full = self.power(1, 0.0, 1.0)
        steps = {GREYS[0]: (0.0, 0.01), GREYS[1]: (1.0, 0.01), 255: (1.0, 0.01)}
        assert sharpness_effect(full, full, steps, 0.03).sigma == pytest.approx(0.03**0.5)

    def test_too_few_tiles_give_no_result(self) -> None:
        few = np.r_[np.ones(5), np.full(30, np.nan)]
        assert not slant_effect(few, few, 0.05).known
        none = np.full(30, np.nan)
        assert not slant_effect(none, none, 0.05).known
