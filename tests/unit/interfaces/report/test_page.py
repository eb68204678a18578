import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from edited_files import edited_json

from procam.compensate.compensator import Compensator
from procam.errors import FileFormatError, InputError
from procam.files.calibration import save_calibration
from procam.files.images.layers import RGB, write_channels
from procam.files.venue.load import template_text
from procam.files.versions import calibration_in_use, list_calibrations, use_calibration
from procam.interfaces.plots import figure
from procam.interfaces.report import light, page, write_report
from procam.interfaces.report.data import Material, read_material
from procam.maths.warp import block_mean
from procam.model.mask import Mask
from procam.model.provenance import Provenance
from procam.model.quality import Figure, Goal
from procam.workflows.sample_content import half_sky

SIZE = 96
HOSTILE = '<img src=x onerror="alert(1)">'
SECTIONS = 11
FIXED = 5  # summary, figures, limits, provenance, signatures
MINUS, THIN = "\N{MINUS SIGN}", "\N{NARROW NO-BREAK SPACE}"
FIGURES = {
    "direction_error_relative_rms_arcmin": Figure(0.114, "arcmin", Goal("<=", 0.5), 1000),
    "scatter_left_refined": Figure(0.004, "-", Goal("<=", 0.02), 900, "worst channel"),
    "feedback_error": Figure(-0.0061, "-", Goal("abs<=", 0.02), 3, "signed"),
    "loop_residual_by_iteration": Figure([0.01, 0.002], "rel"),
    "albedo_interval_covers": Figure(True, "-", Goal("==", True), 3),
    "a_figure_of_tomorrow": Figure(float("nan"), "furlong"),
}


def _rgb(path, picture):
    write_channels(path, {c: picture[..., i] for i, c in enumerate(RGB)})


def _pictures(venue, calibration):
    content = half_sky(SIZE)
    plain = Compensator(calibration, SIZE, "none").predict(content)
    exact = Compensator(calibration, SIZE).predict(content)
    _rgb(venue / "pictures" / "target.exr", content)
    _rgb(venue / "pictures" / "uncompensated.exr", plain.observed)
    _rgb(venue / "pictures" / "compensated.exr", exact.observed)
    _rgb(venue / "pictures" / "direct.exr", exact.direct)
    _rgb(venue / "pictures" / "free.exr", exact.free)
    return plain, exact


def _loop(venue, plain, exact):
    for name, picture in (
        ("before", plain.observed),
        ("after", exact.observed + np.float32(1e-3)),
        ("predicted", exact.observed),
        ("free", exact.free.astype(np.float32)),
    ):
        _rgb(venue / "loop" / f"{name}.exr", block_mean(picture, 2))
    curve = {"residual": [0.01, 0.002], "noise_floor": 0.0015}
    (venue / "loop" / "loop.json").write_text(json.dumps(curve))


def _summary(venue, figures):
    entries = {n: f.as_dict() | {"seed": 1, "command": "procam x"} for n, f in figures.items()}
    (venue / "summary.json").write_text(json.dumps({"preset": "p", "figures": entries}))


def _truth(venue, calibration, plain, exact):
    save_calibration(calibration, venue / "truth")
    to_camera = np.linalg.inv(calibration.content_from_camera).T
    for name, picture in (("none", plain.observed), ("exact", exact.observed)):
        _rgb(venue / "truth" / "pictures" / f"{name}.exr", picture @ to_camera)


@pytest.fixture(scope="module", autouse=True)
def coarse_charts():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, "DPI", 40)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory, calibration):
    """A whole venue: two calibrations of one session, pictures, loop, truth and summary."""
    folder = tmp_path_factory.mktemp("whole") / "Planetarium"
    save_calibration(calibration, folder / "calibrations" / "0001")
    save_calibration(calibration, folder / "calibrations" / "0002")
    plain, exact = _pictures(folder, calibration)
    _loop(folder, plain, exact)
    _truth(folder, calibration, plain, exact)
    _summary(folder, FIGURES)
    return folder


@pytest.fixture(scope="module")
def whole_page(whole, tmp_path_factory):
    """The page of the whole venue."""
    return write_report(whole, tmp_path_factory.mktemp("page") / "page.html").read_text("utf-8")


@pytest.fixture
def venue(whole, tmp_path):
    """A copy of the whole venue, to be changed."""
    return Path(shutil.copytree(whole, tmp_path / whole.name))


def _requests(page):
    """Everything a browser would fetch: src, href and url() that are not inlined or anchors."""
    found = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]+)""", page)
    found += re.findall(r"url\(\s*['\"]?([^)'\"]+)", page)
    return [a for a in found if not a.startswith(("data:image/png;base64,", "#"))]


def test_it_is_one_file_that_loads_nothing(whole_page):
    assert _requests(whole_page) == []
    assert "<script" not in whole_page and "http" not in re.sub(r"base64,[^\"']+", "", whole_page)
    assert whole_page.startswith("<!doctype html>")


def test_it_has_every_part_and_misses_none(whole_page):
    assert whole_page.count("<section") == SECTIONS + FIXED
    assert "not there yet" not in whole_page and "Done by hand" not in whole_page
    for words in ("true error", "<strong>simulated dome", "Correction of north"):
        assert words in whole_page


def test_every_figure_appears_with_name_value_goal_and_verdict(whole_page, calibration):
    page = whole_page
    for name in (*FIGURES, *calibration.quality):
        assert f"<code>{name}</code>" in page
    assert "at most 0.5\N{NO-BREAK SPACE}arcmin" in page and "meets it" in page
    assert "A figure of tomorrow" in page and "not a number\N{NO-BREAK SPACE}furlong" in page
    assert "<code>procam x</code> with seed 1" in page


def test_a_page_without_failures_says_so(whole_page):
    assert "All 5 figures that have a goal meet it." in whole_page
    assert "Goals missed" not in whole_page and "misses it" not in whole_page


def test_a_missed_goal_is_on_top_in_words(venue):
    _summary(venue, FIGURES | {"shots": Figure(140, "-", Goal("<=", 120.0), 1, "too many")})
    page = write_report(venue).read_text("utf-8")
    assert "1 of 6 figures misses its goal" in page
    assert "Photographs taken: 140, should be at most 120 (too many)." in page
    assert page.index("Goals missed") < page.index('<section id="pictures"')
    assert page.count("misses it<") == 1


@pytest.mark.parametrize(
    ("gone", "command"),
    [
        ("loop", "procam refine [^<]*Planetarium"),
        ("pictures", "procam calibrate [^<]*Planetarium"),
        ("summary.json", "procam demo"),
        ("calibrations", "procam calibrate [^<]*Planetarium"),
    ],
)
def test_what_is_missing_is_named_with_its_command(venue, gone, command):
    (venue / "venue.toml").write_text(template_text("by-hand"))
    (venue / gone).rename(venue / "gone")
    page = write_report(venue).read_text("utf-8")
    assert re.search(rf"not there yet\. [^<]*[Rr]un <code>{command}</code>", page)


def test_a_bare_venue_gets_a_page_of_what_to_run(tmp_path):
    (tmp_path / "venue.toml").write_text(template_text("by-hand"))
    page = write_report(tmp_path).read_text("utf-8")
    assert page.count("not there yet") == SECTIONS + 1
    assert "No figure of this venue has a goal yet." in page


def test_a_folder_that_is_no_venue_is_refused(tmp_path):
    with pytest.raises(InputError, match="this is no venue's folder"):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_hostile_names_are_text(venue):
    hostile = venue.rename(venue.with_name(HOSTILE))
    _summary(hostile, {HOSTILE: Figure(1.0, HOSTILE, Goal("<=", 0.0), 1, HOSTILE)})
    page = write_report(hostile).read_text("utf-8")
    assert "<img src=x" not in page
    assert "&lt;img src=x onerror=" in page


def test_what_was_done_by_hand_has_its_section(venue, calibration):
    covered = np.zeros((SIZE, SIZE), bool)
    covered[40:60, 40:60] = True
    manual = {
        "masks": [{"of": "camera West Wing", "file": HOSTILE, "share": 0.0123}],
        "protected": [{"of": "dome", "corners": 5, "share": 0.04}],
        "nudges": [
            {"projector": "B2", "pixel": [640.5, 400.0], "shift_px": [-3.0, 4.0]},
            {"projector": "north", "pixel": [1.0, 2.0], "shift_px": [0.25, 0.0]},
        ],
    }
    maps = replace(calibration.maps, protected=Mask("screen", covered))
    changed = replace(calibration, maps=maps, provenance=Provenance(by_hand=manual))
    save_calibration(changed, venue / "calibrations" / "0003")
    page = write_report(venue).read_text("utf-8")
    assert page.count("<section") == SECTIONS + FIXED + 1
    for cells in (
        ["Camera West Wing", "&lt;img", f"1.23{THIN}% of the picture", "is not used"],
        ["Dome", "polygon of 5 points", f"4{THIN}% of the dome", "is left as it is"],
        ["Projector B2", "640.5", "400", f"{MINUS}3", "4"],
    ):
        assert re.search(".*".join(f"<td>{re.escape(c)}" for c in cells), page), cells
    assert "largest nudge, 5 px, is that of B2 at (640.5, 400)" in page
    assert "Protected parts" in page and "no projector reaches or protected by hand" in page
    assert "<dt>By hand" not in page and "<img src=x" not in page


def test_without_truth_the_photographs_are_shown(venue):
    (venue / "truth").rename(venue / "gone")
    page = write_report(venue).read_text("utf-8")
    assert "as the camera photographed them" in page
    assert "true error" not in page and "<strong>simulated dome" not in page


def test_before_and_after_are_scaled_by_one_factor(venue):
    material = read_material(venue)
    seen, (block,) = material.before_after(), light.pictures(material)
    first = block.groups[0]
    assert [picture.title for picture in first.pictures] == ["Before", "After", "Intended"]
    shown = (seen.before, seen.after)
    painted = [first.scale.paint(p, material.inside(len(p))) for p in shown]
    assert [picture.image for picture in first.pictures[:2]] == painted
    assert "equal exposure" in block.caption


def test_a_simulated_venue_is_marked_on_every_page(venue, whole_page):
    assert '<p class="stamp">Simulated dome</p>' in whole_page
    (venue / "truth").rename(venue / "gone")
    assert 'class="stamp"' not in write_report(venue).read_text("utf-8")
    with edited_json(calibration_in_use(venue) / "calibration.json") as document:
        document["provenance"]["backends"] = ["simulated"]
    assert '<p class="stamp">Simulated dome</p>' in write_report(venue).read_text("utf-8")


def test_the_calibration_in_use_is_named(venue, whole_page):
    first, *_, last = list_calibrations(venue)
    assert f"({last.name} is shown)" in whole_page
    use_calibration(venue, first)
    page = write_report(venue).read_text("utf-8")
    assert f"({first.name} is shown)" in page and f"Calibration {first.name} of" in page


def test_a_loop_that_made_something_worse_is_reported(venue):
    worse = "red light at azimuth 4, elevation 20 degrees was off by 1 JND and is by 3"
    with edited_json(venue / "loop" / "loop.json") as loop:
        loop["worse"] = worse
    page = write_report(venue).read_text("utf-8")
    assert f"The resulting calibration was not kept: {worse}." in page


def test_a_loop_of_another_session_is_not_shown(venue):
    """Its photographs are of an earlier calibration."""
    for session, shown in (("0002", False), (None, True)):
        with edited_json(venue / "loop" / "loop.json") as loop:
            loop |= {"worse": "red light was off", "session": session}
        page = write_report(venue).read_text("utf-8")
        assert ("red light was off" in page) == shown


def test_a_picture_that_the_loop_did_not_learn_from_leads(venue, whole_page):
    words = "in a picture that the loop did not learn from"
    assert words not in whole_page
    with edited_json(venue / "loop" / "loop.json") as loop:
        loop["unseen"] = [0.012, 0.0021]
    page = write_report(venue).read_text("utf-8")
    assert words in page
    assert f"its difference went from 1.2{THIN}% to 0.21{THIN}% of white" in page


def test_without_loop_and_truth_the_prediction_is_shown_as_such(venue):
    (venue / "truth").rename(venue / "gone")
    (venue / "loop").rename(venue / "gone-too")
    page = write_report(venue).read_text("utf-8")
    assert "nothing has been photographed yet" in page and "nothing, by construction" in page


def test_a_damaged_summary_is_named(venue):
    (venue / "summary.json").write_text('{"figures": {')
    with pytest.raises(FileFormatError, match=r"summary\.json: this is not valid JSON"):
        write_report(venue)


@pytest.mark.parametrize("module", ["matplotlib", "jinja2"])
def test_a_missing_extra_names_its_command(venue, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r'pip install "procam\[report\]"'):
        write_report(venue)
    assert not (venue / "report.html").exists()


def test_the_path_may_be_relative(venue, monkeypatch):
    monkeypatch.chdir(venue)
    path = write_report(Path())
    assert path.resolve() == venue / "report.html"
    assert "<h1>Planetarium</h1>" in path.read_text("utf-8")


def test_the_first_card_is_what_compensation_answers_for() -> None:
    """What projectors draw wrongly is named beside it; the picture's error counts all that is lit."""
    more = {
        "interreflection_left": Figure(0.0036, "-", Goal("<=", 0.01), 9).as_dict(),
        "scatter_left_exact": Figure(0.0153, "-", Goal("<=", 0.02), 9).as_dict(),
        "picture_error_jnd_before": Figure(244.9, "JND").as_dict(),
        "picture_error_jnd": Figure(149.5, "JND").as_dict(),
    }
    first, last = page._cards(Material(Path(), [], None, None, more, None, None, {}, {}, None))
    assert first["value"] == f"0.36{THIN}%" and f"1.53{THIN}% as they draw" in first["note"]
    assert last["value"] == "240 \N{RIGHTWARDS ARROW} 150"
