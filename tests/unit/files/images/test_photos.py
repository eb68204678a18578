"""Photographs taken without procam: order, headers, damage and counts."""

from pathlib import Path

import numpy as np
import pytest
from picture_files import write_with_header

from procam.errors import FileFormatError
from procam.files.images.layers import write_channels
from procam.files.images.photos import (
    list_photos,
    load_response,
    photo_counts,
    read_photo,
    write_response,
)
from procam.files.images.pixels import write_image
from procam.maths.light.curves import srgb_decode
from procam.model.optics import Sensor
from simulators.mistakes import with_zeros

SENSOR = Sensor(bits=12, black_level=64.0)
HEADER = {
    "ExposureTime": 0.125,
    "FNumber": 5.6,
    "Exif:PhotographicSensitivity": 400,
    "Exif:DateTimeOriginal": "2026:01:02 03:04:05",
}


def ramp(dtype: type, top: int) -> np.ndarray:
    return np.linspace(0, top, 40 * 30 * 3).reshape(30, 40, 3).astype(dtype)


class TestReading:
    def test_names_are_in_natural_order(self, tmp_path: Path) -> None:
        for name in ("img_10.tif", "img_9.TIF", "2.jpg", "img_9b.png", "notes.txt", "a.CR2"):
            (tmp_path / name).touch()
        photos, others = list_photos(tmp_path)
        assert [p.name for p in photos] == ["2.jpg", "img_9.TIF", "img_9b.png", "img_10.tif"]
        assert others == ["a.CR2", "notes.txt"]

    @pytest.mark.parametrize("suffix", ["tif", "png", "jpg"])
    def test_headers(self, tmp_path: Path, suffix: str) -> None:
        path = write_with_header(tmp_path / f"a.{suffix}", ramp(np.uint8, 255), **HEADER)
        photo = read_photo(path)
        assert photo.exposure_s == pytest.approx(0.125)
        assert photo.aperture == pytest.approx(5.6, rel=1e-3)
        assert photo.taken_s is not None
        later = dict(HEADER, **{"Exif:DateTimeOriginal": "2026:01:02 03:05:05"})
        other = read_photo(
            write_with_header(tmp_path / f"b.{suffix}", ramp(np.uint8, 255), **later)
        )
        assert other.taken_s == photo.taken_s + 60

    def test_no_header(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", ramp(np.uint16, 4000))
        photo = read_photo(tmp_path / "a.png")
        assert (photo.exposure_s, photo.taken_s, photo.aperture) == (None, None, None)

    def test_transparency_is_dropped(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", np.zeros((4, 5, 4), np.uint16))
        assert read_photo(tmp_path / "a.png").pixels.shape == (4, 5, 3)

    def test_a_jpeg_cut_short(self, tmp_path: Path) -> None:
        # the reader itself would fill the rest with grey
        noise = np.random.default_rng(0).integers(0, 255, (200, 300, 3)).astype(np.uint8)
        path = write_with_header(tmp_path / "a.jpg", noise)
        read_photo(path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(FileFormatError, match=r"a\.jpg is truncated"):
            read_photo(path)

    @pytest.mark.parametrize("channels", [1, 3])
    def test_a_jpeg_with_zeros_inside(self, tmp_path: Path, channels: int) -> None:
        """The decoder goes on behind them, with all that follows displaced."""
        rng = np.random.default_rng(channels)
        noise = rng.normal(120, 30, (300, 400, channels)).clip(0, 255).astype(np.uint8)
        path = write_with_header(tmp_path / "a.jpg", noise)
        read_photo(path)
        data = path.read_bytes()
        for _ in range(20):
            path.write_bytes(with_zeros(4096, rng, data))
            with pytest.raises(FileFormatError, match=r"a\.jpg is (truncated or )?damaged"):
                read_photo(path)

    @pytest.mark.parametrize(
        ("pixels", "suffix"),
        [
            (np.full((300, 400, 3), 3, np.uint8), ".jpg"),  # dark: its data are nearly all zeros
            (np.full((8, 8, 1), 200, np.uint8), ".jpeg"),
            (np.tile(np.arange(256, dtype=np.uint8), (70, 2))[..., None], ".jpg"),
        ],
    )
    def test_whole_jpegs_are_read(self, tmp_path: Path, pixels: np.ndarray, suffix: str) -> None:
        path = write_with_header(tmp_path / f"a{suffix}", pixels)
        assert read_photo(path).pixels.shape == pixels.shape
        preview = path.read_bytes()
        path.write_bytes(preview + bytes(512) + preview)  # some cameras append previews
        assert read_photo(path).pixels.shape == pixels.shape

    def test_floats_are_refused(self, tmp_path: Path) -> None:
        write_channels(tmp_path / "a.exr", dict.fromkeys("RGB", np.zeros((4, 4))))
        with pytest.raises(FileFormatError, match="has float32 pixels; export it as 16-bit TIFF"):
            read_photo(tmp_path / "a.exr")


class TestCounts:
    def test_linear_ones_stay_as_they_are(self, tmp_path: Path) -> None:
        pixels = ramp(np.uint16, 4095)
        write_image(tmp_path / "a.tif", pixels)
        counts = photo_counts(read_photo(tmp_path / "a.tif"), None, SENSOR)
        np.testing.assert_array_equal(counts, pixels)

    @pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 65535)])
    def test_srgb_becomes_light(self, tmp_path: Path, dtype: type, top: int) -> None:
        pixels = ramp(dtype, top)
        write_image(tmp_path / "a.png", pixels)
        response = load_response("srgb", tmp_path)
        counts = photo_counts(read_photo(tmp_path / "a.png"), response, SENSOR)
        expected = 64 + srgb_decode(pixels / top) * SENSOR.full_scale
        np.testing.assert_allclose(counts, expected, atol=0.51)
        assert counts.max() == 4095  # white stays recognisable as saturated

    def test_refusals(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", ramp(np.uint8, 255))
        with pytest.raises(FileFormatError, match=r'has 8 bits, .* set response = "srgb"'):
            photo_counts(read_photo(tmp_path / "a.png"), None, SENSOR)
        write_image(tmp_path / "b.png", ramp(np.uint16, 65535))
        with pytest.raises(
            FileFormatError, match="up to 65535, but bits = 12 allows less than 4096"
        ):
            photo_counts(read_photo(tmp_path / "b.png"), None, SENSOR)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("level,light\n0,0\n1,x\n", "each line needs two numbers"),
            ("0,0\n0.4,0.6,3\n1,1\n", "each line needs two numbers"),
            ("0,0\n0.5,0.6\n0.9,1\n", "must rise from 0,0 to 1,1"),
            ("0,0\n0.5,0.6\n0.5,0.7\n1,1\n", "must rise from 0,0 to 1,1"),
            ("", "must rise from 0,0 to 1,1"),
            (
                "level,red,green,blue\n0,0,0,0\n0.5,0.2,0.3,0\n1,1,1,1\n",
                "level,red,green,blue must rise from 0,0,0,0 to 1,1,1,1",
            ),
            ("level,red,green,blue\n0,0\n1,1\n", "must rise from 0,0,0,0 to 1,1,1,1"),
        ],
    )
    def test_bad_tables(self, tmp_path: Path, text: str, message: str) -> None:
        (tmp_path / "r.csv").write_text(text)
        with pytest.raises(FileFormatError, match=message):
            load_response("r.csv", tmp_path)


class TestCurvePerChannel:
    LEVELS = np.array([0.0, 0.5, 1.0])
    LIGHT = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [1.0, 1.0, 1.0]])

    def counts(self, tmp_path: Path, pixels: np.ndarray) -> np.ndarray:
        write_response(tmp_path / "r.csv", self.LEVELS, self.LIGHT)
        write_image(tmp_path / "a.png", pixels)
        response = load_response("r.csv", tmp_path)
        np.testing.assert_array_equal((response or ((), ()))[1], self.LIGHT)
        return photo_counts(read_photo(tmp_path / "a.png"), response, SENSOR)

    def test_each_channel_has_its_own(self, tmp_path: Path) -> None:
        counts = self.counts(tmp_path, np.full((4, 4, 3), 51, np.uint8))
        expected = SENSOR.black_level + 0.4 * self.LIGHT[1] * SENSOR.full_scale
        np.testing.assert_array_equal(counts[0, 0], np.rint(expected))

    def test_one_channel_takes_the_curve_of_green(self, tmp_path: Path) -> None:
        counts = self.counts(tmp_path, np.full((4, 4, 1), 51, np.uint8))
        expected = SENSOR.black_level + 0.4 * 0.2 * SENSOR.full_scale
        np.testing.assert_array_equal(counts, np.rint(expected))
