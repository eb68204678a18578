"""Other programs' sets, photographed without procam and decoded; studies/foreign_codes.md has more seeds."""

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import procam, refused

from procam.files.images.layers import read_channels
from studies import foreign_codes as study
from studies.foreign_pictures import BLACK, PANEL, WHITE, Pattern, inverted
from studies.measure import HERE

CASES = study.cases()
RESULTS = HERE / "foreign_codes.json"


def test_the_study_meets_its_goals() -> None:
    rows = json.loads(RESULTS.read_text())["rows"]
    assert len(rows) == len(CASES)
    for row in rows:
        assert row["right"] >= 0.9, row
        assert study.GOALS["least_ratio"] <= row["ratio"][1] <= study.GOALS["most_ratio"], row
        assert row["gross"] < 2e-3, row


@pytest.mark.parametrize(("number", "seed"), [(2, 1), (5, 1), (9, 1), (12, 28), (13, 29)])
def test_a_seed_of_the_study(number: int, seed: int) -> None:
    """Three steps of one period, several frequencies, wide cells, a jump of exposure, missing steps.

    After that jump the fine stripes have less contrast in units of white's noise than before, and with those
    steps missing too few are left to show a wrong gamma.
    """
    row = study.figures(CASES[number], seed)
    assert row["within"] >= 0.9 and row["gross"] < 2e-3
    assert 0.5 <= row["sigma_px"] / row["rms_px"] <= 2
    if CASES[number].fault == "exposure jump":
        assert any("times as much as white" in note for note in row["notes"])


@pytest.mark.parametrize(("number", "seed"), [(13, 87), (15, 40)])
def test_a_set_that_lacks_too_much_is_refused_for_it(number: int, seed: int) -> None:
    """Both pictures of a bit are missing, and two of three steps."""
    found = study.figures(CASES[number], seed)
    cause = r"[23] pictures are missing, which may be the cause: take what is missing again$"
    assert re.search(cause, found["refused"])


def test_missing_photographs_through_the_command(tmp_path: Path) -> None:
    """The whole command: files in, an EXR map out, the missing files named."""
    case = next(c for c in CASES if c.fault == "photographs missing" and "Gray, inv" in c.name)
    folder = tmp_path / "photos"
    folder.mkdir()
    lab = study.photographed(case, 1, folder)
    lost = [i for i in range(len(case.patterns)) if not (folder / f"img_{i:04d}.png").exists()]
    theirs = tmp_path / "theirs.toml"
    theirs.write_text(case.description)
    size = f"{PANEL[0]}x{PANEL[1]}"
    out = tmp_path / "map.exr"
    ran = procam("decode", folder, "--size", size, "--code", str(theirs), out)
    assert (ran.code, ran.err) == (0, "")
    for number in lost:
        assert any(
            f"after img_{before:04d}.png; done without" in ran.out for before in range(number)
        )
    assert ran.out.count("done without") == len(lost) > 0
    found = read_channels(out)
    error = np.stack([found["projector.x"], found["projector.y"]], -1) - lab.truth
    known = np.isfinite(found["sigma"])
    assert known[lab.lit].mean() > 0.85
    scalar = np.sqrt(np.mean(error[known] ** 2, axis=-1))
    assert np.mean(scalar <= 2 * found["sigma"][known]) > 0.95


def described(folder: Path, description: str) -> Path:
    """A file that describes a code."""
    theirs = folder / "theirs.toml"
    theirs.write_text(description)
    return theirs


@pytest.fixture(scope="module")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Photographs of the first case of a name, taken once."""

    @cache
    def taken(name: str) -> Path:
        photos = tmp_path_factory.mktemp("photos")
        study.photographed(next(c for c in CASES if c.name == name), 2, photos)
        return photos

    return taken


def test_wrong_shifts_are_refused_unless_overruled(
    photographed: Callable[[str], Path], tmp_path: Path
) -> None:
    photos = photographed(CASES[0].name)
    theirs = described(tmp_path, study.STEPS.replace("steps = 3", "shifts_deg = [30, 150, 270]"))
    command = ("decode", photos, "--size", "192x128", "--code", theirs, tmp_path / "m.exr")
    ran = procam(*command, "--anyway")
    assert ran.code == 0
    assert "decoded anyway, though a check refuses it: pictures: columns: the edges" in ran.out


def test_wrong_signs_and_periods_are_noted_or_refused(
    photographed: Callable[[str], Path], tmp_path: Path
) -> None:
    """Of columns alone the picture arrives mirrored; of both it lies beyond the panel."""
    photos = photographed("4 steps of 3 periods")
    signs = "shifts_deg = [0, -90, -180, -270]"
    theirs = described(tmp_path, study.FREQUENCIES.replace("steps = 4", signs, 1))
    command = ("decode", photos, "--size", "192x128", "--code", theirs, tmp_path / "m.exr")
    ran = procam(*command)
    assert ran.code == 0
    assert "the camera sees the picture mirrored: right with rear projection" in ran.out
    theirs.write_text(study.FREQUENCIES.replace("steps = 4", signs))
    assert "and the sign of shifts" in refused(*command)
    theirs.write_text(study.FREQUENCIES.replace("16]", "15.8]"))
    ran = procam(*command)
    assert ran.code == 0
    assert "columns: the sinusoids of period 48 px lie up to " in ran.out


def test_a_binary_code_is_no_gray_code(tmp_path: Path) -> None:
    """Cells of 8 pixels are too wide for the triples of pixels that judge other sets."""
    shown = [*binary_cells(0), *binary_cells(1)]
    patterns = (*shown, *inverted(shown), WHITE, BLACK)
    description = study.GRAY.replace("CELL", "8")
    case = study.Case("binary", patterns, description, cell_px=8)
    photos, theirs = tmp_path / "photos", described(tmp_path, description)
    photos.mkdir()
    study.photographed(case, 2, photos)
    out = tmp_path / "m.exr"
    ran = procam("decode", photos, "--size", "192x128", "--code", theirs, out)
    assert (ran.code, out.exists()) == (2, False)
    assert "of the map is mirrored and the rest is not" in ran.complaint


def binary_cells(axis: int) -> list[Pattern]:
    cell = np.arange(PANEL[axis]) // 8
    bits = range(int(cell.max()).bit_length() - 1, -1, -1)
    return [Pattern(((cell >> bit) & 1).astype(float), axis) for bit in bits]


@pytest.mark.parametrize("name", ["Gray, inverses last", "3 steps of 2 periods, Gray cells"])
def test_a_panel_wider_than_the_size_says(
    name: str, photographed: Callable[[str], Path], tmp_path: Path
) -> None:
    """As many patterns, and all pixels to the right of column 160 beyond the panel."""
    case = next(c for c in CASES if c.name == name)
    photos, theirs = photographed(name), described(tmp_path, case.description)
    out = tmp_path / "map.exr"
    ran = procam("decode", photos, "--size", "160x128", "--code", theirs, out)
    assert ran.code == 2
    assert "pictures: columns: " in ran.err
    assert "show patterns that a panel of 160 does not have" in ran.err


def test_exchanged_width_and_height_of_waves_are_noted(
    photographed: Callable[[str], Path], tmp_path: Path
) -> None:
    photos = photographed("4 steps of 3 periods")
    theirs = described(tmp_path, study.FREQUENCIES)
    for size, noted in (("192x128", False), ("128x192", True)):
        out = tmp_path / f"{size}.exr"
        ran = procam("decode", photos, "--size", size, "--code", theirs, out)
        assert ran.code == 0
        assert ("show patterns that a panel of 128 does not have" in ran.out) == noted
