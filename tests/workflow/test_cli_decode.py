"""`procam session plan` and `procam decode`: plain structured light with folders of pictures."""

import json
import shutil
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import procam

from procam.estimate.structured_light.codes import CODES
from procam.files.images.layers import read_channels
from procam.files.images.pixels import write_image
from procam.maths.codes.gray import stripe


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Real structured-light photographs of another program, one PNG each."""
    folder = tmp_path_factory.mktemp("photos")
    path = resources.files("calib_data") / "captures" / "kamino_pose3_crop.npz"
    with path.open("rb") as file, np.load(file) as data:
        for number, pixels in enumerate(data["images"]):
            write_image(folder / f"{number:02d}.png", pixels)
        expected = np.stack([data["expected_x"], data["expected_y"]], axis=-1)
    np.save(folder / "expected.npy", expected)
    return folder


def straight_on(folder: Path, names: Sequence[str]) -> None:
    """The stripes of a panel of 24x10 seen straight on, three pixels for one of it, by these names."""
    width, height = 24, 10
    planes = []
    for axis, size in (("x", width), ("y", height)):
        for bit in reversed(range(5 if axis == "x" else 4)):
            line = np.asarray(stripe(size, bit))[None, :]
            line = line if axis == "x" else line.T
            planes += [np.broadcast_to(line ^ inverse, (height, width)) for inverse in (0, 1)]
    planes += [np.ones((height, width), int), np.zeros((height, width), int)]
    folder.mkdir()
    for name, plane in zip(names, planes, strict=True):
        pixels = np.kron(10 + 200 * plane, np.ones((3, 3), int))
        write_image(folder / name, pixels.astype(np.uint16))


class TestDecode:
    def test_real_photographs(self, photos: Path, tmp_path: Path) -> None:
        out = tmp_path / "map.exr"
        limits = ("--white-black", "40", "--contrast", "5")
        ran = procam(
            "decode",
            photos,
            "--code",
            "gray",
            "--size",
            "1024x768",
            out,
            *limits,
            "--json",
        )
        document = json.loads(ran.out)
        assert (ran.code, ran.err) == (0, "")
        channels = read_channels(out)
        assert set(channels) == {"projector.x", "projector.y", "sigma"}
        expected = np.load(photos / "expected.npy")
        valid = expected[..., 0] >= 0
        assert document["decoded"] == valid.sum()
        np.testing.assert_array_equal(np.isfinite(channels["sigma"]), valid)
        for i, axis in enumerate("xy"):
            np.testing.assert_array_equal(channels[f"projector.{axis}"][valid], expected[valid, i])

    def test_generated_patterns_seen_straight_on(self, tmp_path: Path) -> None:
        folder = tmp_path / "photos"
        straight_on(folder, [f"shot-{number:02d}.tif" for number in range(20)])
        ran = procam(
            "decode",
            folder,
            "--code",
            "gray",
            "--size",
            "24x10",
            tmp_path / "m.exr",
        )
        assert ran.code == 0
        assert "2160 pixels decoded, 100.0% of the picture" in ran.out
        found = read_channels(tmp_path / "m.exr")
        y, x = np.mgrid[:30, :72] // 3
        np.testing.assert_array_equal(found["projector.x"], x)
        np.testing.assert_array_equal(found["projector.y"], y)

    def test_a_wrong_number_of_pictures(self, photos: Path, tmp_path: Path) -> None:
        out = tmp_path / "map.exr"
        ran = procam("decode", photos, "--code", "gray", "--size", "1280x800", out)
        assert (ran.code, out.exists()) == (2, False)
        assert (
            "there are 42 pictures, and the code gray of a projector of 1280x800 needs 44"
            in ran.complaint
        )
        empty = tmp_path / "empty"
        empty.mkdir()
        for folder, message in (
            (empty, "there are 0 pictures"),
            (tmp_path / "gone", "no such folder"),
        ):
            ran = procam("decode", folder, "--size", "64x64", out)
            assert (ran.code, message in ran.complaint) == (2, True)

    def test_stripes_from_fine_to_coarse(self, photos: Path, tmp_path: Path) -> None:
        """Some programs show them in this order."""
        folder = tmp_path / "fine-first"
        folder.mkdir()
        pairs = [*range(9, -1, -1), *range(19, 9, -1), 20]
        for number, old in enumerate(2 * pair + i for pair in pairs for i in (0, 1)):
            shutil.copy(photos / f"{old:02d}.png", folder / f"{number:02d}.png")
        ran = procam("decode", folder, "--code", "gray", "--size", "1024x768", tmp_path / "map.exr")
        assert "agree with the code gray of a 1024x768 projector" in ran.out + ran.err

    def test_a_wrong_count_is_answered_with_what_would_fit(self, tmp_path: Path) -> None:
        assert procam("lens", "patterns", tmp_path / "p", "--size", "64x40").code == 0
        arguments = ("decode", tmp_path / "p", "--size", "64x40", tmp_path / "m.exr")
        ran = procam(*arguments, "--code", "gray")
        assert ran.code == 2
        assert "needs 26 (of procam's own codes there: micro-phase 18, gray 26, " in ran.complaint
        assert "describe its code in a TOML file and give that with --code" in ran.complaint
        assert procam(*arguments).code == 0  # patterns and decode mean the same code

    def test_names_without_zeros_are_in_order(self, tmp_path: Path) -> None:
        folder = tmp_path / "plain"
        straight_on(folder, [f"img_{number}.tif" for number in range(20)])
        ran = procam("decode", folder, "--code", "gray", "--size", "24x10", tmp_path / "map.exr")
        assert (ran.code, "exchanged" in ran.out) == (0, False)
        x = np.arange(72) // 3
        np.testing.assert_array_equal(read_channels(tmp_path / "map.exr")["projector.x"][0], x)

    def test_other_files_are_not_overwritten(self, photos: Path, tmp_path: Path) -> None:
        (tmp_path / "map-look.png").write_text("precious")
        arguments = ("decode", photos, "--code", "gray", "--size", "1024x768")
        ran = procam(*arguments, tmp_path / "map.exr")
        assert (ran.code, "map-look.png exists already" in ran.complaint) == (2, True)
        assert (tmp_path / "map-look.png").read_text() == "precious"
        ran = procam(*arguments, tmp_path / "map.png")
        assert (ran.code, "must end in .exr" in ran.complaint) == (2, True)
        ran = procam(*arguments, photos / "map.exr")
        assert (ran.code, "among the photographs" in ran.complaint) == (2, True)

    def test_all_alike(self, tmp_path: Path) -> None:
        folder = tmp_path / "dark"
        folder.mkdir()
        for number in range(18):
            write_image(folder / f"{number:02d}.png", np.full((60, 80), 7, np.uint8))
        ran = procam(
            *("decode", folder, "--size", "64x40", "--code", "micro-phase"),
            tmp_path / "map.exr",
        )
        assert (ran.code, "all 18 are alike, level 7" in ran.complaint) == (2, True)

    def test_mixed_sizes(self, photos: Path, tmp_path: Path) -> None:
        folder = tmp_path / "mixed"
        shutil.copytree(photos, folder)
        write_image(folder / "07.png", np.zeros((256, 380), np.uint8))
        ran = procam("decode", folder, "--code", "gray", "--size", "1024x768", tmp_path / "map.exr")
        assert (ran.code, ran.err) == (0, "")
        left_out, missing, *_ = ran.out.splitlines()
        assert (
            left_out
            == "07.png: 380x256 px of uint8, unlike most, which are 384x256 px of uint8; left out"
        )
        assert missing == "missing: column bit 6 inverse, after 06.png; done without"
        expected = np.load(photos / "expected.npy")
        found = read_channels(tmp_path / "map.exr")
        both = np.isfinite(found["sigma"]) & (expected[..., 0] >= 0)
        assert both.sum() >= 0.99 * (expected[..., 0] >= 0).sum()
        np.testing.assert_array_equal(found["projector.x"][both], expected[both, 0])

    def test_a_truncated_photograph(self, photos: Path, tmp_path: Path) -> None:
        folder = tmp_path / "cut"
        shutil.copytree(photos, folder)
        path = folder / "30.png"
        path.write_bytes(path.read_bytes()[:4000])
        ran = procam("decode", folder, "--code", "gray", "--size", "1024x768", tmp_path / "map.exr")
        assert (ran.code, "30.png is truncated" in ran.complaint) == (2, True)
        assert not (tmp_path / "map.exr").exists()

    @pytest.mark.parametrize("size", ["1024x", "0x768", "1024X768", "-4x8", ""])
    def test_a_bad_size(self, size: str, photos: Path, tmp_path: Path) -> None:
        out = tmp_path / "map.exr"
        ran = procam("decode", photos, f"--size={size}", out)
        assert (ran.code, out.exists()) == (2, False)
        assert f"--size: {size!r} is not of the form WIDTHxHEIGHT" in ran.complaint

    def test_an_unknown_code(self, photos: Path, tmp_path: Path) -> None:
        arguments = ("--size", "1024x768", tmp_path / "m.exr", "--code", "morse")
        ran = procam("decode", photos, *arguments)
        expected = f"code: 'morse' is not a structured-light code of this version; choose {', '.join(CODES)}"
        assert (ran.code, expected in ran.complaint) == (2, True)
