"""`procam decode --code FILE.toml --order ...`: photographs of codes that other programs draw."""

from pathlib import Path

import numpy as np
import pytest
from foreign_sets import SIZE, Set, gray, photograph
from tiny_venue import procam, refused

from procam.files.images.layers import read_channels
from procam.files.images.pixels import write_image

LEVELS = [(np.ones(max(SIZE)), 0), (np.zeros(max(SIZE)), 0)]
PHASES = """
[columns]
periods_px = [18, 16]
steps = 3
gray_cell_px = 16
[rows]
periods_px = [16]
shifts_deg = [0, 120, 240]
gray_cell_px = 16
inverses = true
"""


def written(folder: Path, taken: Set) -> Path:
    folder.mkdir()
    for number, picture in enumerate(taken.photographs):
        write_image(folder / f"img_{number}.png", picture)
    return folder


def described(folder: Path, text: str) -> Path:
    path = folder / "theirs.toml"
    path.write_text(text)
    return path


def decoded(folder: Path, out: Path, *arguments: object) -> tuple[np.ndarray, np.ndarray, str]:
    """Columns and rows (H, W, 2), their standard error (H, W), and what was printed."""
    size = ("--size", f"{SIZE[0]}x{SIZE[1]}")
    ran = procam("decode", folder, *size, out, *map(str, arguments))
    assert (ran.code, ran.err) == (0, "")
    found = read_channels(out)
    return np.stack([found["projector.x"], found["projector.y"]], -1), found["sigma"], ran.out


def test_patterns_then_inverses(tmp_path: Path) -> None:
    """A code that procam knows, in the order of another program."""
    lines = [(line, axis) for axis in (0, 1) for line in gray(SIZE[axis], 1)]
    lines += [(1 - line, axis) for line, axis in lines]
    taken = photograph(lines + LEVELS, np.random.default_rng(22))
    folder = written(tmp_path / "photos", taken)
    order = "columns, rows, columns-inverses, rows-inverses, white, black"
    xy, sigma, said = decoded(folder, tmp_path / "m.exr", "--code", "gray", "--order", order)
    use = taken.inside() & np.isfinite(sigma)
    assert use.sum() > 0.85 * taken.inside().sum()
    assert np.mean(np.abs(xy - taken.truth)[use].max(axis=-1) < 2 * sigma[use]) > 0.9
    assert "exchanged" not in said


def test_patterns_of_a_described_code(tmp_path: Path) -> None:
    path = described(tmp_path, PHASES)
    out = tmp_path / "pictures"
    assert procam("lens", "patterns", out, "--size", "64x48", "--code", str(path)).code == 0
    # white, black, 2 x 3 phases and 2 bits of 4 cells, 3 phases and 2 bits of 3 cells with inverses
    assert len(list(out.iterdir())) == 2 + 6 + 2 + 3 + 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[columns", "is not valid TOML"),
        ("[columns]\nperiods_px = [16]\nsteps = 3\n", "rows: field required"),
        ("[columns]\nperiod = 3\n[rows]\ngray_cell_px = 1\n", "columns.period: extra inputs"),
        (
            "[columns]\n[rows]\ngray_cell_px = 1\n",
            "columns needs periods_px, gray_cell_px, or both",
        ),
        (
            "[columns]\nperiods_px = [16]\n[rows]\ngray_cell_px = 1\n",
            "columns: periods_px needs either steps or shifts_deg",
        ),
        (
            "[columns]\nsteps = 3\ngray_cell_px = 4\n[rows]\ngray_cell_px = 1\n",
            "columns: periods_px needs either steps or shifts_deg",
        ),
        (
            "[columns]\ngray_cell_px = 1\n[rows]\nperiods_px=[99]\nsteps=3\ninverses = true\n",
            "rows: inverses belong to Gray patterns",
        ),
    ],
)
def test_descriptions_that_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = described(tmp_path, text)
    out = tmp_path / "pictures"
    ran = procam("lens", "patterns", out, "--size", "64x48", "--code", str(path))
    assert (ran.code, message in ran.complaint, out.exists()) == (2, True, False)


def test_a_description_that_is_not_there(tmp_path: Path) -> None:
    assert "gone.toml: there is no such file" in refused(
        "lens", "patterns", tmp_path / "p", "--size", "64x48", "--code", tmp_path / "gone.toml"
    )
