"""Merged exposures are unbiased and their variance is right."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_photographs import BLACK_SHARE, LAW, SENSOR, Array, photograph
from tolerances import SIGMAS

from procam.estimate.camera.hdr import merge_exposures
from procam.estimate.structured_light.codes import generate, make_code
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import DecodeLimits
from procam.model.correspondence import CorrespondenceMap

ROWS = 40  # of the panel


class TestMerge:
    EXPOSURES = (0.02, 0.08, 0.32)

    def merged(self, rate: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        shots = [photograph(rate, e, rng) for e in self.EXPOSURES]
        radiance, variance = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=LAW)
        assert radiance.dtype == variance.dtype == np.float32
        return radiance * SENSOR.full_scale, variance * SENSOR.full_scale**2

    # faint; half full in the longest; clipped in the longest; clipped in the two longer
    @pytest.mark.parametrize("rate", [50.0, 6000.0, 16_000.0, 90_000.0])
    def test_unbiased_with_the_right_variance(self, rate: float, rng: np.random.Generator) -> None:
        truth = np.full((200, 200), rate)
        law = replace(LAW, floor=LAW.floor + 1 / 12)
        shots = [photograph(truth, e, rng) for e in self.EXPOSURES]
        radiance, variance = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=law)
        error = radiance.astype(float) * SENSOR.full_scale - rate
        expected = variance.astype(float).mean() * SENSOR.full_scale**2
        assert abs(error.mean()) < SIGMAS * np.sqrt(expected / error.size)
        # chi2 over its freedom, with four of its own sigmas
        chi2 = np.mean(error**2) / expected
        assert chi2 == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / error.size))

    def test_what_saturates_in_all_is_unknown(self, rng: np.random.Generator) -> None:
        truth = np.full((4, 5), 100.0)
        truth[1, 2] = 1e6
        radiance, variance = self.merged(truth, rng)
        lost = truth == 1e6
        assert np.array_equal(np.isnan(radiance), lost)
        assert np.array_equal(np.isnan(variance), lost)

    @pytest.mark.parametrize("share", [0.97, 0.995, 1.0, 1.05])
    def test_little_bias_near_saturation(self, share: float, rng: np.random.Generator) -> None:
        rate = share * SENSOR.full_scale / self.EXPOSURES[-1]
        radiance, variance = self.merged(np.full((200, 200), rate), rng)
        assert abs(radiance.mean() - rate) < 0.1 * np.sqrt(variance.max())

    def test_merged_codes_decode_where_no_single_exposure_does(
        self, rng: np.random.Generator
    ) -> None:
        code = make_code("micro-phase", (240, 150))
        gain = 20_000.0 * np.linspace(0.07, 1, 240) ** 2  # 200 to 1 across the panel
        rates = [gain * ((p[:ROWS, :, 0] / 255) ** 2.2 + BLACK_SHARE) for p in generate(code)]
        exposures = (0.15, 1.2)

        def alone(exposure_s: float) -> CorrespondenceMap:
            decoder = Decoder(code, DecodeLimits(6.0, 6.0, saturated=4095))
            for number, rate in enumerate(rates):
                decoder.add(number, photograph(rate, exposure_s, rng))
            return decoder.result().map

        decoder = Decoder(code, DecodeLimits(white_black=0.002, contrast=0.002))
        for number, rate in enumerate(rates):
            shots = [photograph(rate, e, rng) for e in exposures]
            merged = merge_exposures(shots, exposures, sensor=SENSOR, noise=LAW)
            decoder.add(number, *merged)
        whole = decoder.result().map
        assert whole.valid.mean() > 0.97
        assert whole.valid.mean() > max(alone(e).valid.mean() for e in exposures)
        inner = whole.valid[:, 5:-5]
        error = (whole.projector_xy[..., 0] - np.arange(240)) / whole.sigma_px[..., 0]
        # two exposures' variances are of the mean level, not of each sample's own
        assert 0.7 < np.mean(error[:, 5:-5][inner] ** 2) < 1.4
