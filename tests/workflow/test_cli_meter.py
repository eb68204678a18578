"""`procam meter`: what it prints and writes, its exit codes, and a line for everything that is wrong."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_meter import EVERY, MIDDLE, RIGHT, XYZ_FROM_CONTENT, Meter, as_csv, known_dome
from tiny_venue import Ran, procam

from procam.files.calibration import save_calibration
from procam.model.calibration import Calibration
from procam.model.reading import MeterReading


@pytest.fixture(scope="module")
def dome(make_calibration: Callable[..., Calibration]) -> Calibration:
    return known_dome(make_calibration)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, dome: Calibration) -> Path:
    folder = tmp_path_factory.mktemp("meter") / "0001"
    save_calibration(dome, folder)
    return folder


@pytest.fixture(scope="module")
def readings(dome: Calibration) -> list[MeterReading]:
    return Meter(dome).read_all(("south", MIDDLE), ("north", RIGHT), patches=EVERY)


def run(folder: Path, stored: Path, readings: list[MeterReading], *more: str) -> Ran:
    table = folder / "readings.csv"
    table.write_text(as_csv(readings), "utf-8")
    return procam("meter", stored, table, "--out", folder / "colour.json", *more)


def test_what_it_prints(tmp_path: Path, stored: Path, readings: list[MeterReading]) -> None:
    ran = run(tmp_path, stored, readings)
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
    assert lines[11:] == [f"{tmp_path / 'colour.json'} written"]


def test_what_it_writes(tmp_path: Path, stored: Path, readings: list[MeterReading]) -> None:
    ran = run(tmp_path, stored, readings, "--json")
    written = json.loads((tmp_path / "colour.json").read_text("utf-8"))
    assert json.loads(ran.out) == {"out": str(tmp_path / "colour.json"), **written}
    matrix = np.array(written["xyz_from_content"]["value"])
    assert matrix == pytest.approx(XYZ_FROM_CONTENT, abs=1e-4)
    assert np.array(written["xyz_from_content"]["sigma"]).shape == (3, 3)
    assert written["nits_per_unit"]["value"] == pytest.approx(11.0, abs=1e-4)
    assert 0.05 < written["nits_per_unit"]["sigma"] < 0.3
    assert written["primaries_xy"]["red"] == pytest.approx([0.68, 0.32], abs=1e-5)
    assert written["contrast"] == pytest.approx(251.0, rel=1e-4)
    assert written["unshown_saturation"]["Rec.709"]["green"] == pytest.approx(0, abs=1e-6)
    assert written["quality"]["additivity_error"]["pass"] is True
    assert written["provenance"]["readings"] == "readings.csv"
    assert len(written["provenance"]["calibration_sha256"]) == 64


def test_a_failed_check(tmp_path: Path, stored: Path, readings: list[MeterReading]) -> None:
    boosted = [replace(r, xyz=r.xyz * (1.3 if r.patch == "white" else 1)) for r in readings]
    ran = run(tmp_path, stored, boosted)
    assert (ran.code, ran.err) == (1, "")
    assert ran.out.count("FAIL") == 2
    assert "note: north: red + green + blue differ by -23" in ran.out
    assert json.loads((tmp_path / "colour.json").read_text("utf-8"))["provenance"]["notes"]


def test_a_green_white_has_no_temperature(
    tmp_path: Path, stored: Path, readings: list[MeterReading]
) -> None:
    tint = np.array([0.4, 1.0, 0.3])
    ran = run(tmp_path, stored, [replace(r, xyz=r.xyz * tint) for r in readings])
    assert "no colour temperature (Duv +0." in ran.out
    written = json.loads((tmp_path / "colour.json").read_text("utf-8"))
    assert written["white_temperature_k"] is None


class TestRefusals:
    def _complaint(self, ran: Ran, folder: Path) -> str:
        assert ran.code == 2
        assert not (folder / "colour.json").exists()
        return ran.complaint

    def test_too_few(self, tmp_path: Path, stored: Path, readings: list[MeterReading]) -> None:
        ran = run(tmp_path, stored, readings[:2])
        assert "are of green, red; read three" in self._complaint(ran, tmp_path)

    def test_a_projector_of_another_dome(
        self, tmp_path: Path, stored: Path, readings: list[MeterReading]
    ) -> None:
        ran = run(tmp_path, stored, [*readings, replace(readings[0], projector="west")])
        assert self._complaint(ran, tmp_path) == (
            f"procam: {tmp_path / 'readings.csv'}:12: projector 'west' is not one of south, north"
        )

    def test_no_calibration(self, tmp_path: Path, readings: list[MeterReading]) -> None:
        ran = run(tmp_path, tmp_path, readings)
        assert "has no calibration.json" in self._complaint(ran, tmp_path)

    def test_where_to_write(self, tmp_path: Path, stored: Path) -> None:
        (tmp_path / "folder.json").mkdir()
        for name, words in (
            ("colour.toml", "its name must end in .json"),
            ("folder.json", "this is a folder"),
        ):
            ran = procam("meter", stored, tmp_path / "x.csv", "--out", tmp_path / name)
            assert ran.code == 2
            assert ran.complaint.startswith(f"procam: {tmp_path / name}: {words}; choose ")
