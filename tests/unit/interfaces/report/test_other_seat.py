"""The report's check from another seat: what it compares, its words, and its figures against limits."""

import os
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from two_seats import HERE, THERE, keep, seen_from
from venue_texts import PLAIN

from procam.files.versions import list_calibrations, use_calibration
from procam.interfaces.report import acceptance, write_report
from procam.interfaces.report.blocks import Block, Table, Text
from procam.interfaces.report.data import read_material
from procam.interfaces.report.other_seat import other_seat
from procam.maths.geometry.pose import rotation_matrix
from procam.maths.geometry.sphere import normalise
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.model.transport import Measured
from procam.workflows.other_seat import SeatCheck

ARCMIN = np.radians(1 / 60)
DAY_S = 86400
THIN = "\N{NARROW NO-BREAK SPACE}"
RELATIVE = {"direction_sigma_relative_arcmin": Figure(0.3, "arcmin")}
SERVED = {"server_misalignment_rms_arcmin": Figure(1.3, "arcmin")}


@pytest.fixture
def venue(tmp_path: Path, calibration: Calibration) -> Path:
    """A venue with one calibration."""
    folder = tmp_path / "Sky"
    folder.mkdir()
    (folder / "venue.toml").write_text(PLAIN, "utf-8")
    keep(folder, seen_from(replace(calibration, quality=RELATIVE), HERE), "0001")
    return folder


def _from_elsewhere(venue: Path, calibration: Calibration, **changes: object) -> None:
    """A calibration from another seat; the first one stays in use."""
    changed = replace(calibration, **{"quality": RELATIVE} | changes)  # type: ignore[arg-type]
    keep(venue, seen_from(changed, THERE, turn_deg=30), "0002")
    use_calibration(venue, list_calibrations(venue)[0])


def _moved(calibration: Calibration, **arcmin: float) -> Calibration:
    """The calibration with projectors' directions turned, and noise on the others."""
    rng = np.random.default_rng(3)
    projectors = {}
    for name, projector in calibration.projectors.items():
        turn = rotation_matrix([0, 0, arcmin.get(name, 0.0) * ARCMIN])
        noise = rng.normal(0, 0.1 * ARCMIN, projector.surface.direction.shape)
        direction = normalise(projector.surface.direction @ turn.T + noise).astype(np.float32)
        surface = replace(projector.surface, direction=direction)
        projectors[name] = replace(projector, surface=surface)
    return replace(calibration, projectors=projectors)


def _check(venue: Path) -> SeatCheck:
    check = read_material(venue).other_seat
    assert check is not None
    return check


def _page(venue: Path) -> str:
    return unescape(write_report(venue).read_text("utf-8"))


def _section(page: str) -> str:
    found = re.search(r'<section id="other-seat">.*?</section>', page, re.DOTALL)
    assert found
    return found[0]


def _blocks(venue: Path) -> list[Block]:
    return list(other_seat(read_material(venue)))


def _verdict(venue: Path) -> Text:
    """The sentence with the outcome."""
    (found,) = (b for b in _blocks(venue) if isinstance(b, Text) and b.good is not None)
    return found


def _fact(page: str) -> str:
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page))["Checked from another seat"]


class TestWords:
    def test_without_one_it_says_how(self, venue: Path) -> None:
        page = _page(venue)
        section = _section(page)
        assert "Calibration 0001 has not been checked from another seat" in section
        assert "more than 0.3 m away" in section  # a twentieth of 6 m
        for command in ("calibrate", "report"):
            assert f"<code>procam {command} {venue}</code>" in section
        assert f"<code>procam venue use {venue}@1</code>" in section
        assert _fact(page) == "not yet"

    def test_seats_and_dates(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration))
        first, second = (path / "calibration.json" for path in list_calibrations(venue))
        stamp = second.stat().st_mtime - 34 * DAY_S
        os.utime(first, (stamp, stamp))
        section = _blocks(venue)[0].text  # type: ignore[union-attr]
        assert re.search(
            r"Calibration 0001 of .* is compared with 0002 of .*\. 34 days lie", section
        )
        use_calibration(venue, list_calibrations(venue)[1])
        assert ". 34 days lie between them." in _blocks(venue)[0].text  # type: ignore[union-attr]
        assert f"the same camera, zenith, which stood 2 m away (33{THIN}%" in section
        assert "turned by 30 degrees. No photograph was used for both." in section

    def test_one_that_agrees(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration))
        page = _page(venue)
        assert '<p class="verdict small good">The two agree within their error bars.' in page
        assert _fact(page) == "by calibration 0002: it agrees"
        assert "<code>other_seat_feedback</code>" in page
        row = re.search(r"<tr><td>Feedback m, green</td>(.*?)</tr>", _section(page))
        cells = re.findall(r"<td>(.*?)</td>", row[1]) if row else []
        half = 100 * 1.96 * 0.003 * np.sqrt(2) / 0.33
        interval = f"\N{MINUS SIGN}{half:.1f}{THIN}% to {half:.1f}{THIN}%"
        assert cells == ["0.33", "0.33", f"0{THIN}%", interval, "0"]
        assert "<td>Projector north</td>" in page and "<td>All</td>" in page

    def test_a_turn_of_the_whole_rig_agrees(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration, south=9.0, north=9.0))
        verdict = _verdict(venue)
        assert verdict.good
        assert ", up to a rotation of the whole rig by 9" in verdict.text

    def test_a_projector_that_moved_is_named(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration, north=9.0))
        page = _page(venue)
        assert '<p class="verdict small bad">The two differ: projector north ' in page
        assert "moved: north by " in page and "if something did, check again." in page
        assert _fact(page) == "by calibration 0002: it does not agree"

    def test_light_that_differs(self, venue: Path, calibration: Calibration) -> None:
        m = calibration.feedback
        _from_elsewhere(venue, _moved(calibration), feedback=Measured(1.1 * m.value, m.sigma))
        verdict = _verdict(venue)
        assert not verdict.good
        assert verdict.text.startswith("The two differ: the light differs, feedback by ")

    def test_a_lens_that_the_survey_hides(self, venue: Path, calibration: Calibration) -> None:
        """Whole error bars cover the difference, those of relative directions do not."""
        quality = {"direction_sigma_relative_arcmin": Figure(0.01, "arcmin")}
        keep(venue, seen_from(replace(calibration, quality=quality), HERE), "0001")
        keep(venue, seen_from(replace(_moved(calibration), quality=quality), THERE), "0002")
        use_calibration(venue, list_calibrations(venue)[1])
        check = _check(venue)
        assert check.comparison and check.comparison.verdict.kind == "agree" and not check.agrees
        assert "times their standard error; a camera's lens may be wrong." in _verdict(venue).text

    @pytest.mark.parametrize("sigma", [np.nan, np.inf, 0.0])
    def test_a_sigma_that_is_no_number_is_none(
        self, venue: Path, calibration: Calibration, sigma: float
    ) -> None:
        quality = {"direction_sigma_relative_arcmin": Figure(sigma, "arcmin")}
        _from_elsewhere(venue, _moved(calibration), quality=quality)
        check = _check(venue)
        assert check.sigma_arcmin is None and "_over_sigma" not in " ".join(check.figures())


class TestOutcomes:
    def test_the_check_is_mutual(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration))
        use_calibration(venue, list_calibrations(venue)[1])
        assert _check(venue).seat.directory.name == "0001"

    def test_the_newest_counts_although_it_differs(
        self, venue: Path, calibration: Calibration
    ) -> None:
        _from_elsewhere(venue, _moved(calibration))
        keep(venue, seen_from(_moved(calibration, north=9.0), THERE), "0003")
        assert not _check(venue).agrees

    def test_a_damaged_one_is_passed_over(self, venue: Path, calibration: Calibration) -> None:
        _from_elsewhere(venue, _moved(calibration))
        damaged = keep(venue, seen_from(calibration, THERE), "0003")
        (damaged / "maps" / "north.exr").unlink()
        assert _check(venue).seat.directory.name == "0002"
        assert "Damaged, and left out: 0003." in _blocks(venue)[0].text  # type: ignore[union-attr]

    def test_one_that_cannot_be_compared_says_so(
        self, venue: Path, calibration: Calibration
    ) -> None:
        north = calibration.projectors["north"]
        unseen = replace(north.surface, valid=np.zeros_like(north.surface.valid))
        projectors = {**calibration.projectors, "north": replace(north, surface=unseen)}
        _from_elsewhere(venue, replace(calibration, projectors=projectors))
        text = _verdict(venue).text
        assert text.startswith(
            "The two cannot be compared: projector north: the calibrations share 0"
        )
        assert not _check(venue).agrees and _check(venue).figures() == {}
        assert _fact(_page(venue)) == "by calibration 0002: it cannot be compared"

    def test_behind_a_server_only_the_light_is_checked(
        self, venue: Path, calibration: Calibration
    ) -> None:
        keep(venue, seen_from(replace(calibration, quality=SERVED), HERE), "0001")
        keep(venue, seen_from(replace(calibration, quality=SERVED), THERE), "0002")
        use_calibration(venue, list_calibrations(venue)[1])
        assert "agree within their error bars. Directions behind a media" in _verdict(venue).text
        (table,) = (block for block in _blocks(venue) if isinstance(block, Table))
        assert table.head[0] == "Light"
        assert set(_check(venue).figures()) == {"other_seat_feedback", "other_seat_albedo"}


class TestFigures:
    def test_they_are_those_of_the_comparison(self, venue: Path, calibration: Calibration) -> None:
        m = calibration.feedback
        changed = replace(calibration, feedback=Measured(1.01 * m.value, m.sigma))
        _from_elsewhere(venue, _moved(changed, north=9.0))
        check = _check(venue)
        found = check.comparison
        assert found is not None
        figures = check.figures()
        relative = figures["other_seat_direction_relative_rms_arcmin"]
        assert relative.value == found.together.turned.rms
        assert figures["other_seat_direction_rms_arcmin"].value == found.together.as_is.rms
        over = figures["other_seat_direction_relative_over_sigma"].value
        assert over == pytest.approx(found.together.turned.rms / (0.3 * np.sqrt(2)))
        assert figures["other_seat_feedback"].value == pytest.approx([0.01] * 3)
        sigma = np.sqrt(2) * m.sigma / m.value
        assert figures["other_seat_feedback"].sigma == pytest.approx(sigma)
        assert figures["other_seat_solid_angle_sum"].value == pytest.approx(0, abs=1e-6)

    def test_limits_are_judged_by_them(self, venue: Path, calibration: Calibration) -> None:
        limits = {
            "other_seat_direction_relative_rms_arcmin": 1.0,
            "other_seat_feedback": 0.06,
            "other_seat_albedo": 0.01,
        }
        lines = [f"{name} = {limit}" for name, limit in limits.items()]
        (venue / "venue.toml").write_text("\n".join([PLAIN, "[acceptance]", *lines]))
        before = [acceptance.row(each) for each in acceptance.found(read_material(venue))]
        assert [row["verdict"] for row in before] == ["not shown"] * 3
        assert before[0]["values"] == ["not measured"]
        m = calibration.feedback
        _from_elsewhere(venue, _moved(calibration), feedback=Measured(0.97 * m.value, m.sigma))
        rows = [acceptance.row(each) for each in acceptance.found(read_material(venue))]
        assert [row["verdict"] for row in rows] == ["pass", "pass", "not shown"]  # albedo +-6 %
        assert rows[1]["values"][0].startswith(
            f"red \N{MINUS SIGN}3{THIN}% (\N{MINUS SIGN}4.8{THIN}% to "
        )
        assert rows[1]["limit"] == f"within \N{PLUS-MINUS SIGN}6{THIN}%"
