"""Any split of a clip's frames gives the bytes of a run over the whole, whatever the type and the method."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from lossless_movies import write_lossless
from tiny_venue import procam, refused, warped

from procam.files.images.movies import MovieReader
from procam.files.images.pixels import read_image, write_image
from procam.maths.geometry.sphere import master_directions
from procam.workflows.playout import frame as frame_settings
from procam.workflows.playout.chunks import Chunks

SIZE, COUNT = 64, 60
VIDEO = Chunks(20, 7)  # shorter than those of a show: several in these frames
RGB = ("R", "G", "B")


def frame(number: int) -> np.ndarray:
    """A bright front that turns by 2 degrees from frame to frame, over a dark rear."""
    direction, inside = master_directions(SIZE)
    angle = np.radians(2 * number)
    front = np.clip(direction @ [np.cos(angle), np.sin(angle), 0.2], 0, 1)
    return np.asarray(((0.01 + 0.8 * front**2) * inside)[..., None].repeat(3, -1), np.float32)


def shoot(folder: Path, suffix: str, kind: type) -> Path:
    for number in range(1, COUNT + 1):
        light = frame(number)
        if kind in (np.uint8, np.uint16):
            light = np.rint(light ** (1 / 2.2) * np.iinfo(kind).max)
        write_image(folder / f"sky.{number:04d}.{suffix}", light.astype(kind), RGB)
    return folder


def movie_of(count: int, path: Path) -> Path:
    codes = (np.rint(frame(number) ** (1 / 2.2) * 255) for number in range(count))
    return write_lossless(path, (picture.astype(np.uint8) for picture in codes))


def pixels(folder: Path) -> dict[str, bytes]:
    return {
        p.name: read_image(p).tobytes()
        for p in sorted(folder.glob("sky.*"))
        if p.suffix != ".jsonl"
    }


KINDS = {
    "8 bits": ("png", np.uint8, "exact"),
    "16 bits": ("png", np.uint16, "exact"),
    "half": ("exr", np.float16, "exact"),
    "float": ("exr", np.float32, "least-squares"),
    "video": ("exr", np.float16, "perceptual-video"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_any_split_gives_the_same_bytes(
    kind: str, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_settings, "VIDEO", VIDEO)
    suffix, dtype, method = KINDS[kind]
    source = shoot(tmp_path / "in", suffix, dtype)

    def run(out: str, *more: str) -> None:
        ran = procam("compensate", kept, source, tmp_path / out, "--method", method, *more)
        assert ran.code == 0, ran

    run("whole")
    for first, last in ((41, 60), (1, 7), (8, 40)):
        run("parts", "--frames", f"{first}-{last}")
    assert len(pixels(tmp_path / "whole")) == COUNT
    assert pixels(tmp_path / "parts") == pixels(tmp_path / "whole")
    written = (tmp_path / "parts" / f"sky.0009.{suffix}").stat().st_mtime_ns
    run("parts")  # the logs of the parts are read: nothing is left to do
    assert (tmp_path / "parts" / f"sky.0009.{suffix}").stat().st_mtime_ns == written


def test_two_ranges_into_one_folder_at_once(kept: Path, tmp_path: Path) -> None:
    source = shoot(tmp_path / "in", "png", np.uint8)
    assert procam("compensate", kept, source, tmp_path / "whole").code == 0
    command = [sys.executable, "-m", "procam", "compensate", str(kept), str(source)]
    runs = [
        subprocess.Popen(
            [*command, str(tmp_path / "parts"), "--frames", part],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            stderr=subprocess.DEVNULL,
        )
        for part in ("1-31", "30-60")
    ]
    assert [run.wait(120) for run in runs] == [0, 0]
    assert pixels(tmp_path / "parts") == pixels(tmp_path / "whole")
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "parts").glob("*.png")}
    assert procam("compensate", kept, source, tmp_path / "parts").code == 0
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "parts").glob("*.png")} == before


def test_a_part_of_a_movie(kept: Path, tmp_path: Path) -> None:
    source = movie_of(40, tmp_path / "sky.mkv")
    command = ("compensate", kept, source)
    shown = {}
    for name, more in (("whole", ()), ("part", ("--frames", "30-36"))):
        out = tmp_path / f"{name}.mkv"
        assert procam(*command, out, "--transfer", "srgb", *more).code == 0
        with MovieReader(out) as reader:
            shown[name] = [each.rgb.tobytes() for each in reader]
    assert shown["part"] == shown["whole"][30:37]
    other = procam(*command, tmp_path / "part.mkv", "--transfer", "srgb", "--frames", "1-9")
    assert other.code == 2 and "each part of a movie needs a file of its own" in other.complaint
    beyond = procam(*command, tmp_path / "x.mkv", "--transfer", "srgb", "--frames", "50-60")
    assert beyond.code == 2 and "--frames 50-60: IN has frames 0 to 39" in beyond.complaint
    assert not (tmp_path / "x.mkv").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("70-80", "--frames 70-80: IN has frames 1 to 60"),
        ("9-3", "--frames 9-3: is no range; give the first and last number, as 12-40"),
        ("all", "--frames all: is no range"),
    ],
)
def test_ranges_that_are_none(text: str, words: str, kept: Path, tmp_path: Path) -> None:
    source = shoot(tmp_path / "in", "png", np.uint8)
    assert words in refused("compensate", kept, source, tmp_path / "out", "--frames", text)
    assert not (tmp_path / "out").exists()


def test_a_range_that_goes_on_beyond_the_clip_is_said(kept: Path, tmp_path: Path) -> None:
    source = shoot(tmp_path / "in", "png", np.uint8)
    for run in (partial(procam, "compensate"), warped):
        ran = run(kept, source, tmp_path / run.__class__.__name__, "--frames", "58-70")
        assert ran.code == 0 and ran.err == "note: --frames 58-70: IN has frames 1 to 60 only\n"
    ran = procam(
        *("compensate", kept, movie_of(4, tmp_path / "m.mkv"), tmp_path / "o.mkv"),
        *("--transfer", "srgb", "--frames", "2-9"),
    )
    assert ran.code == 0 and "note: --frames 2-9: IN has frames 0 to 3 only" in ran.err


def test_one_picture_has_no_range(kept: Path, tmp_path: Path) -> None:
    write_image(tmp_path / "sky.png", (255 * frame(1)).astype(np.uint8), RGB)
    assert "--frames is for numbered pictures and movies" in refused(
        "compensate", kept, tmp_path / "sky.png", tmp_path / "o.png", "--frames", "1-2"
    )


def test_content_to_projectors_in_one_pass(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As compensated light that is warped, in parts too; a frame that was lost is made again alone."""
    monkeypatch.setattr(frame_settings, "VIDEO", VIDEO)
    source = shoot(tmp_path / "in", "exr", np.float32)
    command = ("compensate", kept, source)
    video = ("--method", "perceptual-video", "--frames")

    def of(folder: str) -> dict[str, bytes]:
        found = (tmp_path / folder).glob("*/sky.*.png")
        return {f"{p.parent.name}/{p.name}": read_image(p).tobytes() for p in sorted(found)}

    for method in ("exact", "perceptual-video"):
        assert procam(*command, tmp_path / f"{method}-light", "--method", method).code == 0
        assert warped(kept, tmp_path / f"{method}-light", tmp_path / f"{method}-two").code == 0
        more = ("--method", method, "--to", "projectors")
        assert procam(*command, tmp_path / f"{method}-one", *more).code == 0
        assert len(of(f"{method}-one")) == 2 * COUNT
        assert of(f"{method}-one") == of(f"{method}-two")
    for part in ("33-60", "1-32"):
        ran = procam(*command, tmp_path / "parts", "--to", "projectors", *video, part)
        assert ran.code == 0, ran
    assert of("parts") == of("perceptual-video-two")
    lost = tmp_path / "exact-two" / "south" / "sky.0050.png"
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "exact-two").glob("*/*.png")}
    lost.unlink()
    assert warped(kept, tmp_path / "exact-light", tmp_path / "exact-two").code == 0
    after = {p: p.stat().st_mtime_ns for p in (tmp_path / "exact-two").glob("*/*.png")}
    assert {p for p in after if after[p] != before[p]} == {
        tmp_path / "exact-two" / name / "sky.0050.png" for name in ("south", "north")
    }


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--to", "walls"), "--to walls: is unknown; choose screen or projectors"),
        (
            ("--to", "projectors", "--strength", "0.5"),
            "at full strength: leave out --strength, ",
        ),
    ],
)
def test_frames_of_projectors_that_are_refused(
    options: tuple[str, ...], words: str, kept: Path, tmp_path: Path
) -> None:
    write_image(tmp_path / "sky.exr", frame(1), RGB)
    assert words in refused("compensate", kept, tmp_path / "sky.exr", tmp_path / "out", *options)


def test_a_range_knows_what_a_whole_run_has_written_since(kept: Path, tmp_path: Path) -> None:
    """With other settings, between two runs of one range."""
    source = shoot(tmp_path / "in", "exr", np.float32)
    command = ("compensate", kept, source, tmp_path / "out")
    assert procam(*command, "--frames", "1-3").code == 0
    first = {name: pixels(tmp_path / "out")[name] for name in ("sky.0001.exr", "sky.0003.exr")}
    assert procam(*command, "--method", "none").code == 0
    assert procam(*command, "--frames", "1-3").code == 0
    after = pixels(tmp_path / "out")
    assert {name: after[name] for name in first} == first


def test_frames_after_a_changed_source_are_made_again(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a method whose pictures follow each other, whichever range was made in between."""
    monkeypatch.setattr(frame_settings, "VIDEO", VIDEO)
    source = shoot(tmp_path / "in", "exr", np.float16)
    command = ("compensate", kept, source)
    video = ("--method", "perceptual-video")
    assert procam(*command, tmp_path / "out", *video).code == 0
    for number in (5, 6):
        write_image(source / f"sky.{number:04d}.exr", frame(40 + number).astype(np.float16), RGB)
    assert procam(*command, tmp_path / "out", *video, "--frames", "1-6").code == 0
    assert procam(*command, tmp_path / "out", *video).code == 0
    assert procam(*command, tmp_path / "fresh", *video).code == 0
    assert pixels(tmp_path / "out") == pixels(tmp_path / "fresh")


def test_brackets_and_stars_in_names(kept: Path, tmp_path: Path) -> None:
    for number in (1, 2):
        picture = (255 * frame(number)).astype(np.uint8)
        write_image(tmp_path / "in" / f"sky[**].{number:04d}.png", picture, RGB)
    command = ("compensate", kept, tmp_path / "in", tmp_path / "out")
    assert procam(*command, "--frames", "1-1").code == 0
    written = (tmp_path / "out" / "sky[**].0001.png").stat().st_mtime_ns
    assert procam(*command).code == 0
    assert (tmp_path / "out" / "sky[**].0001.png").stat().st_mtime_ns == written
