"""`procam venue compare`: its table, its JSON, its exit codes, and a line for everything that is wrong."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import procam

from procam.files.calibration import save_calibration
from procam.maths.geometry.pose import rotation_matrix
from procam.model.calibration import Calibration
from procam.model.transport import Measured

WIDEST = 100


@pytest.fixture(scope="module")
def where(tmp_path_factory: pytest.TempPathFactory, calibration: Calibration) -> Path:
    """A folder with a calibration `a` and relatives of it."""
    folder = tmp_path_factory.mktemp("compare")
    projectors = calibration.projectors
    south, north = projectors["south"], projectors["north"]
    turn = rotation_matrix([0.0, 0.0, 0.002])
    turned = {
        n: replace(p, surface=replace(p.surface, direction=p.surface.direction @ turn.T))
        for n, p in projectors.items()
    }
    flipped = {
        n: replace(p, surface=replace(p.surface, direction=p.surface.direction[:, ::-1]))
        for n, p in projectors.items()
    }
    unlit = Measured(np.full(3, np.nan), np.full(3, np.nan))
    m = calibration.feedback
    doubled = Measured(2 * m.value, m.sigma)
    for name, other in {
        "a": calibration,
        "turned": replace(calibration, projectors=turned, feedback=unlit, albedo=unlit),
        "bright": replace(calibration, feedback=doubled),
        "grown": replace(calibration, screen=replace(calibration.screen, radius_m=6.25)),
        "exchanged": replace(calibration, projectors={"south": north, "north": south}),
        "flipped": replace(calibration, projectors=flipped),
        "alone": replace(calibration, projectors={"south": south}),
    }.items():
        save_calibration(other, folder / name)
    return folder


class TestTable:
    def test_the_same_twice(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "a")
        assert (ran.code, ran.err) == (0, "")
        lines = ran.out.splitlines()
        assert lines[-1].startswith("verdict: the directions are the same to the last bit; ")
        assert (
            sum(line.startswith("  north ") for line in lines) == 4
        )  # as is, turned, areas, picture
        row = "  feedback m   0.3000 0.3300 0.4000  0.3000 0.3300 0.4000  0.0 0.0 0.0"
        assert row in lines

    @pytest.mark.parametrize("other", ["a", "turned", "exchanged", "flipped", "bright", "grown"])
    def test_fits_a_screen(self, where: Path, other: str) -> None:
        rows = procam("venue", "compare", where / "a", where / other).out.splitlines()
        assert max(len(row) for row in rows if not row.startswith(("A ", "B "))) <= WIDEST

    def test_a_rotation_is_not_a_failure(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "turned")
        assert ran.code == 0
        assert "the common rotation from B to A: 6.88 arcmin (x " in ran.out
        assert "z -6.88)" in ran.out
        assert "feedback" not in ran.out  # B has none

    def test_twice_the_feedback_fails(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "bright")
        assert ran.code == 1
        assert "verdict: the light differs, feedback by " in ran.out

    def test_only_another_radius_is_printed(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "grown")
        assert ran.code == 0
        (row,) = (row.split() for row in ran.out.splitlines() if row.startswith("  radius"))
        assert row[2:] == ["6.0000", "6.2500"]
        assert "degree" not in ran.out
        assert "radius" not in procam("venue", "compare", where / "a", where / "a").out


class TestJson:
    def test_contains_every_figure(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "turned", "--json")
        document = json.loads(ran.out, parse_constant=pytest.fail)
        assert document["a"] == str(where / "a")
        assert document["verdict"]["kind"] == "turned"
        assert list(document["projectors"]) == ["south", "north"]
        row = document["together"]
        assert row["as_is"]["rms"] > 100 * row["turned"]["rms"]
        assert np.linalg.norm(document["turn_arcmin"]) == pytest.approx(6.8755, abs=1e-3)
        assert {"error_over_sigma", "median", "p95", "max"} < set(row["turned"])
        assert {"median", "rms", "sum", "alone"} == set(row["areas"])
        assert document["light"] == {}

    def test_contains_the_light(self, where: Path) -> None:
        document = json.loads(procam("venue", "compare", where / "a", where / "a", "--json").out)
        assert document["light"]["feedback"]["first"] == [0.3, 0.33, 0.4]
        assert document["light"]["albedo"]["sigma"][0] == pytest.approx(0.01 * np.sqrt(2))

    def test_fails_with_the_document(self, where: Path) -> None:
        ran = procam("venue", "compare", where / "a", where / "exchanged", "--json")
        assert ran.code == 1
        assert json.loads(ran.out)["verdict"]["projectors"] == ["south", "north"]


class TestRefused:
    @pytest.fixture
    def refusal(self, where: Path) -> Callable[[str, str], str]:
        def refusal(first: str, second: str) -> str:
            ran = procam("venue", "compare", where / first, where / second)
            assert ran.code == 2
            return ran.complaint

        return refusal

    def test_no_folder(self, refusal: Callable[[str, str], str]) -> None:
        for names in (("a", "nowhere"), ("nowhere", "a")):
            assert "nowhere has no calibration.json; a calibration" in refusal(*names)

    def test_other_projectors(self, refusal: Callable[[str, str], str]) -> None:
        line = refusal("a", "alone")
        assert "alone has projectors south 48x30, and " in line
        assert line.endswith("a has south 48x30, north 48x30; compare calibrations of the same rig")
