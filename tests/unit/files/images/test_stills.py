"""Pictures keep their type, other channels, straight alpha and attributes."""

import struct
import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from picture_files import TYPES, spec_of, write_spec_as_is

from procam.errors import FileFormatError
from procam.files.images.pixels import write_image
from procam.files.images.stills import read_still, write_still

KEPT = [
    (".png", "uint8"),
    (".png", "uint16"),
    (".tif", "uint8"),
    (".tif", "uint16"),
    (".tif", "float32"),
    (".exr", "float16"),
    (".exr", "float32"),
]


def _pixels(dtype: str, channels: int = 3, size: int = 12) -> np.ndarray:
    rng = np.random.default_rng(7)
    if dtype.startswith("float"):
        return rng.random((size, size, channels)).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max + 1, (size, size, channels)).astype(dtype)


def _raw(path: Path) -> tuple[np.ndarray, oiio.ImageSpec]:
    wanted = oiio.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), wanted)
    spec = source.spec()
    pixels = source.read_image(spec.format)
    source.close()
    return pixels, spec


def _png(path: Path, *chunks: tuple[bytes, bytes]) -> Path:
    """A black 4 x 4 PNG with the given chunks, written by hand."""
    whole = [
        (b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)),
        *chunks,
        (b"IDAT", zlib.compress(bytes(4 * 13))),
        (b"IEND", b""),
    ]
    parts = [
        struct.pack(">I", len(b)) + t + b + struct.pack(">I", zlib.crc32(t + b)) for t, b in whole
    ]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


class TestKept:
    @pytest.mark.parametrize(("suffix", "dtype"), KEPT)
    def test_type_and_values(self, tmp_path: Path, suffix: str, dtype: str) -> None:
        pixels = _pixels(dtype)
        still = read_still(write_spec_as_is(tmp_path / f"a{suffix}", pixels, spec_of(pixels)))
        np.testing.assert_array_equal(still.rgb, pixels)
        write_still(tmp_path / f"b{suffix}", pixels[::-1], still, still.transfer or "")
        found, spec = _raw(tmp_path / f"b{suffix}")
        assert str(spec.format) == TYPES.get(dtype, dtype)
        np.testing.assert_array_equal(found, pixels[::-1])

    @pytest.mark.parametrize(("suffix", "dtype"), KEPT[:5])
    def test_straight_alpha_passes_to_the_last_bit(
        self, tmp_path: Path, suffix: str, dtype: str
    ) -> None:
        pixels = _pixels(dtype, 4)
        path = write_spec_as_is(
            tmp_path / f"a{suffix}", pixels, spec_of(pixels, oiio__UnassociatedAlpha=1)
        )
        still = read_still(path)
        np.testing.assert_array_equal(still.rgb, pixels[..., :3])
        new = pixels[::-1, ..., :3].copy()
        write_still(tmp_path / f"b{suffix}", new, still, still.transfer or "")
        found, spec = _raw(tmp_path / f"b{suffix}")
        np.testing.assert_array_equal(found, np.dstack([new, pixels[..., 3]]))
        assert spec.get_int_attribute("oiio:UnassociatedAlpha") == 1

    def test_full_premultiplied_alpha_and_other_channels_pass(self, tmp_path: Path) -> None:
        pixels = _pixels("float16", 5)
        pixels[..., 3] = 1
        spec = spec_of(pixels)
        spec.channelnames = ("R", "G", "B", "A", "depth.Z")
        spec.alpha_channel = 3
        still = read_still(write_spec_as_is(tmp_path / "a.exr", pixels, spec))
        write_still(tmp_path / "b.exr", pixels[::-1, ..., :3].copy(), still, "linear")
        again = read_still(tmp_path / "b.exr")
        np.testing.assert_array_equal(again.rgb, pixels[::-1, ..., :3])
        found, spec = _raw(tmp_path / "b.exr")
        names = list(spec.channelnames)
        np.testing.assert_array_equal(found[..., names.index("depth.Z")], pixels[..., 4])
        assert (found[..., names.index("A")] == 1).all()

    def test_attributes_of_exr(self, tmp_path: Path) -> None:
        pixels = _pixels("float16")
        spec = spec_of(pixels, compression="piz", studio__take="planetarium", PixelAspectRatio=1.0)
        rec709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
        spec.attribute("chromaticities", "float[8]", rec709)
        spec.attribute("smpte:TimeCode", "timecode", (0x01020304, 0))
        spec.attribute("FramesPerSecond", "rational", (24000, 1001))
        still = read_still(write_spec_as_is(tmp_path / "a.exr", pixels, spec))
        write_still(tmp_path / "b.exr", pixels, still, "linear")
        before = {a.name: a.value for a in _raw(tmp_path / "a.exr")[1].extra_attribs}
        after = {a.name: a.value for a in _raw(tmp_path / "b.exr")[1].extra_attribs}
        assert after == before
        assert before["chromaticities"] == pytest.approx(rec709)
        assert (before["smpte:TimeCode"], before["studio:take"]) == ((0x01020304, 0), "planetarium")

    @pytest.mark.parametrize("suffix", [".png", ".tif"])
    def test_tags(self, tmp_path: Path, suffix: str) -> None:
        pixels = _pixels("uint8")
        spec = spec_of(
            pixels, ImageDescription="sky", Artist="me", XResolution=72.0, YResolution=36.0
        )
        spec.attribute("ResolutionUnit", "in")
        still = read_still(write_spec_as_is(tmp_path / f"a{suffix}", pixels, spec))
        write_still(tmp_path / f"b{suffix}", pixels, still, "srgb")
        before = {a.name: a.value for a in _raw(tmp_path / f"a{suffix}")[1].extra_attribs}
        after = {a.name: a.value for a in _raw(tmp_path / f"b{suffix}")[1].extra_attribs}
        packing = "tiff:RowsPerStrip"  # OpenImageIO's own choice
        assert {n: after.get(n) for n in before if n != packing} == {
            n: value for n, value in before.items() if n != packing
        }
        assert before["ImageDescription"] == "sky"

    def test_another_suffix_and_type_keep_the_common_attributes(self, tmp_path: Path) -> None:
        pixels = _pixels("uint8", 4)
        spec = spec_of(pixels, ImageDescription="sky", oiio__UnassociatedAlpha=1)
        still = read_still(write_spec_as_is(tmp_path / "a.tif", pixels, spec))
        write_still(tmp_path / "b.exr", pixels[..., :3] / np.float32(255), still, "linear")
        found, spec = _raw(tmp_path / "b.exr")
        np.testing.assert_allclose(found, pixels / 255, atol=1e-7)
        assert spec.get_string_attribute("ImageDescription") == "sky"
        assert spec.get_string_attribute("compression") == "zip"
        write_still(tmp_path / "b.png", pixels[..., :3].astype(np.uint16) * 257, still, "srgb")
        np.testing.assert_array_equal(_raw(tmp_path / "b.png")[0], pixels.astype(int) * 257)

    @pytest.mark.parametrize(("x", "y"), [(3, 2), (-2, -1), (0, 0), (50, 0)])
    def test_a_data_window_is_put_in_its_place(self, tmp_path: Path, x: int, y: int) -> None:
        pixels = _pixels("float16", size=12)
        spec = spec_of(pixels)
        spec.x, spec.y = x, y
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 16, 16
        still = read_still(write_spec_as_is(tmp_path / "a.exr", pixels, spec))
        canvas = np.zeros((120, 120, 3), np.float16)
        canvas[40 + y : 52 + y, 40 + x : 52 + x] = pixels
        np.testing.assert_array_equal(still.rgb, canvas[40:56, 40:56])
        write_still(tmp_path / "b.exr", still.rgb, still, "linear")
        assert _raw(tmp_path / "b.exr")[0].shape == (16, 16, 3)


class TestTransfer:
    @pytest.mark.parametrize(
        ("chunk", "name"),
        [
            ((b"gAMA", struct.pack(">I", 45455)), "gamma2.2"),
            ((b"gAMA", struct.pack(">I", 38462)), "gamma2.6"),
            ((b"gAMA", struct.pack(">I", 100000)), "linear"),
            ((b"sRGB", b"\0"), "srgb"),
            ((b"tEXt", b"Comment\0none"), "srgb"),
            ((b"gAMA", struct.pack(">I", 55556)), None),
        ],
    )
    def test_of_png(self, tmp_path: Path, chunk: tuple[bytes, bytes], name: str | None) -> None:
        assert read_still(_png(tmp_path / "a.png", chunk)).transfer == name

    def test_floats_are_linear_and_integers_srgb(self, tmp_path: Path) -> None:
        for suffix, dtype in KEPT:
            write_image(tmp_path / f"a{suffix}", _pixels(dtype))
            expected = "linear" if dtype.startswith("float") else "srgb"
            assert read_still(tmp_path / f"a{suffix}").transfer == expected

    def test_a_new_one_is_written(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", _pixels("uint8"))
        still = read_still(tmp_path / "a.png")
        write_still(tmp_path / "b.png", still.rgb, still, "gamma2.2")
        assert read_still(tmp_path / "b.png").transfer == "gamma2.2"


class TestRefused:
    @pytest.mark.parametrize(("suffix", "dtype"), [(".exr", "float16"), (".tif", "uint8")])
    def test_premultiplied_alpha(self, tmp_path: Path, suffix: str, dtype: str) -> None:
        pixels = _pixels(dtype, 4)
        pixels[..., 3] = 1 if suffix == ".exr" else 255
        pixels[2, 3:5, 3] = 0
        path = write_spec_as_is(tmp_path / f"a{suffix}", pixels, spec_of(pixels))
        with pytest.raises(
            FileFormatError, match="premultiplied alpha below 1 in 2 pixels"
        ) as caught:
            read_still(path)
        assert "unpremultiply or flatten it" in str(caught.value)

    def test_several_pictures_in_one_file(self, tmp_path: Path) -> None:
        specs = [
            spec_of(_pixels("float32"), **{"oiio__subimagename": n}) for n in ("left", "right")
        ]
        output = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
        assert output.open(str(tmp_path / "a.exr"), tuple(specs))
        output.write_image(_pixels("float32"))
        assert output.open(str(tmp_path / "a.exr"), specs[1], "AppendSubimage")
        output.write_image(_pixels("float32"))
        output.close()
        with pytest.raises(FileFormatError, match="holds 2 pictures; one is needed"):
            read_still(tmp_path / "a.exr")

    def test_grey(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", np.ones((4, 4), np.uint8))
        with pytest.raises(FileFormatError, match="has the channels Y; R, G and B are needed"):
            read_still(tmp_path / "a.png")

    def test_other_suffixes_are_refused(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", _pixels("uint8"))
        still = read_still(tmp_path / "a.png")
        with pytest.raises(FileFormatError, match=r"not '\.jpg'; rename it"):
            write_still(tmp_path / "b.jpg", still.rgb, still, "srgb")


def test_a_size_that_no_memory_holds_is_refused_before_it_is_allocated(tmp_path: Path) -> None:
    """Headers of EXR name two windows; either may be damaged or a trap."""
    path = tmp_path / "a.exr"
    write_image(path, np.zeros((4, 6, 3), np.float32), ("R", "G", "B"))
    content = path.read_bytes()
    for window, words in (
        (b"displayWindow", "display window has 60000x60000 px, more than 4096 MiB"),
        (b"dataWindow", "exceeds the 4096 MB limit"),
    ):
        start = content.index(window + b"\0box2i\0") + len(window) + 11
        box = struct.pack("<4i", 0, 0, 59999, 59999)
        path.write_bytes(content[:start] + box + content[start + 16 :])
        with pytest.raises(FileFormatError, match=words):
            read_still(path)
