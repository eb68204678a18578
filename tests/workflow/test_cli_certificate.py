"""`procam compensate` reads back what it wrote: mistakes of the writer show in its certificate."""

import csv
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from picture_files import write_wide_gamut
from tiny_venue import Ran, procam, refused

from procam.files.images import stills
from procam.files.images.layers import RGB
from procam.files.images.pixels import write_image
from procam.files.images.stills import Still, write_still
from procam.maths.light.curves import srgb_encode
from procam.workflows.playout import sources
from procam.workflows.sample_content import half_sky

SIZE = 48
Writer = Callable[[Path, np.ndarray, Still, str], None]


def sky(path: Path, kind: type = np.uint8) -> Path:
    light = 0.1 + 0.7 * half_sky(SIZE)
    if np.dtype(kind).kind != "f":
        light = np.rint(np.iinfo(kind).max * srgb_encode(light))
    write_image(path, light.astype(kind), RGB)
    return path


def certificate(ran: Ran) -> dict[str, Any]:
    assert (ran.code, ran.err) == (0, ""), ran
    found: dict[str, Any] = json.loads(ran.out)["certificate"]
    return found


@pytest.mark.parametrize(
    ("source", "out", "kind", "codes"),
    [
        ("a.png", "b.png", np.uint8, 1.1),
        ("a.tif", "b.tif", np.uint16, 1.1),
        ("a.exr", "b.exr", np.float32, None),
        ("a.exr", "b.exr", np.float16, None),
        (
            "a.exr",
            "b.png",
            np.float32,
            6.0,
        ),  # rounded twice: bright content less scattered light is dark
        ("a.png", "b.exr", np.uint8, None),
    ],
)
@pytest.mark.parametrize("more", [[], ["--transfer", "gamma2.2"]])
def test_what_was_written_is_certified(
    source: str,
    out: str,
    kind: type,
    codes: float | None,
    more: list[str],
    kept: Path,
    tmp_path: Path,
) -> None:
    path = sky(tmp_path / source, kind)
    found = certificate(procam("compensate", kept, path, tmp_path / out, "--json", *more))
    assert (found["covers"], found["frames"], found["error_sigma"]) == ("file", 1, 0)
    assert found["error"] < {1: 0.01, 2: 1e-3, 4: 1e-4}[np.dtype(kind).itemsize]
    assert (found["error_codes"] is None) == (codes is None)
    assert found["error_codes"] is None or found["error_codes"] < (codes or 0)


def _darker(path: Path, rgb: np.ndarray, like: Still, transfer: str) -> None:
    write_still(path, rgb - rgb // 50, like, transfer)


def _shallow(path: Path, rgb: np.ndarray, like: Still, transfer: str) -> None:
    write_still(path, (rgb >> 8).astype(np.uint8), like, transfer)
    assert stills.read_still(path).rgb.dtype == np.uint8


def _named_linear(path: Path, rgb: np.ndarray, like: Still, transfer: str) -> None:
    write_still(path, rgb, like, "linear")


def _turned(path: Path, rgb: np.ndarray, like: Still, transfer: str) -> None:
    write_still(path, np.ascontiguousarray(rgb[::-1]), like, transfer)


@pytest.mark.parametrize(("writer", "least"), [(_darker, 50), (_named_linear, 1000), (_turned, 50)])
def test_a_mistake_of_the_writer_shows(
    writer: Writer, least: float, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "write_still", writer)
    source = sky(tmp_path / "a.png", np.uint16)
    found = certificate(procam("compensate", kept, source, tmp_path / "b.png", "--json"))
    assert found["error_codes"] > least


def test_codes_that_lost_their_low_bits_show(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """16 bits that were cut to 8 are off by up to a step of 8 bits, not of 16."""
    source = sky(tmp_path / "a.png", np.uint16)
    right = certificate(procam("compensate", kept, source, tmp_path / "b.png", "--json"))
    monkeypatch.setattr(sources, "write_still", _shallow)
    found = certificate(procam("compensate", kept, source, tmp_path / "b.png", "--json"))
    assert found["error"] > 50 * right["error"]


def test_a_file_that_is_cut_short_is_an_error(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(path: Path, rgb: np.ndarray, like: Still, transfer: str) -> None:
        write_still(path, rgb, like, transfer)
        path.write_bytes(path.read_bytes()[:-2000])

    monkeypatch.setattr(sources, "write_still", cut)
    for name in ("b.png", "b.exr", "b.tif"):
        assert f"{name} is " in refused(
            "compensate", kept, sky(tmp_path / "a.png"), tmp_path / name
        )


def test_people_read_a_sentence(kept: Path, tmp_path: Path) -> None:
    ran = procam("compensate", kept, sky(tmp_path / "a.png"), tmp_path / "b.png")
    assert "1 frame read back: where no limit holds, direct and scattered light together" in ran.out
    assert "of white (0.98 codes)" in ran.out


@pytest.mark.parametrize("suffix", [".mkv", ".mov"])
def test_first_and_last_frame_of_a_movie_are_read_back(
    suffix: str, kept: Path, tmp_path: Path
) -> None:
    pytest.importorskip("av", reason="needs the extra `video`")
    pytest.importorskip("matplotlib", reason="needs the extra `report`")
    from test_cli_frames_movies import FRAMES, shoot

    report = tmp_path / "r.csv"
    arguments = (shoot(tmp_path / "m.mkv"), tmp_path / f"o{suffix}", "--json", "--report", report)
    found = certificate(procam("compensate", kept, *arguments))
    assert (found["covers"], found["frames"]) == ("file", 2)
    with report.open(newline="") as file:
        checked = [row["checked"] for row in csv.DictReader(file)]
    assert checked == ["file", *[""] * (FRAMES - 2), "file"]
    if suffix == ".mkv":
        assert found["error_codes"] < 1.1
    else:  # 10 bits and as much error as 48 px of sharp edges give
        assert found["error"] < 0.3


def test_on_a_pipe_the_certificate_covers_memory_only(kept: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra `report`")
    report, frame = tmp_path / "r.csv", np.full((SIZE, SIZE, 3), 128, np.uint8)
    command = [sys.executable, "-m", "procam", "compensate", str(kept), "-", "-"]
    command += ["--edge", str(SIZE), "--pixels", "rgb24", "--report", str(report)]
    ran = subprocess.run(
        command, input=2 * frame.tobytes(), capture_output=True, env=os.environ, check=True
    )
    with report.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["checked"] for row in rows] == ["memory", "memory"]
    assert all(float(row["error_codes"]) < 1.1 for row in rows)
    assert b"2 frames checked in memory only" in ran.stderr


def test_a_colour_profile_is_converted_and_named(kept: Path, tmp_path: Path) -> None:
    """Once per clip; what is certified is the converted content."""
    folder = tmp_path / "in"
    folder.mkdir()
    for number in (1, 2):
        write_wide_gamut(folder / f"a.{number}.exr", SIZE)
    ran = procam("compensate", kept, folder, tmp_path / "out", "--json")
    document = json.loads(ran.out)
    assert len(document["notes"]) == 1
    assert "a.1.exr has the colour profile Rec.2020; its colours were" in document["notes"][0]
    assert ran.err == f"note: {document['notes'][0]}\n"
    assert document["certificate"]["error"] < 1e-5
