"""The report's cover, acceptance table, drift and signatures; the operators' sheet."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from edited_files import edited_json
from venue_texts import PLAIN

from procam.errors import FileFormatError, InputError
from procam.files.calibration import save_calibration
from procam.files.venue.load import template_text
from procam.files.versions import list_calibrations, use_calibration
from procam.interfaces.report import acceptance, write_report
from procam.interfaces.report.sheet import write_sheet
from procam.model.acceptance import Finding
from procam.model.calibration import Calibration
from procam.model.provenance import Provenance
from procam.model.quality import Figure
from procam.model.transport import Measured

THIN = "\N{NARROW NO-BREAK SPACE}"
LIMITS = """
[acceptance]
coverage = 0.9
albedo = 0.6
direction_sigma_relative_arcmin = 0.5
loop_own_jnd = 3
"""
QUALITY = {
    "coverage": Figure(0.931, "-"),
    "direction_sigma_relative_arcmin": Figure(0.6, "arcmin", sigma=0.01),
}


def _venue(folder: Path, calibration: Calibration, text: str) -> Path:
    folder.mkdir()
    (folder / "venue.toml").write_text(text, "utf-8")
    provenance = Provenance("0001", versions={"procam": "9.8", "numpy": "7.6"})
    save_calibration(
        replace(calibration, quality=QUALITY, provenance=provenance), folder / "calibrations/0001"
    )
    return folder


@pytest.fixture
def venue(tmp_path: Path, calibration: Calibration) -> Path:
    return _venue(tmp_path / "Sky", calibration, PLAIN + LIMITS)


def _again(venue: Path, calibration: Calibration, session: str, feedback: float) -> None:
    """A further calibration, of a session."""
    number = len(list_calibrations(venue)) + 1
    changed = replace(
        calibration,
        feedback=Measured(np.array([0.3, feedback, 0.4]), np.array([0.002, 0.003, 0.004])),
        quality=QUALITY,
        provenance=Provenance(session),
    )
    save_calibration(changed, venue / "calibrations" / f"{number:04d}")


def _page(venue: Path) -> str:
    return unescape(write_report(venue).read_text("utf-8"))


def _section(page: str, key: str) -> str:
    found = re.search(rf'<section id="{key}".*?</section>', page, re.DOTALL)
    assert found, key
    return found[0]


class TestCover:
    def test_it_names_venue_devices_versions_and_method(self, venue: Path) -> None:
        page = _page(venue).split("</header>")[0]
        facts = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page))
        assert facts["Venue"] == "Sky" and facts["Calibration"].startswith("0001 of ")
        assert facts["Camera zenith"] == "1600 x 1600 px, backend simulated"
        assert facts["Projector south"] == "1280 x 800 px, backend simulated"
        assert facts["Calibrated with"] == "procam 9.8, numpy 7.6"
        assert facts["Report written with"].startswith("procam ")
        method = re.findall(r'class="method">(.*?)</p>', page, re.DOTALL)[0]
        assert method.count(". ") == 2 and "coded patterns of each projector" in method

    def test_a_media_server_is_named_as_one(self, tmp_path: Path, calibration: Calibration) -> None:
        text = template_text("through-server")
        page = _page(_venue(tmp_path / "Served", calibration, text)).split("</header>")[0]
        assert "media server, " in page and "taken as aligned" in page

    def test_broken_limits_are_refused(self, venue: Path) -> None:
        (venue / "venue.toml").write_text(f"{PLAIN}\n[acceptance]\nsharpness = 1\n")
        with pytest.raises(InputError, match=r"acceptance\.sharpness is not a known key"):
            write_report(venue)


class TestTable:
    def test_each_limit_has_a_row(self, venue: Path) -> None:
        page = _page(venue)
        rows = re.findall(r"<tr.*?</tr>", _section(page, "acceptance"), re.DOTALL)[1:]
        texts = [re.sub(r"<[^>]*>", " ", row) for row in rows]
        assert "0.6\N{NO-BREAK SPACE}arcmin (0.5804\N{NO-BREAK SPACE}arcmin to " in texts[0]
        assert "at most 0.5\N{NO-BREAK SPACE}arcmin" in texts[0] and "✗ fail" in texts[0]
        assert f"93.1{THIN}%" in texts[1] and f"at least 90{THIN}%" in texts[1]
        assert "✓ pass" in texts[1] and "(" not in texts[1]
        assert "red 0.46 (0.4404 to 0.4796)" in texts[2] and "✓ pass" not in texts[2]
        assert "blue 0.57 (0.5308 to 0.6092)" in texts[2] and "? not shown" in texts[2]
        assert "not measured" in texts[3] and "? not shown" in texts[3]
        outcome = "Of 4 limits of the client: 1 kept, 1 missed, 2 not shown."
        assert f'<p class="verdict bad">{outcome}</p>' in page
        assert "procam's own goals:" in page

    def test_without_limits_there_is_no_table(self, venue: Path) -> None:
        (venue / "venue.toml").write_text(PLAIN)
        page = _page(venue)
        assert 'id="acceptance"' not in page and "of the client" not in page

    def test_all_that_are_kept_are_counted(self, venue: Path) -> None:
        (venue / "venue.toml").write_text(f"{PLAIN}\n[acceptance]\ncoverage = 0.9\n")
        assert '<p class="verdict good">The client\'s one limit is kept.</p>' in _page(venue)
        kept = [Finding("coverage", 0.9, np.array([0.95]), None)] * 2
        assert acceptance.verdict(kept) == acceptance.Outcome(
            "All 2 limits of the client are kept.", True
        )
        assert acceptance.verdict([]) is None

    def test_an_interval_that_is_not_known_says_so(self) -> None:
        sigma = np.array([0.01, np.nan, 0.01])
        finding = Finding("albedo", 0.6, np.array([0.4, 0.5, 0.4]), sigma)
        assert list(acceptance.value_texts(finding))[1] == "green 0.5 (interval not known)"


class TestDrift:
    def test_a_first_capture_has_none(self, venue: Path, calibration: Calibration) -> None:
        _again(venue, calibration, "0001", 0.5)  # solved again: the same measurements
        text = "There is no calibration of an earlier capture"
        assert text in _section(_page(venue), "drift")

    def test_a_later_capture_is_compared(self, venue: Path, calibration: Calibration) -> None:
        _again(venue, calibration, "0001", 0.331)
        _again(venue, calibration, "0002", 0.36)
        drift = _section(_page(venue), "drift")
        assert "Calibration 0003 is compared with 0002" in drift
        assert "differ by more than noise explains: Feedback m, green." in drift
        row = re.search(r"<tr><td>Feedback m, green</td>(.*?)</tr>", drift)
        # 0.029 over sqrt(2) 0.003
        cells = re.findall(r"<td>(.*?)</td>", row[1]) if row else []
        assert cells == ["0.331", "0.36", "0.029", "6.8 *"]
        assert "<td>Share of the screen that is lit</td>" in drift
        assert "root mean square [arcmin]</td>" in drift

    def test_noise_is_called_noise(self, venue: Path, calibration: Calibration) -> None:
        _again(venue, calibration, "0002", 0.332)
        assert "No figure differs by more than the noise" in _section(_page(venue), "drift")

    def test_it_is_that_of_the_calibration_in_use(
        self, venue: Path, calibration: Calibration
    ) -> None:
        _again(venue, calibration, "0002", 0.36)
        use_calibration(venue, list_calibrations(venue)[0])
        assert "no calibration of an earlier capture" in _section(_page(venue), "drift")


class TestSheet:
    def test_it_has_the_commands_of_the_venue(self, venue: Path, calibration: Calibration) -> None:
        _again(venue, calibration, "0002", 0.36)
        path = write_sheet(venue)
        page, folder = unescape(path.read_text("utf-8")), venue.resolve()
        assert path == venue / "operator-sheet.html"
        assert "Calibration in use: <strong>0002</strong>" in page
        for command in (
            f"procam compensate {folder} show.mov frames --to projectors",
            f"procam export {folder} shader show.mov show-track",
            f"procam verify {folder}",
            f"procam venue use {folder}@1",
            f"procam projector {folder} south state",
        ):
            assert f"<code>{command}</code>" in page, command
        assert page.count("<tr>") == 5 and "Call:" in page
        assert not re.findall(r"https?:|src=|href=|url\(", page)

    def test_a_first_calibration_has_nothing_to_go_back_to(self, venue: Path) -> None:
        page = write_sheet(venue).read_text("utf-8")
        assert "There is no earlier one yet" in page and "procam venue use" in page

    def test_a_media_server_plays_dome_masters(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        folder = _venue(tmp_path / "My Dome", calibration, template_text("through-server"))
        page = unescape(write_sheet(folder).read_text("utf-8"))
        assert "make the server's movie" in page and "procam projector" not in page
        assert "on the media server (server), as any dome master" in page
        assert f"procam export '{folder.resolve()}' shader show.mov show-track" in page

    def test_a_venue_without_a_calibration_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_text(PLAIN)
        with pytest.raises(FileFormatError, match="has no calibration"):
            write_sheet(tmp_path)
        assert not (tmp_path / "operator-sheet.html").exists()


def test_lists_of_the_provenance_are_text(venue: Path) -> None:
    with edited_json(venue / "calibrations/0001/calibration.json") as document:
        document["provenance"] |= {"backends": ["camera-a", "player"], "notes": []}
    origin = _section(_page(venue), "provenance")
    assert "<dd>camera-a, player</dd>" in origin and "<dt>Notes</dt>" not in origin
