"""Sets of other programs' patterns, photographed outside procam's simulator and decoded from their files.

Every seed draws a projector, a wall and a camera (`foreign_pictures`), writes PNG files and a TOML file
that describes the code, and decodes them as `procam decode` does. Errors are in units of the standard
error stated for that axis of that pixel. A seed is right if nine tenths of them are within two: pixels
of a seed share gamma, blur and paint, so a wrong model makes whole seeds wrong, which a share pooled
over all pixels would hide. A set that is refused is a seed that is not right. Errors beyond a pixel (a
Gray cell, if wider) are gross: they are left out of the rms error, and counted by themselves.

Writes studies/foreign_codes.json and .md.
"""

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.errors import ProcamError
from procam.interfaces.cli._codes import chosen_code
from procam.interfaces.cli.decode import decode_folder
from studies.foreign_pictures import BLACK, PANEL, WHITE, Lab, Pattern, gray, inverted, phases
from studies.measure import Errors, side_by_side, write

SEEDS = 100
JUMP, MOST_LOST = (0.1, 0.3), 3
GOALS = {"right": 0.9, "least_ratio": 0.5, "most_ratio": 2.0}
STEPS = """
order = ["white", "black", "columns-phase", "columns-gray", "rows-phase", "rows-gray"]
[columns]
periods_px = [16, 18]
steps = 3
gray_cell_px = 16
[rows]
periods_px = [16, 18]
steps = 3
gray_cell_px = 16
"""
ONE_PERIOD = STEPS.replace("[16, 18]", "[16]")
FREQUENCIES = """
[columns]
periods_px = [192, 48, 16]
steps = 4
[rows]
periods_px = [192, 48, 16]
steps = 4
"""
GRAY = """
order = ["columns-gray", "rows-gray", "columns-inverses", "rows-inverses", "white", "black"]
[columns]
gray_cell_px = CELL
inverses = true
[rows]
gray_cell_px = CELL
inverses = true
"""


@dataclass(frozen=True)
class Case:
    """Patterns in the order they are shown, their description, and what happens to the photographs."""

    name: str
    patterns: tuple[Pattern, ...]
    description: str
    encoded: bool = False
    fault: str = ""
    cell_px: int = 1


def by_steps(periods: tuple[float, ...]) -> tuple[Pattern, ...]:
    """Three steps of each period, then Gray cells."""
    each = (pattern for axis in (0, 1) for pattern in (*phases(axis, periods, 3), *gray(axis, 16)))
    return (WHITE, BLACK, *each)


def by_frequencies() -> tuple[Pattern, ...]:
    """Four steps of three periods."""
    return (WHITE, BLACK, *phases(0, (192, 48, 16), 4), *phases(1, (192, 48, 16), 4))


def by_cells(cell: int) -> tuple[Pattern, ...]:
    """All Gray patterns, then all inverses."""
    shown = (*gray(0, cell), *gray(1, cell))
    return (*shown, *inverted(shown), WHITE, BLACK)


def cases() -> tuple[Case, ...]:
    """All cases: the codes with either camera, then their faults, with cameras in turn."""
    codes = (
        ("3 steps of 2 periods, Gray cells", by_steps((16, 18)), STEPS, 1),
        ("3 steps of 1 period, Gray cells", by_steps((16,)), ONE_PERIOD, 1),
        ("4 steps of 3 periods", by_frequencies(), FREQUENCIES, 1),
        ("Gray, inverses last", by_cells(1), GRAY.replace("CELL", "1"), 1),
        ("Gray cells of 8 px", by_cells(8), GRAY.replace("CELL", "8"), 8),
    )
    whole = [
        Case(name, patterns, text, encoded, "", cell)
        for name, patterns, text, cell in codes
        for encoded in (False, True)
    ]
    faulty = [
        Case(name, patterns, text, encoded, fault, cell)
        for fault in ("exposure jump", "photographs missing")
        for (name, patterns, text, cell), encoded in zip(
            (codes[0], codes[2], codes[3]), (False, True, False), strict=True
        )
    ]
    return (*whole, *faulty)


def photographed(case: Case, seed: int, folder: Path) -> Lab:
    """The photographs of a seed as files img_0000.png, ... in a folder."""
    lab = Lab([len(case.patterns), case.encoded, seed], encoded=case.encoded)
    rng = np.random.default_rng([seed, len(case.patterns)])
    count = len(case.patterns)
    exposures, lost = np.ones(count), set()
    if case.fault == "exposure jump":
        change = 1 - rng.uniform(*JUMP)
        first = rng.integers(count // 4, 3 * count // 4)
        exposures[first:] = change
        exposures = exposures[:: rng.choice([-1, 1])]
    if case.fault == "photographs missing":
        coded = [i for i, p in enumerate(case.patterns) if p is not WHITE and p is not BLACK]
        lost = set(rng.choice(coded[1:-1], rng.integers(1, MOST_LOST + 1), replace=False).tolist())
    for number, (pattern, exposure) in enumerate(zip(case.patterns, exposures, strict=True)):
        picture = lab.photograph(pattern, exposure)
        if number not in lost:
            cv2.imwrite(str(folder / f"img_{number:04d}.png"), picture[..., ::-1])
    return lab


def figures(case: Case, seed: int) -> dict[str, Any]:
    """What became of one seed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lab = photographed(case, seed, folder)
        description = folder / "theirs.toml"
        description.write_text(case.description)
        code = chosen_code(str(description), PANEL)
        try:
            found, _, notes = decode_folder(folder, code, (None, None))
        except ProcamError as error:
            return {"seed": seed, "refused": str(error).replace(str(folder), "FOLDER")}
    errors = Errors(found, lab.truth)
    limit = float(max(1, case.cell_px))
    near = errors.inliers(limit)
    return {
        "seed": seed,
        "coverage": float(found.valid[lab.lit].mean()),
        "gross": errors.off(limit),
        "within": float(np.mean(np.abs(errors.error) <= 2 * errors.sigma)),
        "rms_px": float(np.sqrt(np.mean(errors.error[near] ** 2))),
        "sigma_px": float(np.median(errors.sigma)),
        "notes": notes,
    }


def summary(case: Case, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a case over its seeds; those of refused seeds are left out, but not of `right`."""
    read = [row for row in rows if "refused" not in row]

    def all_of(name: str) -> NDArray[np.float64]:
        return np.array([row[name] for row in read], float)

    ratio = all_of("sigma_px") / all_of("rms_px")
    return {
        "case": case.name,
        "camera": "sRGB" if case.encoded else "linear",
        "fault": case.fault,
        "seeds": len(rows),
        "refused": len(rows) - len(read),
        "right": float(np.sum(all_of("within") >= GOALS["right"]) / len(rows)),
        "within": float(all_of("within").mean()),
        "ratio": np.quantile(ratio, [0.05, 0.5, 0.95]).tolist(),
        "rms_px": float(np.median(all_of("rms_px"))),
        "coverage": float(np.median(all_of("coverage"))),
        "least_coverage": float(all_of("coverage").min()),
        "gross": float(all_of("gross").mean()),
        "most_gross": float(all_of("gross").max()),
    }


def table(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Lines of the study's page."""
    lines = [
        "# Codes of other programs",
        "",
        f"{SEEDS} seeds a line. Panel {PANEL[0]}x{PANEL[1]}, camera 240x180 of 8 bits, projector's gamma "
        "2.0 to 2.4. For the linear camera sinusoids are drawn for a gamma of 2.2; for the sRGB camera "
        "they are drawn without regard to gamma. Exposure jumps by 10 to 30 % once; one to three "
        "photographs are missing. A seed is right if nine tenths of its errors are within two stated "
        "standard errors; goal: nine tenths of the seeds. Stated over real error: median standard error "
        "over rms error of a seed, 5, 50 and 95 % of the seeds; goal: the median within 0.5 to 2. Gross: "
        "off by more than a pixel (a cell, if wider).",
        "",
        "| code | camera | fault | refused | seeds right | within 2 sigmas | stated over real error "
        "| rms error | decoded, median | least | gross, mean | most |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    return lines + [_line(row) for row in rows]


def _line(row: dict[str, Any]) -> str:
    ratio = " .. ".join(f"{value:.2f}" for value in row["ratio"])
    return (
        f"| {row['case']} | {row['camera']} | {row['fault']} | {row['refused']} | {row['right']:.0%} | "
        f"{row['within']:.1%} | {ratio} | {row['rms_px']:.3f} px | {row['coverage']:.1%} | "
        f"{row['least_coverage']:.1%} | {row['gross']:.3%} | {row['most_gross']:.3%} |"
    )


def main() -> None:
    """Run all cases."""
    found = side_by_side(_figures, list(product(range(len(cases())), range(SEEDS))))
    rows = [summary(c, found[i * SEEDS : (i + 1) * SEEDS]) for i, c in enumerate(cases())]
    write("foreign_codes", {"goals": GOALS, "rows": rows}, table(rows))


def _figures(job: tuple[int, int]) -> dict[str, Any]:
    number, seed = job
    return figures(cases()[number], seed)
