"""Exposure brackets of the closed loop: when they are needed, and their merge."""

import numpy as np
import pytest

from procam.estimate.camera.exposure import MAX_EXPOSURE_S
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.closed_loop.brackets import bracket_for, merged_frame
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor

SENSOR = Sensor(bits=12, black_level=64.0)
NOISE = NoiseLaw(4.0, 0.5)


def _frame(rate: np.ndarray, exposure_s: float, rng: np.random.Generator) -> Frame:
    """A photograph of light (H, W, 3) [DN/s] with the noise of the law."""
    signal = rate * exposure_s
    noisy = signal + np.sqrt(NOISE.variance(signal)) * rng.normal(size=rate.shape) + 64
    counts = np.clip(np.rint(noisy), 0, 4095).astype(np.uint16)
    return Frame(counts, CameraSettings(exposure_s), 0.0, exposure_s)


class TestBracketFor:
    def test_one_exposure_where_it_is_enough(self) -> None:
        light = np.linspace(0.02, 1.0, 500)
        assert bracket_for(light, np.full(500, 1e-5), 0.1) == (0.1,)

    def test_a_uniform_picture_needs_no_longer_one(self) -> None:
        assert bracket_for(np.linspace(0.5, 1.0, 500), np.full(500, 0.05), 0.1) == (0.1,)

    @pytest.mark.parametrize(("darkest", "exposures"), [(0.1, 2), (0.01, 3)])
    def test_longer_ones_until_the_darkest_would_clip(self, darkest: float, exposures: int) -> None:
        light = np.linspace(darkest, 1.0, 500)
        light[:100] = darkest
        found = bracket_for(light, np.full(500, 0.05), 0.1)
        assert found == pytest.approx([0.1 * 4**k for k in range(exposures)])

    def test_no_exposure_is_longer_than_a_minute(self) -> None:
        light = np.linspace(0.01, 1.0, 500)
        light[:100] = 0.01
        assert max(bracket_for(light, np.full(500, 0.05), 10.0)) <= MAX_EXPOSURE_S


class TestMergedFrame:
    def test_keeps_the_light_and_is_less_noisy_in_the_dark(self, rng: np.random.Generator) -> None:
        rate = np.full((60, 60, 3), 200.0)
        rate[:, 30:] = 30000.0  # clips at 0.4 s
        frames = [_frame(rate, exposure_s, rng) for exposure_s in (0.4, 0.1)]
        merged = merged_frame(frames, SENSOR, NOISE)
        assert merged.settings.exposure_s == 0.1
        found = (merged.counts - 64) / 0.1
        dark, bright = found[:, :24], found[:, 36:]
        alone = (frames[1].counts[:, :24] - 64.0) / 0.1
        assert dark.std() < 0.5 * alone.std()
        for part, level in ((dark, 200.0), (bright, 30000.0)):
            assert abs(part.mean() - level) < 4 * part.std() / np.sqrt(part.size)

    def test_pixels_that_all_exposures_clip_are_saturated(self, rng: np.random.Generator) -> None:
        rate = np.full((20, 20, 3), 1e6)
        merged = merged_frame([_frame(rate, e, rng) for e in (0.1, 0.4)], SENSOR, NOISE)
        assert (merged.counts >= 4095).all()
