"""`procam decode --code FILE.toml --order ...`: photographs of codes that other programs draw."""

from pathlib import Path

import numpy as np
import pytest
from foreign_sets import SIZE, Set, gray, photograph, steps
from tiny_venue import procam

from procam.estimate.structured_light.sinusoids import unseen_harmonic_px
from procam.files.images.layers import read_channels
from procam.files.images.pixels import write_image
from procam.maths.codes.phase import Waves, equal_steps

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


def test_phases_over_gray_cells(tmp_path: Path) -> None:
    lines = [(line, 0) for line in (*steps(18, 3), *steps(16, 3), *gray(SIZE[0], 16))]
    lines += [(line, 1) for line in steps(16, 3)]
    lines += [(each, 1) for line in gray(SIZE[1], 16) for each in (line, 1 - line)]
    taken = photograph(LEVELS + lines, np.random.default_rng(21))
    folder = written(tmp_path / "photos", taken)
    out = tmp_path / "map.exr"
    xy, sigma, said = decoded(folder, out, "--code", described(tmp_path, PHASES))
    assert "rows: three steps of one period do not show" in said and "columns: three" not in said
    use = taken.inside() & np.isfinite(sigma)
    assert use.sum() > 0.97 * taken.inside().sum()
    error = np.sqrt(np.mean((xy - taken.truth) ** 2, axis=-1))
    # the rows' allowance for a wrong gamma, which these pictures do not have
    unseen = unseen_harmonic_px(Waves(np.full(3, 16.0), equal_steps(3), 3))
    sigma = np.sqrt(sigma**2 - unseen**2 / 2)
    assert np.sqrt(np.mean((error / sigma)[use] ** 2)) == pytest.approx(1, abs=0.15)
    assert "exchanged" not in said


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
    ran = procam(
        "lens", "patterns", tmp_path / "p", "--size", "64x48", "--code", tmp_path / "gone.toml"
    )
    assert (ran.code, "gone.toml: there is no such file" in ran.complaint) == (2, True)


class TestFaultySets:
    """Gray code in the order of `procam decode`, with faults that cost bits or pixels, not the set."""

    def lines(self) -> list[tuple[np.ndarray, int]]:
        bits = [(line, axis) for axis in (0, 1) for line in gray(SIZE[axis], 1)]
        return [(each, axis) for line, axis in bits for each in (line, 1 - line)] + LEVELS

    def test_a_missing_pair(self, tmp_path: Path) -> None:
        taken = photograph(self.lines(), np.random.default_rng(23))
        folder = written(tmp_path / "photos", taken)
        for number in (14, 15):  # the finest bit of the columns
            (folder / f"img_{number}.png").unlink()
        xy, sigma, said = decoded(folder, tmp_path / "m.exr", "--code", "gray")
        assert "missing: column bit 0, after img_13.png; done without" in said
        assert "missing: column bit 0 inverse, after img_13.png; done without" in said
        use = taken.inside() & np.isfinite(sigma)
        assert use.sum() > 0.85 * taken.inside().sum()
        error = (xy - taken.truth)[use]
        assert np.abs(error[:, 0]).max() < 2 and np.abs(error[:, 1]).max() < 1.5

    def test_missing_ones_that_the_names_do_not_show(self, tmp_path: Path) -> None:
        taken = photograph(self.lines(), np.random.default_rng(24))
        short = Set(taken.photographs[:14] + taken.photographs[16:], taken.truth)
        folder = written(tmp_path / "photos", short)
        size = ("--size", f"{SIZE[0]}x{SIZE[1]}", "--code", "gray")
        ran = procam("decode", folder, *size, tmp_path / "m.exr")
        assert (ran.code, "there are 30 pictures, and the code gray" in ran.complaint) == (2, True)

    def test_a_jump_of_exposure(self, tmp_path: Path) -> None:
        lines = self.lines()
        exposures = [1.5] * 9 + [1.0] * (len(lines) - 9)
        taken = photograph(lines, np.random.default_rng(25), exposures=exposures)
        folder = written(tmp_path / "photos", taken)
        xy, sigma, said = decoded(folder, tmp_path / "m.exr", "--code", "gray")
        assert "img_0.png to img_8.png: exposed 1.5" in said
        use = taken.inside() & np.isfinite(sigma)
        assert use.sum() > 0.85 * taken.inside().sum()
        assert np.mean(np.abs(xy - taken.truth)[use].max(axis=-1) < 2 * sigma[use]) > 0.9

    def test_anyway(self, tmp_path: Path) -> None:
        lines = self.lines()
        lines[-1] = lines[3]  # black shows stripes
        taken = photograph(lines, np.random.default_rng(26))
        folder = written(tmp_path / "photos", taken)
        size = ("--size", f"{SIZE[0]}x{SIZE[1]}", "--code", "gray")
        ran = procam("decode", folder, *size, tmp_path / "m.exr")
        refusal = f"img_{len(lines) - 1}.png should show black"
        assert (ran.code, refusal in ran.complaint) == (2, True)
        xy, sigma, said = decoded(folder, tmp_path / "m.exr", "--code", "gray", "--anyway")
        assert f"decoded anyway, though a check refuses it: pictures: {refusal}" in said
        use = taken.inside() & np.isfinite(sigma)
        assert use.sum() > 0.8 * taken.inside().sum()
        assert np.mean(np.abs(xy - taken.truth)[use].max(axis=-1) < 2 * sigma[use]) > 0.9
