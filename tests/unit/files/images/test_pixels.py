"""Pixels, maps and pictures written and read back, and the damaged files that are refused."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from linear_pictures import write_picture
from tolerances import FLOAT32

from procam.errors import FileFormatError
from procam.files.images.layers import read_channels, read_layers, write_channels, write_layers
from procam.files.images.pixels import read_image, read_spec, write_image, write_spec
from procam.files.images.stills import read_picture

KINDS = [
    (".png", np.uint8),
    (".png", np.uint16),
    (".tif", np.uint8),
    (".tif", np.uint16),
    (".tif", np.float32),
    (".exr", np.float32),
]


def _noise(dtype: type, shape: tuple[int, ...]) -> np.ndarray:
    rng = np.random.default_rng(5)
    if dtype is np.float32:
        return rng.normal(size=shape).astype(np.float32)
    return rng.integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)


class TestRoundTrip:
    @pytest.mark.parametrize(("suffix", "dtype"), KINDS)
    @pytest.mark.parametrize("shape", [(37, 53, 3), (37, 53, 1), (1, 1, 3)])
    def test_to_the_last_bit(
        self, tmp_path: Path, suffix: str, dtype: type, shape: tuple[int, ...]
    ) -> None:
        pixels = _noise(dtype, shape)
        write_image(tmp_path / f"a{suffix}", pixels)
        found = read_image(tmp_path / f"a{suffix}")
        assert found.dtype == dtype
        np.testing.assert_array_equal(found, pixels)

    def test_a_plane_comes_back_with_one_channel(self, tmp_path: Path) -> None:
        plane = _noise(np.uint16, (9, 7))
        write_image(tmp_path / "a.tif", plane)
        np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), plane[..., None])

    def test_strided_pixels(self, tmp_path: Path) -> None:
        pixels = _noise(np.uint16, (20, 30, 3))[::2, ::-3]
        write_image(tmp_path / "a.png", pixels)
        np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels)


class TestNamedChannels:
    def test_order_in_the_file_does_not_matter(self, tmp_path: Path) -> None:
        names = ["valid", "direction.z", "gain.R", "direction.x", "Z", "blend", "A"]
        channels = {name: _noise(np.float32, (6, 8)) + i for i, name in enumerate(names)}
        write_channels(tmp_path / "maps.exr", channels)
        found = read_channels(tmp_path / "maps.exr")
        assert set(found) == set(names)
        for name in names:
            np.testing.assert_array_equal(found[name], channels[name])

    @given(
        plane=hnp.arrays(
            np.float32, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.floats(width=32)
        )
    )
    def test_any_floats(self, tmp_path_factory: pytest.TempPathFactory, plane: np.ndarray) -> None:
        path = tmp_path_factory.mktemp("any") / "a.exr"
        write_channels(path, {"u": plane})
        np.testing.assert_array_equal(read_channels(path)["u"], plane)


class TestLayers:
    @pytest.mark.parametrize("height", [1, 63, 64, 129])
    def test_are_read_back(self, tmp_path: Path, height: int) -> None:
        shapes = {"hi": (height, 8, 3), "coverage": (height, 8), "albedo": (height, 8, 3)}
        layers = {name: _noise(np.float32, shape) for name, shape in shapes.items()}
        layers["coverage"][0, 0] = np.nan
        path = tmp_path / "maps.exr"
        write_layers(path, layers)
        found = read_layers(path)
        assert set(found) == set(layers)
        for name, layer in layers.items():
            np.testing.assert_array_equal(found[name], layer)
        channels = read_channels(path)
        np.testing.assert_array_equal(channels["hi.G"], layers["hi"][..., 1])
        assert read_spec(path)[1].get_string_attribute("compression") == "none"

    def test_consist_of_channels_with_one_prefix(self, tmp_path: Path) -> None:
        names = ["hi.G", "valid", "direction.z", "hi.R", "direction.x", "hi.B", "direction.y", "R"]
        channels = {name: _noise(np.float32, (70, 8)) + i for i, name in enumerate(names)}
        write_channels(tmp_path / "maps.exr", channels)
        found = read_layers(tmp_path / "maps.exr")
        assert set(found) == {"hi", "direction", "valid", "R"}
        for layer, parts in {"hi": "RGB", "direction": "xyz"}.items():
            expected = np.stack([channels[f"{layer}.{c}"] for c in parts], axis=-1)
            np.testing.assert_array_equal(found[layer], expected)
        np.testing.assert_array_equal(found["valid"], channels["valid"])
        np.testing.assert_array_equal(found["R"], channels["R"])

    @pytest.mark.parametrize(
        "names",
        [
            ["hi.R", "hi.G"],
            ["hi.r", "hi.g", "hi.b"],
            ["hi.A", "hi.G", "hi.B"],
            ["hi", "hi.G", "hi.B"],
            ["hi.R", "hi.x", "hi.y"],
        ],
    )
    def test_other_channels_are_refused(self, tmp_path: Path, names: list[str]) -> None:
        write_channels(tmp_path / "maps.exr", dict.fromkeys(names, np.zeros((4, 4))))
        with pytest.raises(FileFormatError, match="it needs a single one, or R, G and B"):
            read_layers(tmp_path / "maps.exr")

    def test_files_that_others_cropped_or_tiled(self, tmp_path: Path) -> None:
        pixels = _noise(np.float32, (100, 80, 3))
        for name, tile, at in (("tiled", 32, 0), ("moved", 0, 7)):
            spec = oiio.ImageSpec(80, 100, 3, "float")
            spec.tile_width = spec.tile_height = tile
            spec.y = at
            spec.channelnames = ("lo.R", "lo.G", "lo.B")
            write_spec(tmp_path / f"{name}.exr", pixels, spec)
            np.testing.assert_array_equal(read_layers(tmp_path / f"{name}.exr")["lo"], pixels)

    @pytest.mark.parametrize("damage", ["a bit flipped", "a page of zeros"])
    def test_damage_inside_never_reads_as_pixels(self, tmp_path: Path, damage: str) -> None:
        path, rng = tmp_path / "maps.exr", np.random.default_rng(6)
        layers = {"hi": _noise(np.float32, (200, 90, 3)), "lo": _noise(np.float32, (200, 90))}
        write_layers(path, layers)
        content = path.read_bytes()
        for place in rng.integers(2000, len(content), 40):
            changed = bytearray(content)
            if damage == "a bit flipped":
                changed[place] ^= 1 << int(rng.integers(8))
            else:
                page = slice(place // 4096 * 4096, place // 4096 * 4096 + 4096)
                changed[page] = bytes(len(changed[page]))
            path.write_bytes(changed)
            for reader in (read_layers, read_channels):
                with pytest.raises(FileFormatError, match=r"maps\.exr is (damaged|truncated)"):
                    reader(path)

    def test_damaged_channels_of_any_name_are_refused(
        self, tmp_path: Path, rng: np.random.Generator
    ) -> None:
        """Compressed data may still unpack after a change, to other values."""
        path = tmp_path / "map.exr"
        names = ("projector.x", "projector.y", "sigma", "direction.x", "direction.y", "direction.z")
        channels = {name: np.round(_noise(np.float32, (200, 90)), 1) for name in names}
        write_channels(path, channels)
        content = path.read_bytes()
        for place in rng.integers(2500, len(content), 40):
            changed = bytearray(content)
            changed[place] ^= 1 << int(rng.integers(8))
            path.write_bytes(changed)
            with pytest.raises(FileFormatError, match=r"map\.exr is (damaged|truncated)"):
                read_channels(path)

    def test_a_picture_made_of_some_layers_is_not_checked(self, tmp_path: Path) -> None:
        """Programs that copy layers keep attributes unknown to them."""
        layers = {"hi": _noise(np.float32, (20, 9, 3)), "lo": _noise(np.float32, (20, 9))}
        write_layers(tmp_path / "maps.exr", layers)
        spec = read_spec(tmp_path / "maps.exr")[1]
        cut = oiio.ImageSpec(9, 20, 3, "float")
        cut.attribute("procam:crc32", spec.get_string_attribute("procam:crc32"))
        cut.channelnames = ("R", "G", "B")
        write_spec(tmp_path / "hi.exr", layers["hi"], cut)
        np.testing.assert_array_equal(read_picture(tmp_path / "hi.exr")[0], layers["hi"])
        assert set(read_channels(tmp_path / "hi.exr")) == {"R", "G", "B"}


class TestPictures:
    def test_exr_is_linear_as_is(self, tmp_path: Path) -> None:
        light = np.abs(_noise(np.float32, (5, 6, 3))) * 3
        write_picture(tmp_path / "a.exr", light)
        np.testing.assert_array_equal(read_picture(tmp_path / "a.exr")[0], light)

    @pytest.mark.parametrize("suffix", [".png", ".tif"])
    def test_16_bit_srgb(self, tmp_path: Path, suffix: str) -> None:
        light = np.linspace(0, 1, 600, dtype=np.float32).reshape(10, 20, 3)
        write_picture(tmp_path / f"a{suffix}", light)
        found = read_picture(tmp_path / f"a{suffix}")[0]
        np.testing.assert_allclose(found, light, atol=3 * 0.5 / 65535)  # slope of sRGB at white

    def test_8_bit_middle_grey_is_a_fifth_of_the_light(self, tmp_path: Path) -> None:
        write_image(tmp_path / "a.png", np.full((2, 2, 3), 128, np.uint8))
        found = read_picture(tmp_path / "a.png")[0]
        np.testing.assert_allclose(found, 0.2158605, rtol=FLOAT32)

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_values_that_are_not_finite_are_refused(self, tmp_path: Path, bad: float) -> None:
        light = np.ones((4, 4, 3), np.float32)
        light[1, 2, 0] = light[3, 3, 1] = bad
        write_image(tmp_path / "a.exr", light, ("R", "G", "B"))
        with pytest.raises(FileFormatError, match=r"a\.exr: 2 values are NaN or infinite"):
            read_picture(tmp_path / "a.exr")

    def test_channels_are_found_by_name(self, tmp_path: Path) -> None:
        planes = {
            c: np.full((2, 2), v, np.float32)
            for c, v in zip("AZGRB", (1, *range(1, 5)), strict=True)
        }
        write_channels(tmp_path / "a.exr", planes)
        assert read_picture(tmp_path / "a.exr")[0][0, 0].tolist() == [3.0, 2.0, 4.0]


class TestDamage:
    @pytest.mark.parametrize(("suffix", "dtype"), KINDS)
    @pytest.mark.parametrize("share", [0.02, 0.5, 0.95])
    def test_a_truncated_file_never_reads_as_pixels(
        self, tmp_path: Path, suffix: str, dtype: type, share: float
    ) -> None:
        path = tmp_path / f"cut{suffix}"
        write_image(path, _noise(dtype, (120, 160, 3)))
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        for reader in (read_image, read_channels, read_layers, read_picture):
            with pytest.raises(FileFormatError) as caught:
                reader(path)
            assert str(caught.value).startswith(f"{path} is ")
            assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("content", [b"", b"this is no picture at all\n" * 9])
    def test_a_foreign_file(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "a.exr"
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"a\.exr is (not|truncated)") as caught:
            read_image(path)
        assert "\n" not in str(caught.value)

    def test_an_absent_file(self, tmp_path: Path) -> None:
        with pytest.raises(FileFormatError, match=r"none\.png: no such file; an image is needed"):
            read_image(tmp_path / "none.png")

    @pytest.mark.parametrize("name", ["a.jpg", "a"])
    def test_other_suffixes_are_refused(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(FileFormatError, match=r"written as \.png, \.tif or \.exr"):
            write_image(tmp_path / name, np.ones((4, 4, 3), np.uint8))
        assert list(tmp_path.iterdir()) == []
