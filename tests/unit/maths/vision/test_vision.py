"""Models of vision: published values, lines against curves, adjoints against their operators."""

from pathlib import Path

import numpy as np
import pytest

from procam.maths.colour_science import colour_science
from procam.maths.log_table import LogTable
from procam.maths.vision import contrast
from procam.maths.vision.contrast import sensitivity
from procam.maths.vision.hue import hue_difference
from procam.maths.vision.pu21 import BRIGHTEST, DARKEST, pu21, pu21_table
from procam.maths.vision.pyramid import Pyramid

SHAPE = (45, 38)


class TestPu21:
    def test_ends_and_a_hundred(self) -> None:
        # the authors fixed the scale so that 0.005 is 0 and 100 cd/m2 is 256
        np.testing.assert_allclose(pu21(np.array([0.0, 0.005, 100.0])), [0, 0, 256], atol=0.5)
        assert pu21(np.array(2e4)) == pu21(np.array(1e4))

    def test_the_table_is_the_curve(self) -> None:
        nits = np.geomspace(DARKEST, BRIGHTEST, 99_999).astype(np.float32)
        value, slope = pu21_table()(nits)
        np.testing.assert_allclose(value, pu21(nits), atol=1e-3)
        apart = (pu21(nits * 1.0001) - pu21(nits * 0.9999)) / (2e-4 * nits.astype(float))
        inner = slice(100, -100)
        np.testing.assert_allclose(slope[inner], apart[inner], rtol=0.02, atol=1e-3)


def test_a_table_clips_its_argument() -> None:
    square = LogTable(np.square, 0.5, 2.0)
    value, slope = square(np.array([0.1, 0.5, 1.0, 2.0, 9.0], np.float32))
    np.testing.assert_allclose(value, [0.25, 0.25, 1, 4, 4], rtol=1e-4)
    np.testing.assert_allclose(slope, [1, 1, 2, 4, 4], rtol=0.02)


class TestContrast:
    def test_shape_of_the_sensitivities(self) -> None:
        at = np.array([50.0])
        by_frequency = np.array([sensitivity(0, f, at)[0] for f in (0.25, 1, 4, 16, 40)])
        assert by_frequency.argmax() in (1, 2)  # band pass, 1 to 4 cycles per degree
        assert by_frequency[-1] < 0.02 * by_frequency.max()
        for channel in (1, 2):  # low pass
            colour = [sensitivity(channel, f, at)[0] for f in (1, 4, 16)]
            assert colour == sorted(colour, reverse=True)
        assert (np.diff(sensitivity(0, 4.0, np.array([0.01, 0.1, 1, 10]))) > 0).all()

    def test_values_of_the_table(self) -> None:
        # nodes are 32 steps from 0.005 to 10,000 cd/m2 and from 0.1 to 64 cycles per degree
        nits, frequency = np.geomspace(0.005, 1e4, 32), np.geomspace(0.1, 64, 32)
        with np.load(Path(str(contrast.__file__)).with_name("castle_csf.npz")) as stored:
            log = stored["log_sensitivity"]
        for channel, at in ((0, 5), (1, 17), (2, 30)):
            found = sensitivity(channel, frequency[at], nits)
            expected = 10 ** (log[channel][:, at] - 0.2797423303127289 / 20)
            np.testing.assert_allclose(found, expected, rtol=1e-4)

    def test_beyond_the_table_its_ends_count(self) -> None:
        dark, bright = sensitivity(0, 2.0, np.array([1e-9, 1e9]))
        np.testing.assert_allclose(
            [dark, bright], sensitivity(0, 2.0, np.array([0.005, 1e4])), rtol=1e-6
        )
        assert sensitivity(1, 1e-6, np.array([5.0])) == sensitivity(1, 0.1, np.array([5.0]))


class TestPyramid:
    @pytest.fixture(params=["whole", "disc"])
    def pyramid(self, request: pytest.FixtureRequest) -> Pyramid:
        y, x = np.indices(SHAPE)
        disc = np.hypot(y - 22, x - 20) < 17
        mask = disc if request.param == "disc" else np.ones(SHAPE, bool)
        return Pyramid(mask.astype(np.float32), 20.0)

    def test_adjoints(self, pyramid: Pyramid, rng: np.random.Generator) -> None:
        for level in range(len(pyramid)):
            fine, coarse = pyramid._masks[level].shape, pyramid._masks[level + 1].shape
            x = rng.normal(size=(2, *fine)).astype(np.float32)
            g = rng.normal(size=(2, *coarse)).astype(np.float32)
            np.testing.assert_allclose(
                np.vdot(pyramid.reduced(level, x), g),
                np.vdot(x, pyramid.reduced_adjoint(level, g)),
                rtol=1e-4,
                atol=1e-3,
            )
            np.testing.assert_allclose(
                np.vdot(pyramid.expanded(level, g), x),
                np.vdot(g, pyramid.expanded_adjoint(level, x)),
                rtol=1e-4,
                atol=1e-3,
            )

    def test_what_is_not_in_the_mask_does_not_count(
        self, pyramid: Pyramid, rng: np.random.Generator
    ) -> None:
        inside = pyramid._masks[0] > 0
        grey = np.where(inside, 0.25, rng.uniform(0, 9, SHAPE)).astype(np.float32)[None]
        for level in range(len(pyramid)):
            above = pyramid.reduced(level, grey)
            known = pyramid._masks[level + 1] > 0
            np.testing.assert_allclose(above[0][known], 0.25, rtol=1e-5)
            back = pyramid.expanded(level, above)
            np.testing.assert_allclose(back[0][pyramid._masks[level] > 0], 0.25, rtol=1e-5)
            grey = above

    def test_levels_reach_the_lowest_frequency_or_few_pixels(self) -> None:
        ones = np.ones((256, 256), np.float32)
        assert len(Pyramid(ones, 1.0)) == 2  # 0.5 and 0.08 cycles per degree: below 0.1
        assert len(Pyramid(ones, 1000.0)) == 6  # 256 to 4 px
        assert Pyramid(ones, 20.0).frequency(0) == 10
        assert Pyramid(ones, 20.0).frequency(2) == pytest.approx(10 * 0.3228 / 4)


class TestHue:
    def test_it_is_the_term_of_ciede2000(self, rng: np.random.Generator) -> None:
        colour = colour_science()
        lights = rng.uniform(0.001, 1, (2, 3, 400))
        lab = [
            colour.XYZ_to_Lab(np.asarray(colour.RGB_to_XYZ(light.T, "sRGB"))) for light in lights
        ]
        terms = colour.difference.delta_e.intermediate_attributes_CIE2000(*lab)
        expected = np.abs(terms.delta_H_p / terms.S_H)
        np.testing.assert_allclose(hue_difference(*lights), expected, rtol=0.01, atol=0.02)
