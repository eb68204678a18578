"""`procam compensate` and `procam compensate --to projectors` on movies."""

import json
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lossless_movies import SRGB, write_lossless
from tiny_venue import Ran, procam, refused, warped

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import Warper
from procam.files.images.movies import MovieReader
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.model.calibration import Calibration
from procam.workflows.sample_content import half_sky

SIZE, FRAMES = 48, 4


def shots(alpha: bool = False) -> list[np.ndarray]:
    codes = np.rint(255 * srgb_encode(half_sky(SIZE))).astype(np.uint8)
    frames = [np.ascontiguousarray(np.rot90(codes, k)) for k in range(FRAMES)]
    if not alpha:
        return frames
    veil = np.linspace(0, 255, SIZE * SIZE).astype(np.uint8).reshape(SIZE, SIZE, 1)
    return [np.dstack([frame, veil]) for frame in frames]


def shoot(
    path: Path, transfer: int = SRGB, frames: list[np.ndarray] | None = None, **more: Any
) -> Path:
    frames = shots() if frames is None else frames
    return write_lossless(path, frames, rate=Fraction(24000, 1001), transfer=transfer, **more)


def shown(path: Path) -> list[np.ndarray]:
    with MovieReader(path) as reader:
        return [np.asarray(frame.rgb) for frame in reader]


class TestCompensate:
    def test_every_frame_is_what_the_compensator_gives(
        self, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        out = tmp_path / "o.mkv"
        ran = procam("compensate", kept, shoot(tmp_path / "m.mkv"), out, "--json")
        assert (ran.code, ran.err) == (0, ""), ran
        assert json.loads(ran.out)["frames"] == FRAMES
        compensator = Compensator(calibration, SIZE)
        for found, shot in zip(shown(out), shots(), strict=True):
            apart = np.abs(found.astype(int) - compensator.frame(shot))
            assert apart.max() <= 1
            assert (apart > 0).mean() < 0.01  # the solve ends within 2e-5

    @pytest.mark.parametrize(("primaries", "name"), [(1, ""), (2, ""), (9, "BT.2020"), (22, "22")])
    def test_primaries_that_are_not_honoured_are_named(
        self, primaries: int, name: str, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "m.mkv", primaries=primaries)
        ran = procam("compensate", kept, source, tmp_path / "o.mkv", "--json")
        notes = json.loads(ran.out)["notes"]
        assert ran.err == "".join(f"note: {note}\n" for note in notes)
        assert len(notes) == bool(name)
        assert all(f"{source} is tagged with primaries {name}, but" in note for note in notes)

    @pytest.mark.parametrize("primaries", [2, 9])
    @pytest.mark.parametrize("run", [partial(procam, "compensate"), warped])
    def test_a_frame_that_is_missing_is_named(
        self, run: Callable[..., Ran], primaries: int, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "m.mkv", primaries=primaries, lost=2)
        out = tmp_path / ("o" if run is warped else "o.mkv")
        (note,) = run(kept, source, out).err.splitlines()
        assert note.startswith("note: ")
        assert ("is tagged with primaries" in note) == (primaries == 9)
        assert f"frame 2 of {source} is shown at 0.125 s, out of step with 23.976 frames" in note

    def test_straight_alpha_passes_unchanged(self, kept: Path, tmp_path: Path) -> None:
        source = shoot(tmp_path / "m.mkv", frames=shots(alpha=True))
        assert procam("compensate", kept, source, tmp_path / "o.mkv").code == 0
        with MovieReader(tmp_path / "o.mkv") as reader:
            for frame, shot in zip(reader, shots(alpha=True), strict=True):
                np.testing.assert_array_equal(frame.alpha, shot[..., 3])

    def test_prores_is_within_a_step_of_it(self, kept: Path, tmp_path: Path) -> None:
        """Of smooth frames: at 48 px every edge of a sky is as sharp as an edge can be."""
        ramp = np.linspace(60, 200, SIZE)
        smooth = np.dstack(
            [np.add.outer(a * ramp, b * ramp) / 2 for a, b in ((1, 1), (0.8, 1), (1, 0.7))]
        )
        frames = [np.rint(np.rot90(smooth, k)).astype(np.uint8) for k in range(FRAMES)]
        source = shoot(tmp_path / "m.mkv", frames=[np.ascontiguousarray(f) for f in frames])
        for out in ("o.mkv", "o.mov"):
            assert procam("compensate", kept, source, tmp_path / out).code == 0
        for exact, near in zip(shown(tmp_path / "o.mkv"), shown(tmp_path / "o.mov"), strict=True):
            inside = np.hypot(*np.indices((SIZE, SIZE)) - (SIZE - 1) / 2) < 0.3 * SIZE
            assert np.sqrt(np.mean((exact / 255 - near / 65535)[inside] ** 2)) < 1 / 255

    def test_a_movie_that_is_there_is_not_made_again(self, kept: Path, tmp_path: Path) -> None:
        source, out = shoot(tmp_path / "m.mkv"), tmp_path / "o.mkv"
        assert procam("compensate", kept, source, out).code == 0
        first = out.stat().st_mtime_ns
        ran = procam("compensate", kept, source, out)
        assert (ran.code, "is complete and was made with the same settings" in ran.out) == (0, True)
        assert out.stat().st_mtime_ns == first
        assert procam("compensate", kept, source, out, "--strength", "0.5").code == 0
        assert out.stat().st_mtime_ns > first

    def test_a_movie_without_a_named_transfer_function(self, kept: Path, tmp_path: Path) -> None:
        source, out = shoot(tmp_path / "m.mkv", transfer=2), tmp_path / "o.mkv"
        ran = procam("compensate", kept, source, out)
        words = (
            "no transfer function that procam knows (its file says nothing of it); give one with --transfer: "
            "srgb, linear"
        )
        assert (ran.code, words in ran.complaint, "--transfer" in ran.complaint) == (2, True, True)
        assert not out.exists()
        assert procam("compensate", kept, source, out, "--transfer", "bt1886").code == 0
        with MovieReader(out) as reader:
            assert reader.transfer == "bt1886"

    @pytest.mark.parametrize(
        ("trc", "said"),
        [
            (16, "characteristics 16 (PQ)"),
            (18, "characteristics 18 (HLG)"),
            (5, "characteristics 5"),
        ],
    )
    def test_a_transfer_function_without_a_name_is_reported(
        self, trc: int, said: str, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "m.mkv", trc)
        ran = procam("compensate", kept, source, tmp_path / "o.mkv")
        words = f"frame 0 of {source}: no transfer function that procam knows (its file says "
        assert (ran.code, f"{words}transfer {said})" in ran.complaint) == (2, True), ran

    @pytest.mark.parametrize(
        ("source", "out", "words"),
        [
            ("m.mkv", "o.mp4", "written as .mov (ProRes 4444)"),
            ("m.mkv", "o.png", "written as .mov"),
            ("m.mkv", "m.mkv", "is IN itself"),
            ("wide.mkv", "o.mkv", f"{SIZE}x{SIZE - 8} px is no dome master"),
        ],
    )
    def test_refusals(self, source: str, out: str, words: str, kept: Path, tmp_path: Path) -> None:
        shoot(tmp_path / "m.mkv")
        shoot(tmp_path / "wide.mkv", frames=[shot[8:] for shot in shots()])
        before = sorted(tmp_path.iterdir())
        assert words in refused("compensate", kept, tmp_path / source, tmp_path / out)
        assert sorted(tmp_path.iterdir()) == before


class TestWarp:
    def test_a_movie_per_projector(
        self, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        ran = warped(kept, shoot(tmp_path / "m.mkv"), tmp_path / "frames", "--json")
        assert (ran.code, ran.err) == (0, "")
        paths = {name: tmp_path / "frames" / f"{name}.mkv" for name in ("south", "north")}
        assert json.loads(ran.out)["frames"] == [str(path) for path in paths.values()]
        found = {name: shown(path) for name, path in paths.items()}
        warper, clamp = Warper(calibration, SIZE, np.uint16), Compensator(calibration, SIZE, "none")
        for index, shot in enumerate(shots()):
            light = clamp.frame(np.asarray(srgb_decode(shot / 255), np.float32))
            for name, frame in warper.frame(light).items():
                np.testing.assert_allclose(found[name][index], frame, rtol=0, atol=1)
