"""`procam session plan` and `procam decode`: plain structured light with folders of pictures."""

import json
import shutil
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import procam, refused

from procam.estimate.structured_light.codes import CODES
from procam.files.images.layers import read_channels
from procam.files.images.pixels import write_image


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
            assert message in refused("decode", folder, "--size", "64x64", out)

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
        complaint = refused(*arguments, "--code", "gray")
        assert "needs 26 (of procam's own codes there: micro-phase 18, gray 26, " in complaint
        assert "describe its code in a TOML file and give that with --code" in complaint
        assert procam(*arguments).code == 0  # patterns and decode mean the same code

    def test_other_files_are_not_overwritten(self, photos: Path, tmp_path: Path) -> None:
        (tmp_path / "map-look.png").write_text("precious")
        arguments = ("decode", photos, "--code", "gray", "--size", "1024x768")
        assert "map-look.png exists already" in refused(*arguments, tmp_path / "map.exr")
        assert (tmp_path / "map-look.png").read_text() == "precious"
        assert "must end in .exr" in refused(*arguments, tmp_path / "map.png")
        assert "among the photographs" in refused(*arguments, photos / "map.exr")

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

    def test_an_unknown_code(self, photos: Path, tmp_path: Path) -> None:
        arguments = ("--size", "1024x768", tmp_path / "m.exr", "--code", "morse")
        ran = procam("decode", photos, *arguments)
        expected = f"code: 'morse' is not a structured-light code of this version; choose {', '.join(CODES)}"
        assert (ran.code, expected in ran.complaint) == (2, True)
