"""What `procam response` reports of photographs that do not fit, of raw files and of projectors.

The photographs are those of the study `foreign-responses`, which no estimator has a model of.
"""

import json
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from tiny_venue import procam

from procam.files.images.photos import load_response
from procam.files.images.pixels import read_image, write_image
from studies import foreign_brackets
from studies import foreign_responses as study
from studies.foreign_brackets import CASES, Brackets, Case, contrast, shoot, srgb

MOVING = Case("moving", (srgb,), 1, 5, moving=True)
WRONG = Case("wrong", (srgb,), 1, 5, wrong=True)
CHANNELS = Case("channels", (contrast, srgb, srgb), 1, 5)


@pytest.fixture
def small_photographs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the study's: enough for what a command says, if not for its intervals."""
    monkeypatch.setattr(foreign_brackets, "SHAPE", (90, 135))


def stored(brackets: Brackets, folder: Path) -> tuple[Path, str]:
    """The folder of the photographs, and their exposures as an option."""
    folder.mkdir()
    for number, pixels in enumerate(brackets.photographs):
        write_image(folder / f"img_{number}.png", pixels)
    return folder, ",".join(repr(value) for value in brackets.nominal_s.tolist())


@pytest.mark.parametrize("name", ["filmic (Hable), 2 stops", "film (logistic), 3 stops"])
def test_foreign_cameras_are_within_their_intervals(name: str) -> None:
    case = next(case for case in CASES if case.name == name)
    row = study.summary(case, [study.run(case, seed) for seed in range(2)])
    assert not row["refused"] and not row["wrong_curves"] and not row["wrong_left_out"]
    assert row["seeds_within"] == 2 and row["error"] < 0.01
    assert row["sigma"] < 0.02
    assert len(study.table([row, study.total([row])])) == 9


@pytest.mark.usefixtures("small_photographs")
def test_something_that_moves_is_marked_in_a_picture(tmp_path: Path) -> None:
    folder, exposures = stored(shoot(MOVING, 0), tmp_path / "b")
    (folder / "img_0.CR2").write_bytes(b"raw")
    out = tmp_path / "a.csv"
    ran = procam("response", folder, "--exposures", exposures, "--out", out)
    assert ran.code == 0, ran
    assert "% of the places do not fit, as where something moves" in ran.out
    assert "1 raw files (img_0.CR2 ...) lie beside the photographs: raw is linear and" in ran.out
    assert f"{out.with_suffix('.png')} marks in red what does not fit" in ran.out
    marked = read_image(out.with_suffix(".png"))
    red = marked[..., 0].astype(int) - marked[..., 1] > 100
    assert red[22:].mean() > 4 * red[:20].mean()


@pytest.mark.usefixtures("small_photographs")
def test_a_wrong_exposure_is_named_and_left_out(tmp_path: Path) -> None:
    brackets = shoot(WRONG, 0)
    grey = Brackets([p[..., 1] for p in brackets.photographs], brackets.nominal_s, brackets.wrong)
    folder, exposures = stored(grey, tmp_path / "b")
    out = tmp_path / "a.csv"
    ran = procam("response", folder, "--exposures", exposures, "--out", out, "--json")
    document = json.loads(ran.out)
    name = f"img_{brackets.wrong}.png"
    assert (ran.code, document["left_out"], document["overruled"]) == (0, [name], "")
    assert document["warnings"][0].startswith(f"{name} does not fit and is left out")
    assert len(document["photographs"]) == len(document["exposures_s"]) == 4


@pytest.mark.usefixtures("small_photographs")
def test_channels_that_differ_are_written_each(tmp_path: Path) -> None:
    folder, exposures = stored(shoot(CHANNELS, 0), tmp_path / "b")
    out = tmp_path / "a.csv"
    ran = procam("response", folder, "--exposures", exposures, "--out", out)
    assert "a curve for each channel" in ran.out and not out.with_suffix(".png").exists()
    _, light = load_response("a.csv", tmp_path) or ((), np.zeros(0))
    assert light.shape == (256, 3)


@pytest.mark.usefixtures("small_photographs")
def test_a_refused_curve_is_written_with_accept(tmp_path: Path) -> None:
    brackets = shoot(WRONG, 0)
    wrong = brackets.wrong or 0
    kept = slice(max(0, wrong - 2), max(0, wrong - 2) + 4)
    few = Brackets(brackets.photographs[kept], brackets.nominal_s[kept], None)
    folder, exposures = stored(few, tmp_path / "b")
    command = ("response", folder, "--exposures", exposures, "--out", tmp_path / "a.csv")
    assert procam(*command).code == 2
    ran = procam(*command, "--accept")
    assert ran.code == 0, ran
    assert "warning: accepted although a check refuses it: brackets: photograph" in ran.out
    assert (tmp_path / "a.csv").is_file() and (tmp_path / "a.png").is_file()


class TestProjector:
    """Photographs of flat grey levels."""

    DRIVES = (0, 16, 32, 64, 96, 128, 160, 192, 224, 255)
    GAMMA = 2.35

    def photographs(self, folder: Path, drives: tuple[int, ...] = DRIVES) -> Path:
        rng = np.random.default_rng(5)
        folder.mkdir()
        gain = 0.9 - 0.4 * np.hypot(*np.meshgrid(np.linspace(-1, 1, 180), np.linspace(-1, 1, 120)))
        for drive in drives:
            light = 0.002 + gain[..., None] * (drive / 255) ** self.GAMMA * np.array([0.8, 1, 0.7])
            noisy = light + 0.003 * np.sqrt(light) * rng.normal(size=light.shape)
            counts = np.rint(65535 * np.clip(noisy, 0, 1)).astype(np.uint16)
            write_image(folder / f"grey_{drive}.png", counts)
        return folder

    def test_its_curve(self, tmp_path: Path) -> None:
        folder, out = self.photographs(tmp_path / "g"), tmp_path / "p.csv"
        ran = procam("response", folder, "--projector", "--out", out, "--json")
        document = json.loads(ran.out)
        levels, values, sigma = (np.array(document[k]) for k in ("levels", "values", "sigma"))
        measured = np.isin(np.arange(257), np.rint(256 * np.array(self.DRIVES) / 255))
        error = values - levels[:, None] ** self.GAMMA
        assert np.abs(error).max() < 0.003
        assert sigma[measured].max() < 0.002
        assert out.read_text().startswith("level,red,green,blue\n")
        listed = ",".join(map(str, self.DRIVES))
        for number, drive in enumerate(self.DRIVES):
            (folder / f"grey_{drive}.png").rename(folder / f"img{number}_.png")
        ran = procam(
            "response", folder, "--projector", "--levels", listed, "--out", tmp_path / "q.csv"
        )
        assert (ran.code, "relative light of the projector" in ran.out) == (0, True)
        assert (tmp_path / "q.csv").read_text() == out.read_text()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (("--levels", "0,255"), "2 levels were given for 10 photographs; give one for each"),
            (("--levels", "0,x"), "--levels: '0,x' are no whole numbers with commas between"),
            (
                ("--levels", "0,16,32,64,96,128,160,192,224,240"),
                "each level once is needed, with 0 and 255",
            ),
            (
                ("--levels", "0,16,32,64,96,128,160,224,192,255"),
                r"light falls by 2\d\.\d% of white above drive 192/255",
            ),
        ],
    )
    def test_levels_that_do_not_fit(
        self, tmp_path: Path, options: tuple[str, ...], message: str
    ) -> None:
        folder = self.photographs(tmp_path / "g")
        ran = procam("response", folder, "--projector", *options, "--out", tmp_path / "p.csv")
        assert ran.code in (1, 2)
        assert re.search(message, ran.complaint), ran.complaint

    def test_photographs_that_cannot_serve(self, tmp_path: Path) -> None:
        folder = self.photographs(tmp_path / "g")
        command = ("response", folder, "--projector", "--out", tmp_path / "p.csv")
        white = folder / "grey_255.png"
        pixels = read_image(white)
        write_image(white, np.full_like(pixels, 65535))
        assert "squares of the picture are lit and nowhere saturated" in procam(*command).complaint
        write_image(white, (pixels // 257).astype(np.uint8))
        assert "give its response with --camera-response" in procam(*command).complaint
        for drive, exposure in ((255, 0.1), (0, 0.2)):
            put_exposure(folder / f"grey_{drive}.png", pixels, exposure)
        assert "photograph all levels at one exposure" in procam(*command).complaint
        white.rename(folder / "white.png")
        assert "its name must end in the level shown, 0 to 255" in procam(*command).complaint


def put_exposure(path: Path, pixels: np.ndarray, exposure_s: float) -> None:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, str(pixels.dtype))
    spec.attribute("ExposureTime", exposure_s)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(pixels)
    output.close()
