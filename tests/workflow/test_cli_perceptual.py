"""`procam compensate --method perceptual` and `procam preview`, from pictures to pictures."""

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import procam

from procam.compensate.compensator import Compensator
from procam.compensate.perceptual.settings import Perceptual
from procam.files.images.layers import RGB
from procam.files.images.pixels import read_image, write_image
from procam.maths.geometry.sphere import master_directions
from procam.model.calibration import Calibration
from procam.workflows.playout.explain import views
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.sources import first_frame

SIZE = 64


def dusk(shift: int = 0) -> np.ndarray:
    direction, inside = master_directions(SIZE)
    dark = 0.03 * np.exp(0.6 * np.random.default_rng(3).normal(size=(SIZE, SIZE, 1)))
    light = np.where(direction[..., :1] > 0.1, 0.7, np.roll(dark, shift, axis=1))
    return np.repeat(light * inside[..., None], 3, axis=-1).astype(np.float32)


def shoot(path: Path, light: np.ndarray) -> Path:
    write_image(path, light, RGB)
    return path


def test_a_picture(kept: Path, calibration: Calibration, tmp_path: Path) -> None:
    source, out = shoot(tmp_path / "dusk.exr", dusk()), tmp_path / "sent.exr"
    options = ("--method", "perceptual", "--db", "1", "--white-nits", "30")
    report = tmp_path / "report.csv"
    ran = procam("compensate", kept, source, out, *options, "--report", report, "--json")
    assert (ran.code, ran.err) == (0, "")
    expected = Compensator(calibration, SIZE, Perceptual(1.0, 30.0)).frame(dusk())
    np.testing.assert_allclose(read_image(out)[..., :3], expected, atol=1e-3)
    found = json.loads(ran.out)
    assert 0.3 < found["luminance_loss_db"] <= 1.0
    head, row = (line.split(",") for line in report.read_text().splitlines())
    values = dict(zip(head, row, strict=True))
    assert float(values["luminance_loss_db"]) == found["luminance_loss_db"]
    assert 0 < float(values["from_exact"]) <= 1


def test_what_is_said(kept: Path, tmp_path: Path) -> None:
    source = shoot(tmp_path / "dusk.exr", dusk())
    ran = procam("compensate", kept, source, tmp_path / "sent.exr", "--method", "perceptual")
    said = r"1 of 1 frames differ from the exact method's; errors of luminance are \d\.\d\d dB "
    assert re.search(said, ran.out)
    assert "for a white of 14 cd/m2, assumed: state a darker dome's by --white-nits" in ran.out
    stated = ("--method", "perceptual", "--white-nits", "9")
    ran = procam("compensate", kept, source, tmp_path / "sent.exr", *stated)
    assert "at the most, for a white of 9 cd/m2\n" in ran.out
    certified = re.search(
        r"differ from the light that the method chose by at most (\S+) of", ran.out
    )
    assert certified is not None and float(certified[1]) < 1e-5
    flat = shoot(tmp_path / "flat.exr", np.full((SIZE, SIZE, 3), 0.5, np.float32))
    ran = procam("compensate", kept, flat, tmp_path / "same.exr", "--method", "perceptual")
    assert "0 of 1 frames differ from the exact method's\n" in ran.out


def test_numbered_pictures_follow_each_other(
    kept: Path, calibration: Calibration, tmp_path: Path
) -> None:
    for number in range(4):
        shoot(tmp_path / f"in.{number}.exr", dusk(number))
    command = ("compensate", kept, tmp_path / "in.#.exr", tmp_path / "out.#.exr")
    options = ("--method", "perceptual-video", "--db", "1")
    assert procam(*command, *options).code == 0
    ours = Compensator(calibration, SIZE, Perceptual(1.0, video=True))
    expected = [ours.frame(dusk(number)) for number in range(4)]

    def assert_as_expected() -> None:
        for number, frame in enumerate(expected):
            found = read_image(tmp_path / f"out.{number}.exr")[..., :3]
            np.testing.assert_allclose(found, frame, atol=1e-3)

    assert_as_expected()
    # one that is missing is made as it was, from those before it; with another source those after it change
    (tmp_path / "out.2.exr").unlink()
    before = [(tmp_path / f"out.{n}.exr").stat().st_mtime_ns for n in (1, 3)]
    assert procam(*command, *options).code == 0
    assert_as_expected()
    after = [(tmp_path / f"out.{n}.exr").stat().st_mtime_ns for n in (1, 3)]
    assert after == before
    shoot(tmp_path / "in.1.exr", dusk(9))
    assert procam(*command, *options).code == 0
    ours.restart()
    expected[:] = [ours.frame(dusk(number)) for number in (0, 9, 2, 3)]
    assert_as_expected()
    after = [(tmp_path / f"out.{n}.exr").stat().st_mtime_ns for n in (0, 3)]
    assert procam(*command, *options).code == 0  # nothing is missing: nothing is made
    assert (tmp_path / "out.3.exr").stat().st_mtime_ns == after[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--db", "1"), "--db: for --method perceptual or perceptual-video, not exact"),
        (
            ("--method", "subtract", "--db", "1", "--white-nits", "9"),
            "--db and --white-nits: for --method perceptual or perceptual-video, not subtract",
        ),
        (("--method", "perceptual", "--strength", "1.5"), "strength: 1.5 is outside 0"),
        (("--method", "perceptive"), "method: 'perceptive' is unknown"),
    ],
)
def test_options_that_do_not_fit(
    kept: Path, tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    source, out = shoot(tmp_path / "dusk.exr", dusk()), tmp_path / "sent.exr"
    ran = procam("compensate", kept, source, out, *options)
    assert ran.code == 2
    assert message in ran.err
    assert not out.exists()


@pytest.mark.parametrize("light", ["black", "one pixel"])
def test_odd_pictures(kept: Path, tmp_path: Path, light: str) -> None:
    picture = np.zeros((SIZE, SIZE, 3), np.float32)
    if light == "one pixel":
        picture[30, 30] = 1
    source, out = shoot(tmp_path / "odd.exr", picture), tmp_path / "sent.exr"
    ran = procam("compensate", kept, source, out, "--method", "perceptual")
    assert (ran.code, ran.err) == (0, "")
    assert np.isfinite(read_image(out)).all()


@pytest.mark.parametrize("command", ["compensate", "preview"])
def test_holes_in_a_picture(kept: Path, tmp_path: Path, command: str) -> None:
    picture = dusk()
    picture[20:22, 30] = np.nan
    source, out = shoot(tmp_path / "odd.exr", picture), tmp_path / "out"
    rest = (out.with_suffix(".exr"), "--method", "perceptual")
    ran = procam(command, kept, source, *(rest if command == "compensate" else ("p.html",)))
    assert ran.code == 2
    assert "holes" in ran.err


class Page(HTMLParser):
    """What a preview shows: the pictures by name, and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.images, self.said = dict[str, bytes](), ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        if tag == "img" and (found.get("id") or "").startswith("view-"):
            address = found["src"] or ""
            self.images[str(found["alt"])] = base64.b64decode(address.split(",", 1)[1])

    def handle_data(self, data: str) -> None:
        self.said += data


class TestPreview:
    def test_every_method_beside_the_target(self, kept: Path, tmp_path: Path) -> None:
        source, out = shoot(tmp_path / "dusk.exr", dusk()), tmp_path / "dusk.html"
        ran = procam("preview", kept, source, out, "--db", "1", "--json")
        assert (ran.code, ran.err) == (0, "")
        assert json.loads(ran.out)["page"] == str(out)
        page = Page(out.read_text())
        assert list(page.images) == ["Today", "Exact", "Least squares", "Perceptual", "Target"]
        assert len(set(page.images.values())) == 5
        assert all(data.startswith(b"\x89PNG") for data in page.images.values())
        assert "no person has judged it" in page.said
        assert not re.search(r"""(src|href)=["']https?:""", out.read_text())

    def test_8_bits_end_at_white(self, calibration: Calibration, tmp_path: Path) -> None:
        """Under today's white places ask for more than full drive of an 8-bit file."""
        codes = np.rint(255 * np.clip(1.3 * dusk(), 0, 1)).astype(np.uint8)
        frame = first_frame(shoot(tmp_path / "a.png", codes))
        settings = FrameSettings(white="keep", transfer="linear")
        found = views(calibration, frame, settings)["exact"]
        ours = Compensator(calibration, SIZE, white="keep", transfer_name="linear")
        light = codes / np.float32(255)
        np.testing.assert_array_equal(found, ours.predict(light, 1.0).observed)
        without_end = ours.predict(light)
        assert without_end.direct.max() > 1.02
        assert np.abs(found - without_end.observed).max() > 0.02

    def test_its_name(self, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        for number in range(2):
            shoot(tmp_path / f"dusk.{number}.exr", dusk())
        ran = procam("preview", kept, tmp_path / "dusk.%d.exr")
        assert (ran.code, ran.err) == (0, "")
        assert (tmp_path / "dusk.preview.html").is_file()
        ran = procam("preview", kept, "-")
        assert ran.code == 2
        assert "a preview needs a file" in ran.err

    def test_distances_from_the_target(self, kept: Path, tmp_path: Path) -> None:
        source, out = shoot(tmp_path / "dusk.exr", dusk()), tmp_path / "dusk.html"
        for db in (0.0, 1.0):
            assert procam("preview", kept, source, out, "--db", db).code == 0
            today, exact, _, ours = map(float, re.findall(r"([\d.]+) dB; bright", _bare(out)))
            assert today < ours
            assert exact - db - 0.06 <= ours  # both rounded to 0.1 dB
            assert abs(exact - ours) < 1.5

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (("page.txt",), "the name must end in .html"),
            (("--db", "-2"), "db: -2 is below 0"),
            (("--state", "full"), "state"),
        ],
    )
    def test_what_is_refused(
        self, kept: Path, tmp_path: Path, options: tuple[str, ...], message: str
    ) -> None:
        source = shoot(tmp_path / "dusk.exr", dusk())
        where = () if "page.txt" in options else (tmp_path / "page.html",)
        ran = procam("preview", kept, source, *where, *options)
        assert ran.code == 2
        assert message in ran.err
        assert not (tmp_path / "page.html").exists()


def _bare(path: Path) -> str:
    """A page without its pictures."""
    return re.sub(r'"data:[^"]*"', '""', path.read_text())
