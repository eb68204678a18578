"""Merged exposures are unbiased and their variance is right."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_photographs import BLACK_SHARE, LAW, SENSOR, Array, photograph
from tolerances import SIGMAS

from procam.errors import InputError, ShapeError
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

    def test_more_exposures_help(self, rng: np.random.Generator) -> None:
        truth = np.full((50, 50), 1000.0)
        _, variance = self.merged(truth, rng)
        alone = LAW.variance(1000 * self.EXPOSURES[-1]) / self.EXPOSURES[-1] ** 2
        assert (variance < alone).all()

    def test_what_saturates_in_all_is_unknown(self, rng: np.random.Generator) -> None:
        truth = np.full((4, 5), 100.0)
        truth[1, 2] = 1e6
        radiance, variance = self.merged(truth, rng)
        lost = truth == 1e6
        assert np.array_equal(np.isnan(radiance), lost)
        assert np.array_equal(np.isnan(variance), lost)

    def test_order_does_not_matter(self, rng: np.random.Generator) -> None:
        truth = rng.uniform(10, 80_000, (30, 30))
        shots = [photograph(truth, e, rng) for e in self.EXPOSURES]
        ahead = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=LAW)
        back = merge_exposures(shots[::-1], self.EXPOSURES[::-1], sensor=SENSOR, noise=LAW)
        assert all(np.array_equal(a, b) for a, b in zip(ahead, back, strict=True))

    def test_one_exposure_is_itself(self, rng: np.random.Generator) -> None:
        shot = photograph(np.full((8, 8), 2000.0), 0.5, rng)
        radiance, variance = merge_exposures([shot], [0.5], sensor=SENSOR, noise=LAW)
        signal = shot - SENSOR.black_level
        assert np.allclose(radiance, signal / (0.5 * SENSOR.full_scale))
        expected = LAW.variance(signal) / (0.5 * SENSOR.full_scale) ** 2
        assert np.allclose(variance, expected)

    def test_pictures_that_do_not_belong_together(self) -> None:
        flat = np.full((4, 4), 100, np.uint16)
        with pytest.raises(InputError, match="each with its positive exposure"):
            merge_exposures([flat], [0.1, 0.2], sensor=SENSOR, noise=LAW)
        with pytest.raises(ShapeError, match="exposure 1"):
            merge_exposures([flat, flat[:2]], [0.1, 0.2], sensor=SENSOR, noise=LAW)

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

    def test_merged_pictures_with_holes_decode(self, rng: np.random.Generator) -> None:
        code = make_code("micro-phase", (240, 150))
        gain = np.full(240, 20_000.0)
        gain[-10:] = 1e7  # a glint
        decoder = Decoder(code, DecodeLimits(white_black=0.05, contrast=0.02))
        for number, picture in enumerate(generate(code)):
            rate = gain * ((picture[:ROWS, :, 0] / 255) ** 2.2 + BLACK_SHARE)
            shots = [photograph(rate, e, rng) for e in (0.1, 0.15)]
            decoder.add(number, merge_exposures(shots, (0.1, 0.15), sensor=SENSOR, noise=LAW)[0])
        found = decoder.result().map
        assert found.valid[:, 2:225].mean() > 0.95
        assert not found.valid[:, -8:].any()
