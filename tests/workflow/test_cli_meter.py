"""`procam meter`: what it prints and writes, its exit codes, and a line for everything that is wrong."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_meter import EVERY, MIDDLE, RIGHT, XYZ_FROM_CONTENT, Meter, as_csv, known_dome
from tiny_venue import Ran, contents, procam, refused

from procam.errors import FileFormatError
from procam.estimate.light.absolute import fit_absolute
from procam.files.calibration import load_calibration, save_calibration
from procam.files.images.pixels import write_image
from procam.files.versions import calibration_in_use, list_calibrations, use_calibration
from procam.model.calibration import Calibration
from procam.model.reading import MeterReading
from procam.workflows.playout.frame import FrameSettings


@pytest.fixture(scope="module")
def dome(make_calibration: Callable[..., Calibration]) -> Calibration:
    return known_dome(make_calibration)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, dome: Calibration) -> Path:
    folder = tmp_path_factory.mktemp("meter") / "0001"
    save_calibration(dome, folder)
    return folder


@pytest.fixture
def venue(tmp_path: Path, stored: Path) -> Path:
    shutil.copytree(stored, tmp_path / "venue" / "calibrations" / "0001")
    return tmp_path / "venue"


@pytest.fixture(scope="module")
def readings(dome: Calibration) -> list[MeterReading]:
    return Meter(dome).read_all(("south", MIDDLE), ("north", RIGHT), patches=EVERY)


def run(start: Path, readings: list[MeterReading], *more: str) -> Ran:
    table = start.parent / "readings.csv"
    table.write_text(as_csv(readings), "utf-8")
    return procam("meter", start, table, *more)


def test_what_it_prints(venue: Path, readings: list[MeterReading]) -> None:
    ran = run(venue, readings)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[0].startswith("reference white: 11 +- 0.")
    assert lines[0].endswith("cd/m2, x 0.3127 y 0.3290, 6504 K (Duv +0.0032)")
    # P3's primaries, SMPTE EG 432-1
    assert lines[1:4] == [
        "  red   x 0.6800 y 0.3200, 2.519 cd/m2",
        "  green x 0.2650 y 0.6900, 7.609 cd/m2",
        "  blue  x 0.1500 y 0.0600, 0.8722 cd/m2",
    ]
    assert lines[4] == "contrast: 251:1, full white over black at one place"
    assert lines[5].startswith("largest residual: ") and lines[5].endswith(", dE2000 0.00")
    assert lines[6:8] == ["Rec.709: all shown", "P3-D65: all shown"]
    assert lines[8].startswith("Rec.2020: saturation that cannot be shown: red ")
    assert [line.split()[0] for line in lines[9:11]] == ["residual_de2000", "additivity_error"]
    assert lines[11:] == [f"{venue / 'calibrations' / '0002'} written"]


def test_what_it_writes(venue: Path, readings: list[MeterReading]) -> None:
    """Another calibration, which differs in `absolute` and its provenance alone, and is in use."""
    first, second, third = (venue / "calibrations" / f"000{n}" for n in (1, 2, 3))
    assert run(venue, readings[:5]).code == 0
    use_calibration(venue, first)
    written = json.loads(run(venue.with_name("venue@2"), readings, "--json").out)
    assert written["calibration"] == str(third) and calibration_in_use(venue) == third
    before, made = load_calibration(first), load_calibration(third)
    fitted = fit_absolute(readings, before).colour
    assert before.absolute is None and made.absolute is not None
    np.testing.assert_array_equal(made.absolute.xyz_from_content, fitted.xyz_from_content)
    np.testing.assert_array_equal(made.absolute.covariance, fitted.covariance)
    np.testing.assert_allclose(fitted.xyz_from_content, XYZ_FROM_CONTENT, atol=1e-4)
    assert contents(first / "maps") == contents(third / "maps")
    one, two = (json.loads((p / "calibration.json").read_bytes()) for p in (first, third))
    meter = two["provenance"].pop("meter")
    assert one | {"absolute": two["absolute"]} == two
    assert meter["readings"] == "readings.csv" and len(meter["readings_sha256"]) == 64
    assert written["xyz_from_content"]["value"] == fitted.xyz_from_content.tolist()
    assert written["nits_per_unit"]["value"] == pytest.approx(11.0, abs=1e-4)
    assert 0.05 < written["nits_per_unit"]["sigma"] < 0.3
    assert written["primaries_xy"]["red"] == pytest.approx([0.68, 0.32], abs=1e-5)
    assert written["contrast"] == pytest.approx(251.0, rel=1e-4)
    assert written["unshown_saturation"]["Rec.709"]["green"] == pytest.approx(0, abs=1e-6)
    assert written["figures"]["additivity_error"]["pass"] is True
    (second / "calibration.json").write_text("{}")
    changed = run(venue.with_name("venue@2"), readings).complaint
    assert "calibration.json changed since procam wrote it" in changed


def test_perceptual_methods_take_its_white(venue: Path, readings: list[MeterReading]) -> None:
    run(venue, readings)
    picture = venue / "in.png"
    write_image(picture, np.random.default_rng(1).integers(0, 256, (64, 64, 3), np.uint8))
    for number, own, white in (
        (2, (), "11 cd/m2\n"),
        (2, ("--white-nits", "30"), "30 cd/m2\n"),
        (1, (), "14 cd/m2, assumed"),
    ):
        start, out = (
            venue.with_name(f"venue@{number}"),
            venue / f"{len(own)}-{number}-{white[:2]}.png",
        )
        ran = procam("compensate", start, picture, out, "--method", "perceptual", *own)
        assert (ran.code, f"for a white of {white}" in ran.out) == (0, True), ran
    newest = venue / "calibrations" / "0002"
    assert FrameSettings("perceptual").at(newest).white_nits == pytest.approx(11)
    assert FrameSettings("perceptual", white="keep").at(newest).white_nits is None  # brighter


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        ({}, "KeyError"),
        ([], "TypeError"),
        ({"xyz_from_content": [[1.0]]}, "1 x 1 numbers where 3 x 3 belong"),
        ({"covariance": (-np.eye(9)).tolist()}, "variances below 0"),
        ({"xyz_from_content": np.full((3, 3), np.nan).tolist()}, "xyz_from_content is nan"),
    ],
)
def test_a_damaged_entry_is_refused(
    venue: Path, readings: list[MeterReading], entry: object, why: str
) -> None:
    run(venue, readings)
    copy = shutil.copytree(venue / "calibrations" / "0002", venue / "copy")
    document = json.loads((copy / "calibration.json").read_bytes())
    document["absolute"] = document["absolute"] | entry if entry else entry
    (copy / "calibration.json").write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=f"damaged calibration .*{re.escape(why)}"):
        load_calibration(copy)
    assert why in refused("compensate", copy, "in.png", "out.png", "--method", "perceptual")


def test_a_failed_check(venue: Path, readings: list[MeterReading]) -> None:
    boosted = [replace(r, xyz=r.xyz * (1.3 if r.patch == "white" else 1)) for r in readings]
    ran = run(venue, boosted)
    assert (ran.code, ran.err) == (1, "")
    assert ran.out.count("FAIL") == 2
    assert "note: north: red + green + blue differ by -23" in ran.out
    assert "nothing written: " in ran.out
    document = json.loads(run(venue, boosted, "--json").out)
    assert document["calibration"] is None and document["notes"]
    assert [path.name for path in list_calibrations(venue)] == ["0001"]


def test_a_green_white_has_no_temperature(venue: Path, readings: list[MeterReading]) -> None:
    tinted = [replace(r, xyz=r.xyz * np.array([0.4, 1.0, 0.3])) for r in readings]
    assert "no colour temperature (Duv +0." in run(venue, tinted).out
    assert json.loads(run(venue, tinted, "--json").out)["white_temperature_k"] is None


def test_refusals(venue: Path, readings: list[MeterReading]) -> None:
    table = venue.parent / "readings.csv"
    west = [*readings, replace(readings[0], projector="west")]
    for start, read, message in (
        (venue, readings[:2], "are of green, red; read three"),
        (venue, west, f"procam: {table}:12: projector 'west' is not one of south, north"),
        (venue.parent, readings, "has no calibration.json"),
        (venue.with_name("venue@9"), readings, "has no calibration 9, only 1; choose"),
    ):
        ran = run(start, read)
        assert (ran.code, message in ran.complaint) == (2, True), ran
    table.unlink()
    assert "no such file" in procam("meter", venue, table).complaint
    assert [path.name for path in list_calibrations(venue)] == ["0001"]
