"""Binned cameras: which pixels are joined, and that rays and light stay what they are."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import FLOAT32, SOLVER

from procam.estimate.camera.binning import MOST_PIXELS, Binning
from procam.estimate.camera.radiance import Radiometer
from procam.maths.geometry.lenses import Lens, unproject
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import CameraModel, Sensor


def camera(size: tuple[int, int], kind: str = "kannala-brandt") -> CameraModel:
    """A fisheye whose circle fills the shorter side, or a pinhole; its centre is off the middle."""
    count = 4 if kind == "kannala-brandt" else 5
    middle = (np.array(size) - 1) / 2 + (30.3, -8.6)
    lens = Lens(kind, np.full(2, min(size) / 2 / 1.6), middle, np.zeros(count))
    return CameraModel("zenith", size, lens, Sensor(12, 64.0, (-0.03,)))


class TestWhichPixels:
    @pytest.mark.parametrize("size", [(480, 480), (1600, 1600), (2400, 2400)])
    def test_all_of_a_small_camera(self, size: tuple[int, int]) -> None:
        assert Binning.of(camera(size)) == Binning.none(size)

    @pytest.mark.parametrize(
        ("size", "factor"),
        [((6000, 4000), 2), ((5472, 3648), 2), ((4000, 4000), 2), ((8192, 5464), 3)],
    )
    def test_no_more_than_are_needed_of_a_large_one(
        self, size: tuple[int, int], factor: int
    ) -> None:
        found = Binning.of(camera(size))
        width, height = found.size
        assert found.factor == factor and width * height <= MOST_PIXELS
        assert height == size[1] // factor and 1 <= width / height < 1.16

    def test_the_circle_is_in_it_wherever_it_is(self) -> None:
        off = camera((6000, 4000))
        off = replace(off, lens=replace(off.lens, centre=np.array([3700.0, 2000.0])))
        found = Binning.of(off)
        left, right = found.origin[0], found.origin[0] + found.factor * found.size[0]
        # a stated centre may be 250 px off
        assert left < 3700 - 2250 and right > min(6000, 3700 + 2250) - found.factor

    def test_a_pinhole_has_no_circle(self) -> None:
        assert Binning.of(camera((3840, 2160), "brown")) == Binning(2, (0, 0), (1920, 1080))


BINNED = Binning(3, (10, 4), (20, 15))


class TestCamera:
    @pytest.mark.parametrize("kind", ["kannala-brandt", "brown"])
    def test_a_block_has_the_ray_of_its_middle(self, kind: str) -> None:
        whole = camera((100, 80), kind)
        binned = BINNED.camera(whole)
        assert binned.size == (20, 15)
        block = np.array([[7.0, 9.0]])
        middle = np.array(BINNED.origin) + 3 * block + 1
        np.testing.assert_allclose(
            unproject(block, binned.lens), unproject(middle, whole.lens), atol=SOLVER
        )


class TestPictures:
    def test_means_and_shares(self, rng: np.random.Generator) -> None:
        picture = rng.integers(0, 2**16, (80, 100, 3), np.uint16)
        expected = picture[4:49, 10:70].reshape(15, 3, 20, 3, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(BINNED.means(picture), expected, rtol=FLOAT32)
        mask = np.zeros((80, 100), bool)
        mask[4:6, 10:13], mask[7:8, 10:13] = True, True
        assert BINNED.most(mask)[:2, 0].tolist() == [True, False]
        assert BINNED.largest(mask)[:3, 0].tolist() == [True, True, False]

    def test_light_is_the_mean_and_a_saturated_pixel_spoils_its_block(self) -> None:
        whole = camera((100, 80))
        counts = np.full((80, 100), 1064, np.uint16)
        counts[40, 40], counts[31, 60] = 4095, 2064
        frame = Frame(counts, CameraSettings(0.1, "mono"), 0.0, 0.1)
        found = Radiometer(whole, BINNED).radiance(frame)
        assert np.isnan(found[12, 10]) and np.isnan(found).sum() == 1
        blocks = Radiometer(whole).radiance(frame)[4:49, 10:70].reshape(15, 3, 20, 3)
        blocks = np.moveaxis(blocks, 2, 1).reshape(15, 20, 9)
        sound = (blocks > 0).all(axis=-1)  # all of the block is seen
        assert found[9, 16] > 1.05 * found[9, 15]  # one count of nine is twice as high
        np.testing.assert_allclose(found[sound], blocks[sound].mean(axis=-1), rtol=2e-3)
