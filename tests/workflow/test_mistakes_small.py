"""The study of mistakes, small: each is noticed at a strength, and by the words that name it."""

from dataclasses import replace
from pathlib import Path

import pytest

import studies.mistakes
from procam.estimate.light import floor_albedo
from simulators.mistakes import LATER_STRENGTHS, STRENGTHS
from simulators.scene import SceneSize
from studies.mistakes import Stage, clean_row, later_rows, later_table, outcome, row_of, table

SMALL = SceneSize(
    projectors=1, projector_size=(320, 200), camera_size=(400, 400), rays=128, map_size=128
)
FLOOR_DROPS = (0.2,)  # depths at which the floor may lie: no mistake is about it
NOTICED = {
    "a person in all photographs": (1.0, "darker than around it"),
    "edge blend left on": (0.1, "an edge blend in its menu"),
    "sharpening in the projectors": (1.0, "the light that its response predicts"),
    "sharpening in the camera": (1.0, "brighter beside their edges"),
    "photographs lag by one": (1.0, "do not come one late"),
    "the camera was nudged": (0.6, "the camera or the projector moved"),
    "vignetting left out": (0.1, "venue.toml has no vignetting of its lens"),
    "glare left out": (0.01, "no lens is without a veil"),
    "banding in step": (0.03, "of its photographs are brighter and darker in turn"),
    "photographs cropped": (0.05, "as if they were cropped or scaled"),
    "a projector mirrored midway": (0.6, "on, and was not before"),
}
MOVED = "the camera was nudged"  # corrected by a wider standard error
HARMLESS = {"long exposures shorter, reported": 0.4}
SHOWN_BY = {  # tests that show the rest for less, and studies/mistakes.md in ten rooms
    "long exposures shorter, unreported": "test_light_refusals.py",
    "one photograph exposed wrongly": "test_light_refusals.py",
    "dynamic black left on": "test_light_refusals.py",
    "a person in one photograph": "test_stability.py",
    "dust on the camera's lens": "test_spots.py",
}


def test_mistakes_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(studies.mistakes, "SIZE", SMALL)
    monkeypatch.setattr(studies.mistakes, "TRUTH_SIZE", 128)
    monkeypatch.setattr(floor_albedo, "DROPS", FLOOR_DROPS)
    stage = Stage(1, tmp_path)
    clean = clean_row(stage)
    assert clean["notes"] == []
    rows = []
    for name, (strength, words) in NOTICED.items():
        row = row_of(stage, (name, strength), clean)
        rows.append(row)
        said = "\n".join([row.get("refused", ""), *row.get("notes", ())])
        assert words in said, (name, said)
        assert outcome(row) in {"refused", "right, noted", "wrong, noted"}
        if name == MOVED:
            assert "relative directions" not in row["wrong"], row
    for name, strength in HARMLESS.items():
        row = row_of(stage, (name, strength), clean)
        rows.append(row)
        assert "refused" not in row and not row["notes"], row
        assert set(row["wrong"]) <= {"coverage"}, row  # of so small a picture it is coarse
    assert {row["mistake"][0] for row in rows} | SHOWN_BY.keys() == STRENGTHS.keys()
    assert len(list(table(rows))) == 2 + 3 * len(STRENGTHS)


LATER = {
    "one input takes full range for limited": {"signal range"},
    "one input takes limited range for full": {"black level", "light"},
    "too much contrast in one projector": {"signal range", "gamma setting"},
    "dynamic black switched on in one": {"dynamic setting"},
    "another gamma of blue in one": {"gamma setting"},
}


def test_mistakes_after_a_calibration_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studies.mistakes, "SIZE", replace(SMALL, projectors=2))
    monkeypatch.setattr(studies.mistakes, "TRUTH_SIZE", 128)
    monkeypatch.setattr(floor_albedo, "DROPS", FLOOR_DROPS)
    monkeypatch.setattr(
        studies.mistakes, "LATER_STRENGTHS", {n: s[-1:] for n, s in LATER_STRENGTHS.items()}
    )
    stage = Stage(1, tmp_path)
    stage.calibrate(None)
    rows = list(later_rows(stage))
    assert [row["causes"] for row in rows if not row["later"]] == [[]]
    for row in rows[1:]:
        name = row["later"][0]
        assert row["causes"] and set(row["causes"]) <= LATER[name], row
    _, banded = stage.verify(("banding in step", 0.03))
    assert banded == ["zenith banding"]
    assert LATER.keys() == LATER_STRENGTHS.keys()
    assert len(list(later_table(rows))) == 4 + len(LATER)
