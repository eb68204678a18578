"""`procam compensate`, to the screen and to projectors, on numbered pictures: what is kept and refused."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import Ran, procam, refused, warped
from tolerances import FLOAT32

from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import Warper
from procam.errors import InputError
from procam.files.calibration import save_calibration
from procam.files.images.layers import RGB
from procam.files.images.pixels import read_image, write_image
from procam.files.images.stills import read_still
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.model.calibration import Calibration
from procam.workflows.playout.frame import ERRORS, require_photometry
from procam.workflows.sample_content import half_sky

SIZE, FIRST, COUNT = 48, 7, 4
NUMBERS = range(FIRST, FIRST + COUNT)


def sky(index: int, dtype: type = np.float16) -> np.ndarray:
    """A frame of a turning sky, which fades; floats are linear, integers sRGB."""
    light = np.rot90(half_sky(SIZE), index) * (1 - 0.1 * index)
    if np.dtype(dtype).kind == "f":
        return np.ascontiguousarray(light, dtype)
    return np.rint(np.iinfo(dtype).max * srgb_encode(light)).astype(dtype)


def shoot(folder: Path, suffix: str = ".exr", dtype: type = np.float16) -> Path:
    for number in NUMBERS:
        write_image(folder / f"sky.{number:04d}{suffix}", sky(number - FIRST, dtype), RGB)
    return folder


def made(calibration: Calibration, index: int, dtype: type = np.float16) -> np.ndarray:
    return np.asarray(Compensator(calibration, SIZE).frame(sky(index, dtype)))


def assert_same(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal but for where a solve began: frames of a clip begin at the one before."""
    if found.dtype.kind == "f":
        close = 1e-3 if found.dtype == np.float16 else FLOAT32  # an ulp
        np.testing.assert_allclose(found.astype(float), expected.astype(float), close, 1e-6)
        return
    apart = np.abs(found.astype(int) - expected)
    assert apart.max() <= 1
    assert (apart > 0).mean() < 0.01


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


class TestSequences:
    @pytest.mark.parametrize(
        ("suffix", "dtype"),
        [(".exr", np.float16), (".exr", np.float32), (".png", np.uint8), (".tif", np.uint16)],
    )
    def test_every_frame_is_what_the_compensator_gives(
        self, suffix: str, dtype: type, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "in", suffix, dtype)
        ran = procam("compensate", kept, source / f"sky.%04d{suffix}", tmp_path / "out", "--json")
        assert (ran.code, ran.err) == (0, ""), ran
        document = json.loads(ran.out)
        assert (document["frames"], document["method"]) == (COUNT, "exact")
        wanted = [f"sky.{n:04d}{suffix}" for n in NUMBERS]
        assert names(tmp_path / "out") == sorted([*wanted, "sky.procam.jsonl"])
        for index, name in enumerate(wanted):
            pixels = read_still(tmp_path / "out" / name).rgb
            assert pixels.dtype == dtype
            assert_same(pixels, made(calibration, index, dtype))

    @pytest.mark.parametrize("pattern", ["", "sky.####.exr", "sky.%04d.exr"])
    def test_a_folder_and_both_patterns_mean_the_same(
        self, pattern: str, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "in")
        out = tmp_path / "out" / "direct_%02d.png"
        assert procam("compensate", kept, source / pattern, out).code == 0
        wanted = [f"direct_{n:02d}.png" for n in NUMBERS]
        assert set(names(out.parent)) == {*wanted, "direct.procam.jsonl"}
        assert read_image(out.parent / wanted[0]).dtype == np.uint16

    def test_light_becomes_codes_and_codes_light(self, kept: Path, tmp_path: Path) -> None:
        """With strength 0 the content comes out; only its encoding changes."""
        shoot(tmp_path / "half")
        shoot(tmp_path / "codes", ".png", np.uint8)
        for source, out in (("half", "a.##.png"), ("codes", "b.##.exr")):
            ran = procam("compensate", kept, tmp_path / source, tmp_path / out, "--strength", "0")
            assert ran.code == 0, ran
        codes = read_image(tmp_path / f"a.{FIRST:02d}.png") / 65535
        light = np.asarray(sky(0), float)
        assert np.abs(srgb_decode(codes) - light).max() < 3 / 65535  # sRGB's slope at white
        exr = np.asarray(read_still(tmp_path / f"b.{FIRST:02d}.exr").rgb)
        assert exr.dtype == np.float32
        np.testing.assert_allclose(exr, srgb_decode(sky(0, np.uint8) / 255), atol=1e-6)

    def test_a_report_and_pictures_that_explain(self, kept: Path, tmp_path: Path) -> None:
        pytest.importorskip("matplotlib", reason="needs the extra `report`")
        source, report = shoot(tmp_path / "in"), tmp_path / "r" / "clip.csv"
        arguments = ("--report", report, "--explain", tmp_path / "why")
        ran = procam("compensate", kept, source, tmp_path / "out", *arguments)
        assert (ran.code, ran.err) == (0, ""), ran
        with report.open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert [int(row["frame"]) for row in rows] == list(NUMBERS)
        columns = {
            f"{c}_{x}" for c in ("share_lo", "share_hi", "flux_in", "flux_out", "s") for x in "rgb"
        }
        certificate = {"kkt", "self_consistency", "checked", *ERRORS}
        assert set(rows[0]) == {"frame", "above_one", *certificate, *columns}
        assert {row["checked"] for row in rows} == {"file"}
        assert all(float(row["flux_out_g"]) < float(row["flux_in_g"]) for row in rows)
        assert read_image(report.with_name("clip.plot.png")).shape[2] in (3, 4)
        pictures = ("content", "direct", "limits", "observed", "scattered", "without")
        assert names(tmp_path / "why") == sorted([*(f"{p}.exr" for p in pictures), "explained.png"])
        content, without, seen = (
            np.asarray(read_still(tmp_path / "why" / f"{p}.exr").rgb, float)
            for p in ("content", "without", "observed")
        )
        limits = np.asarray(read_still(tmp_path / "why" / "limits.exr").rgb)
        np.testing.assert_allclose(content, np.asarray(sky(0), float), atol=1e-6)
        free = limits == 0
        assert 0.3 < free.mean() < 1
        np.testing.assert_allclose(seen[free], content[free], atol=1e-5)
        assert (without[free] > content[free]).all()
        assert (seen[limits == 1] > content[limits == 1]).all()


class TestResume:
    def run(self, kept: Path, tmp_path: Path, *more: object) -> dict[str, int]:
        ran = procam("compensate", kept, tmp_path / "in", tmp_path / "out", *more)
        assert ran.code == 0, ran
        return {p.name: p.stat().st_mtime_ns for p in (tmp_path / "out").glob("*.exr")}

    def test_only_what_is_missing_or_changed_is_made(self, kept: Path, tmp_path: Path) -> None:
        shoot(tmp_path / "in")
        first = self.run(kept, tmp_path)
        lost, torn, changed, same = sorted(first)
        (tmp_path / "out" / lost).unlink()
        (tmp_path / "out" / torn).write_bytes((tmp_path / "out" / torn).read_bytes()[:99])
        write_image(tmp_path / "in" / changed, sky(3), RGB)
        again = self.run(kept, tmp_path)
        assert again[same] == first[same]
        assert all(again[name] > first[name] for name in (lost, torn, changed))
        read_still(tmp_path / "out" / torn)

    def test_other_settings_or_another_calibration_make_all_anew(
        self,
        calibration: Calibration,
        kept: Path,
        make_calibration: Callable[..., Calibration],
        tmp_path: Path,
    ) -> None:
        shoot(tmp_path / "in")
        first = self.run(kept, tmp_path)
        weak = self.run(kept, tmp_path, "--strength", "0.5")
        save_calibration(make_calibration(lo=0.01), tmp_path / "0002")
        other = self.run(tmp_path / "0002", tmp_path, "--strength", "0.5")
        for name in first:
            assert first[name] < weak[name] < other[name]

    def test_a_run_that_stopped_at_a_damaged_frame_goes_on(
        self, kept: Path, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "in")
        bad = source / f"sky.{FIRST + 2:04d}.exr"
        whole = bad.read_bytes()
        bad.write_bytes(whole[: len(whole) // 2])
        assert f"{bad} is truncated or damaged" in refused(
            "compensate", kept, source, tmp_path / "out"
        )
        there = sorted(p.name for p in (tmp_path / "out").glob("*.exr"))
        assert there == [f"sky.{n:04d}.exr" for n in (FIRST, FIRST + 1)]
        assert not list((tmp_path / "out").glob(".*"))
        before = {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in there}
        bad.write_bytes(whole)
        after = self.run(kept, tmp_path)
        assert len(after) == COUNT
        assert {name: after[name] for name in there} == before

    def test_the_report_of_a_resumed_run_is_whole(self, kept: Path, tmp_path: Path) -> None:
        pytest.importorskip("matplotlib", reason="needs the extra `report`")
        shoot(tmp_path / "in")
        self.run(kept, tmp_path, "--report", tmp_path / "a.csv")
        (tmp_path / "out" / f"sky.{FIRST + 1:04d}.exr").unlink()
        self.run(kept, tmp_path, "--report", tmp_path / "b.csv")
        first, second = ((tmp_path / f"{n}.csv").read_text().splitlines() for n in "ab")
        assert [line.split(",")[:2] for line in first] == [line.split(",")[:2] for line in second]


class TestRefused:
    def nan(self, path: Path) -> None:
        light = sky(0)
        light[20, 20, 1] = np.nan
        write_image(path, light, RGB)

    def other_size(self, path: Path) -> None:
        write_image(path, np.zeros((SIZE + 2, SIZE + 2, 3), np.float16), RGB)

    def other_type(self, path: Path) -> None:
        write_image(path, sky(0, np.float32), RGB)

    @pytest.mark.parametrize(
        ("spoil", "words"),
        [
            (nan, "1 values are NaN or infinite"),
            (other_size, f"{SIZE + 2} px, but the first frame has {SIZE}"),
            (other_type, "float32 pixels in linear, but the first frame has float16 in linear"),
        ],
    )
    def test_a_bad_frame_is_named(
        self, spoil: Callable[["TestRefused", Path], None], words: str, kept: Path, tmp_path: Path
    ) -> None:
        bad = shoot(tmp_path / "in") / f"sky.{FIRST + COUNT - 1:04d}.exr"
        spoil(self, bad)
        complaint = refused("compensate", kept, tmp_path / "in", tmp_path / "out")
        assert words in complaint
        assert str(bad) in complaint
        assert not (tmp_path / "out" / bad.name).exists()
        assert not list((tmp_path / "out").glob(".*"))

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("in", "in"), "is IN itself"),
            (("in", "in/sky.%04d.exr"), "is IN itself"),
            (("in", "out.exr"), "give a folder, or a pattern such as out.%04d.exr"),
            (("in", "out.%04d.jpg"), "not '.jpg'"),
            (("in", "out", "--transfer", "gamma9"), "transfer function 'gamma9' is unknown"),
            (("in", "out", "--method", "magic"), "'magic' is unknown"),
            (("in", "out", "--white", "bright"), "'bright' is unknown"),
            (("in", "out", "--strength", "1.5"), "1.5 is outside 0"),
            (("in", "out", "--state", "full"), "'full' was not measured"),
            (("in", "out", "--report", "clip.txt"), "the name must end in .csv"),
            (("in/no.%d.exr", "out"), "no picture has such a name"),
        ],
    )
    def test_wrong_arguments(
        self, arguments: tuple[str, ...], words: str, kept: Path, tmp_path: Path
    ) -> None:
        shoot(tmp_path / "in")
        before = names(tmp_path / "in")
        source, out, *more = arguments
        assert words in refused("compensate", kept, tmp_path / source, tmp_path / out, *more)
        assert (names(tmp_path), names(tmp_path / "in")) == (["in"], before)

    def test_light_above_one_is_reported_and_clipped(self, kept: Path, tmp_path: Path) -> None:
        bright = np.full((SIZE, SIZE, 3), 1.2, np.float32)
        bright[:4] = 0.5
        write_image(tmp_path / "a.exr", bright, RGB)
        ran = procam("compensate", kept, tmp_path / "a.exr", tmp_path / "b.exr")
        assert ran.code == 0
        assert (
            f"note: 1 frames ask for more than 1.0, frame 0 in {SIZE * (SIZE - 4)} pixels"
            in ran.out
        )

    @pytest.mark.parametrize("run", [partial(procam, "compensate"), warped])
    def test_a_calibration_that_has_not_measured_light(
        self, run: Callable[..., Ran], calibration: Calibration, tmp_path: Path
    ) -> None:
        source = shoot(tmp_path / "in")
        maps = replace(calibration.maps, hi=np.zeros_like(calibration.maps.hi))
        save_calibration(replace(calibration, maps=maps), tmp_path / "dark")
        ran = run(tmp_path / "dark", source, tmp_path / "out")
        assert (ran.code, "has no photometry" in ran.complaint) == (2, True), ran
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("name", "rows", "value", "words"),
        [
            ("coverage", slice(None), 0, "has no photometry"),
            ("scatter_per_flux", slice(None), np.nan, "has no photometry"),
            ("scatter_per_flux", 48, np.nan, "map scatter_per_flux are NaN or infinite"),
            ("lo", 48, np.nan, "map lo are NaN or infinite"),
            ("hi", 48, np.nan, "map hi are NaN or infinite"),
            ("coverage", 48, 2, "map coverage are below 0, above 1 or NaN"),
            ("falloff", slice(None), 0, "map falloff are 0 or less, NaN"),
            ("falloff", slice(None), np.nan, "map falloff are 0 or less, NaN"),
        ],
    )
    def test_maps_that_cannot_be(
        self, name: str, rows: slice | int, value: float, words: str, calibration: Calibration
    ) -> None:
        known = getattr(calibration.maps, name)
        torn = np.ones_like(calibration.maps.coverage) if known is None else known.copy()
        torn[rows] = value
        with pytest.raises(InputError, match=words):
            require_photometry(replace(calibration, maps=replace(calibration.maps, **{name: torn})))

    def test_places_are_counted_once_for_all_colours(self, calibration: Calibration) -> None:
        hi = calibration.maps.hi.copy()
        hi[SIZE // 2, 3:7] = np.nan
        torn = replace(calibration, maps=replace(calibration.maps, hi=hi))
        with pytest.raises(InputError, match="damaged: 4 places of its map hi are NaN"):
            require_photometry(torn)


class TestWarp:
    def test_numbered_pictures_go_to_a_folder_per_projector(
        self, calibration: Calibration, kept: Path, tmp_path: Path
    ) -> None:
        source, out = shoot(tmp_path / "in"), tmp_path / "frames"
        ran = warped(kept, source, out, "--json")
        assert (ran.code, ran.err) == (0, "")
        message = json.loads(ran.out)["frames"]
        assert message == [str(out / p / "sky.####.png") for p in ("south", "north")]
        warper, clamp = Warper(calibration, SIZE, np.uint16), Compensator(calibration, SIZE, "none")
        for number in NUMBERS:
            light = clamp.frame(np.asarray(sky(number - FIRST), np.float32))
            for name, frame in warper.frame(light).items():
                found = read_image(out / name / f"sky.{number:04d}.png")
                np.testing.assert_array_equal(found, frame)
