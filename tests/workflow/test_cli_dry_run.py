"""`procam session capture VENUE --dry-run`: what a session costs, and the order in which it is taken."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_venue import TINY_PAIR, make_venue, procam
from venue_texts import load_venue_of

from procam.files.venue.load import Venue, template_text
from procam.interfaces.cli._output import Output
from procam.interfaces.cli.session.capture import photograph_s, run_dry, work
from procam.maths.geometry.lenses import Lens
from procam.model.optics import CameraModel, Sensor
from procam.model.plan import Shot
from procam.workflows.solve.memory import solve_bytes

BY_HAND = template_text("by-hand")
SIX = ("north", "south", "east", "west", "up", "down")


def _by_hand(folder: Path, projectors: tuple[str, ...] = ("north",), more: str = "") -> Venue:
    """One camera that somebody releases, and panels small enough to draw patterns for quickly."""
    camera = BY_HAND[BY_HAND.index("[cameras.zenith]") : BY_HAND.index("[cameras.side]")]
    panels = "".join(f"[projectors.{name}]\nsize = [160, 100]\n" for name in projectors)
    capture = f"[capture]\nexposure_s = 0.5\nblack_exposure_s = 8.0\n{more}"
    return load_venue_of(
        folder, f'[screen]\nkind = "dome"\nradius_m = 6\n{camera}{panels}{capture}'
    )


def _document(venue: Venue, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    run_dry(venue, Output(as_json=True))
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


class TestWork:
    def test_time_per_photograph(self, tmp_path: Path) -> None:
        venue = _by_hand(tmp_path)
        assert photograph_s(venue, "simulated", 0.5) == 1.5
        assert photograph_s(venue, "by-hand", 0.5) == 5.0
        assert photograph_s(venue, "by-hand", 8.0) == 9.0  # an exposure is never cut short

    def test_venue_toml_may_tell_it(self, tmp_path: Path) -> None:
        venue = _by_hand(tmp_path, more="shot_s = 3.5\n")
        assert photograph_s(venue, "by-hand", 0.5) == 3.5
        assert photograph_s(venue, "simulated", 8.0) == 8.0

    def test_files_are_sixteen_bits_of_one_or_three_planes(self, tmp_path: Path) -> None:
        shots = [
            Shot("a", "north", "a.png", "code", (0.5,), "mono"),
            Shot("b", "north", "b.png", "black", (0.5, 8.0)),
        ]
        found = work(_by_hand(tmp_path), shots)
        assert (found.shots, found.exposures) == (2, 3)
        assert found.gigabytes == pytest.approx(2 * 4000 * 4000 * (1 + 3 + 3) / 1e9)
        assert found.minutes == pytest.approx((5 + 5 + 9) / 60)

    def test_every_camera_takes_its_time(self, tmp_path: Path) -> None:
        pair = load_venue_of(tmp_path / "pair", BY_HAND)
        assert len(pair.table.cameras) == 2
        shots = [Shot("a", "north", "a.png", "white", (0.5,))]
        assert work(pair, shots).minutes == pytest.approx(
            2 * work(_by_hand(tmp_path), shots).minutes
        )


class TestDryRun:
    def test_lists_all_and_touches_nothing(self, tmp_path: Path) -> None:
        make_venue(tmp_path, size=TINY_PAIR)
        said = procam("session", "capture", tmp_path, "--dry-run")
        message = procam("session", "capture", tmp_path, "--dry-run", "--json")
        document = json.loads(message.out)
        assert (said.code, message.code, said.err, message.err) == (0, 0, "", "")
        total = "{shots} shots, {exposures} exposures, {minutes} min, {gigabytes} GB"
        assert said.out.splitlines()[-1] == total.format(**document)
        assert [line.split()[0] for line in said.out.splitlines()[1:4]] == [
            "dark",
            "south",
            "north",
        ]
        assert document["exposures"] == document["shots"] + 4  # dark, two blacks and dim have two
        assert [p.name for p in tmp_path.iterdir()] == ["venue.toml"]

    def test_parts_sum_to_the_whole(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        document = _document(_by_hand(tmp_path, SIX[:3]), capsys)
        assert document["exposures"] == document["shots"] + 2  # dark and dim; by hand black has one
        parts = [document["dark"], *document["projectors"].values()]
        assert list(document["projectors"]) == list(SIX[:3])
        for key in ("shots", "exposures"):
            assert sum(part[key] for part in parts) == document[key]
        for key in ("minutes", "gigabytes"):
            assert sum(p[key] for p in parts) == pytest.approx(document[key], abs=0.05 * len(parts))
        assert sum(stage["shots"] for stage in document["order"]) == document["shots"]

    def test_six_projectors_at_five_seconds_take_three_quarters_of_an_hour_at_most(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        document = _document(_by_hand(tmp_path, SIX), capsys)
        assert len(document["projectors"]) == 6
        long = 8 * 4 / 60  # the dark, six blacks and the dim white are exposed for 8 s
        assert document["minutes"] == pytest.approx(document["exposures"] * 5 / 60 + long, abs=0.05)
        assert document["minutes"] <= 45

    def test_white_black_and_code_come_first_of_each_projector(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        venue = _by_hand(tmp_path, SIX[:2])
        document = _document(venue, capsys)
        order = document["order"]
        assert (order[0]["projector"], order[0]["purpose"]) == ("", "dark")
        for name in SIX[:2]:
            purposes = [stage["purpose"] for stage in order if stage["projector"] == name]
            assert purposes[:3] == ["white", "black", "code"]
        until = document["geometry"]["shots"]
        seen = 0
        for stage in order:
            seen += stage["shots"]
            if stage["purpose"] in ("white", "black", "code"):
                last = seen
        assert until == last
        run_dry(venue, Output(as_json=False))
        said = capsys.readouterr().out
        assert f"directions can be solved after {until} shots" in said
        assert "  north, then south: 1 white, 1 black, " in said


class TestMemory:
    def test_it_grows_with_the_camera_and_has_a_bound(self) -> None:
        small, large, largest = (
            solve_bytes([camera(size)]) / 1e9 for size in ((1600, 1600), (6000, 4000), (9000, 6000))
        )
        assert 2.0 < small < large < 3.2 and large < largest < 6.0

    def test_it_is_said(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        venue = _by_hand(tmp_path)
        document = _document(venue, capsys)
        assert document["solve_memory_gb"] == round(solve_bytes(venue.cameras.values()) / 1e9, 1)
        run_dry(venue, Output(as_json=False))
        assert f"to solve it takes {document['solve_memory_gb']} GB" in capsys.readouterr().out


def camera(size: tuple[int, int]) -> CameraModel:
    """A fisheye."""
    middle = (np.array(size) - 1) / 2
    lens = Lens("kannala-brandt", np.full(2, min(size) / 3.3), middle, np.zeros(4))
    return CameraModel("zenith", size, lens, Sensor(12, 64.0))
