"""Every code at every albedo, SNR, defocus and error of gamma, in one table.

Writes studies/code_table.json and studies/code_table.md.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from procam.errors import ProcamError
from procam.estimate.structured_light.codes import CODES, Code
from simulators.photograph_bench import PhotographBench
from simulators.presets import STANDARD
from simulators.scene import DomeScene, SceneSize
from studies.measure import Errors, Shots, rms, write

# Half a full panel with the waves of a full one, so that blur, stripes and periods are to scale.
PANEL, FULL_PANEL = (960, 600), (1920, 1200)
SIZE = SceneSize(2, PANEL, 1, (512, 512), rays=1024)
ALBEDOS = (0.0, 0.3, 0.6, 0.8)
SNRS = (20.0, 50.0, 200.0)
DEFOCUS_PX = (0.0, 3.0, 6.0)
GAMMAS_LEFT = (1.0, 1.1)
WORKERS = 2
MISREAD_PX, MISREAD_SIGMAS = 1.0, 4.0  # off by more than their sum: misread, not merely coarse
USABLE_COVERAGE, USABLE_MISREAD = 0.9, 1e-3
Row = dict[str, object]


class Condition(NamedTuple):
    """A condition that is rendered once, for all codes and SNRs."""

    albedo: float
    defocus_px: float
    gamma_left: float


def conditions() -> list[Condition]:
    """Every albedo with every defocus and every error of gamma."""
    return [Condition(*values) for values in product(ALBEDOS, DEFOCUS_PX, GAMMAS_LEFT)]


def code_of(name: str, size: tuple[int, int] = PANEL) -> Code:
    """A code on this panel with the periods it has on the full panel."""
    return Code(name, size, CODES[name](size[0], FULL_PANEL), CODES[name](size[1], FULL_PANEL))


def rows_of(scene: DomeScene, condition: Condition, seed: int) -> list[Row]:
    """All codes and SNRs under one condition."""
    bench = PhotographBench(scene.altered(**condition._asdict()), "south")
    rows = []
    for name in CODES:
        shots = Shots(bench, code_of(name, scene.size.projector_size))
        for snr in SNRS:
            row = {"code": name, **condition._asdict(), "snr": snr, "pictures": len(shots.signals)}
            rows.append(row | cell(shots, snr, seed))
    return rows


def cell(shots: Shots, snr: float, seed: int) -> Row:
    """Figures of one code under one condition, or the error that prevented them."""
    try:
        found = shots.decode([seed, int(snr)], snr).map
    except ProcamError as error:
        return {"error": f"{type(error).__name__}: {error}"}
    misses = Errors(found, shots.truth)
    if not misses.both.any():
        return {"error": "decoded without complaint, but gave no pixel where the picture lands"}
    limit = MISREAD_PX + MISREAD_SIGMAS * misses.sigma
    near = misses.inliers(limit)
    error, sigma = misses.error[near], misses.sigma[near]
    return {
        "coverage": round(misses.coverage, 4),
        "off_1px": float(f"{1 - misses.inliers().mean():.3g}"),
        "misread": float(f"{1 - near.mean():.3g}"),
        "invented": round(misses.invented / int(misses.lit.sum()), 5),
        "rms_px": float(f"{rms(error):.3g}") if near.any() else None,
        "chi2": float(f"{np.mean((error / sigma) ** 2):.3g}") if near.any() else None,
    }


def usable(row: Row) -> bool:
    """Whether a cell is usable: most of the picture decoded, hardly a pixel misread."""
    if "error" in row:
        return False
    return row["coverage"] >= USABLE_COVERAGE and row["misread"] <= USABLE_MISREAD  # type: ignore[operator]


def table(rows: list[Row]) -> Iterator[str]:
    """Lines of the study's page."""
    yield "# Every code under every condition"
    yield ""
    yield from _advice(rows)
    yield ""
    yield from _summary(rows)
    yield ""
    yield (
        f"Panel {PANEL[0]}x{PANEL[1]} with the waves of {FULL_PANEL[0]}x{FULL_PANEL[1]}, so that defocus "
        f"in px means the same; camera {SIZE.camera_size[0]}x{SIZE.camera_size[1]}, one noise seed a cell. "
        "SNR is that of the darkest lit pixel; gamma is the factor by which the pictures' linearisation is "
        "off; albedo 0: no light bounces twice."
    )
    yield ""
    yield "Cells: coverage % of the lit pixels / misread / rms [px] of the others / chi2 of error over sigma."
    yield (
        f"Misread: share off by more than {MISREAD_PX:g} px + {MISREAD_SIGMAS:g} of the pixel's own sigma "
        "(the JSON also has the share off by 1 px, and pixels invented where nothing lands, as a share of "
        "the lit ones). `raised`: decode refused; `nothing`: it gave no pixel where the picture lands."
    )
    for name in CODES:
        mine = [row for row in rows if row["code"] == name]
        yield f"\n## {name}, {mine[0]['pictures']} pictures\n"
        yield "| albedo | SNR |" + "".join(
            f" defocus {d:g} px{f', gamma x{g:g}' if g != 1 else ''} |"
            for d, g in product(DEFOCUS_PX, GAMMAS_LEFT)
        )
        yield "|---|---|" + "---|" * (len(DEFOCUS_PX) * len(GAMMAS_LEFT))
        for albedo, snr in product(ALBEDOS, SNRS):
            cells = (
                _short(_find(mine, albedo=albedo, snr=snr, defocus_px=d, gamma_left=g))
                for d, g in product(DEFOCUS_PX, GAMMAS_LEFT)
            )
            yield f"| {albedo:g} | {snr:g} | " + " | ".join(cells) + " |"
    errors = sorted({f"{r['code']}: {r['error']}" for r in rows if "error" in r})
    if errors:
        yield "\n## Why cells are empty\n"
        yield from (f"- {error}" for error in errors)


def _find(rows: list[Row], **wanted: object) -> Row:
    return next(row for row in rows if all(row[k] == v for k, v in wanted.items()))


def _short(row: Row) -> str:
    if "error" in row:
        return "nothing" if str(row["error"]).startswith("decoded") else "raised"
    if row["rms_px"] is None:
        return "all misread"
    mark = "" if usable(row) else " (!)"
    return (
        f"{100 * row['coverage']:.1f} / {row['misread']:.1g} / {row['rms_px']:.2f} / "  # type: ignore[operator, str-format]
        f"{row['chi2']:.2f}{mark}"
    )


def _advice(rows: list[Row]) -> Iterator[str]:
    count = len(ALBEDOS) * len(GAMMAS_LEFT)
    yield (
        "In short: `micro-phase` needs the fewest pictures and holds nearly everywhere; `phase-heterodyne` "
        "takes half as many again, is a tenth finer, and is the one for SNR 20 with 6 px of blur. `gray` "
        "stripes hold as well, three to ten times coarser, and are what most other programs photograph. "
        "Five more codes were measured and then deleted (2026-11-23), because `phase-heterodyne` is usable "
        "in every cell with fewer pictures. They were usable in fewer of the 72 cells: `micro-phase-checked` "
        "(34 pictures) in 70, `phase-gray` (28) in 30, `gray-wide` (42) in 24, `xor-04` (42) in 18, "
        "`xor-02` (42) in 10."
    )
    yield ""
    yield (
        f"Which code, when? Usable: {USABLE_COVERAGE:.0%} of the lit pixels decoded or more, and "
        f"{USABLE_MISREAD:.1%} of them or less misread. Below, codes that are usable at every albedo and "
        f"gamma, by their median rms [px] (in brackets: usable in some of the {count} cells)."
    )
    yield ""
    yield "| defocus | SNR | use |"
    yield "|---|---|---|"
    for defocus, snr in product(DEFOCUS_PX, SNRS):
        always, sometimes = [], []
        for name in CODES:
            mine = [
                row
                for row in rows
                if (row["code"], row["defocus_px"], row["snr"]) == (name, defocus, snr)
            ]
            good = [row for row in mine if usable(row)]
            if len(good) == len(mine):
                always.append((float(np.median([r["rms_px"] for r in good])), name))  # type: ignore[misc]
            elif good:
                sometimes.append(f"{name} {len(good)}")
        words = ", ".join(f"{name} {value:.2f}" for value, name in sorted(always)) or "none"
        also = f" ({', '.join(sometimes)})" if sometimes else ""
        yield f"| {defocus:g} px | {snr:g} | {words}{also} |"


def _summary(rows: list[Row]) -> Iterator[str]:
    yield "All cells of a code; the columns from `at` on count usable cells. `(!)` marks the others below."
    yield ""
    heads = (
        *("code", "pictures", "usable cells", "at SNR 20", "at defocus 3 px", "at defocus 6 px"),
        *("gamma x1.1", "albedo 0.8", "median coverage", "median rms [px]", "worst misread"),
        *("worst invented", "chi2 median, range"),
    )
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for name in CODES:
        mine = [row for row in rows if row["code"] == name]
        good = [row for row in mine if "error" not in row]
        parts = [
            mine,
            [r for r in mine if r["snr"] == 20],
            [r for r in mine if r["defocus_px"] == 3],
            [r for r in mine if r["defocus_px"] == 6],
            [r for r in mine if r["gamma_left"] != 1],
            [r for r in mine if r["albedo"] == 0.8],
        ]
        shares = " | ".join(f"{sum(map(usable, part))} of {len(part)}" for part in parts)
        column = {
            key: np.array([row[key] for row in good], float)
            for key in ("coverage", "rms_px", "misread", "invented", "chi2")
        }
        chi2 = column["chi2"]
        yield (
            f"| {name} | {mine[0]['pictures']} | {shares} | {np.nanmedian(column['coverage']):.1%} | "
            f"{np.nanmedian(column['rms_px']):.2f} | {column['misread'].max():.1g} | "
            f"{column['invented'].max():.1g} | "
            f"{np.nanmedian(chi2):.2f}, {np.nanmin(chi2):.2f}..{np.nanmax(chi2):.2f} |"
        )


def main() -> int:
    """Run all conditions and write the results."""
    scene = DomeScene(STANDARD, SIZE, 1)
    scene.sight_lines(next(iter(scene.cameras)))  # before there are threads
    with ThreadPoolExecutor(WORKERS) as pool:
        jobs = [pool.submit(rows_of, scene, c, i) for i, c in enumerate(conditions())]
        rows = []
        for condition, job in zip(conditions(), jobs, strict=True):
            rows += job.result()
            print(condition, flush=True)
    document = {
        "projector_size": SIZE.projector_size,
        "camera_size": SIZE.camera_size,
        "rays": SIZE.rays,
        "rows": rows,
    }
    write("code_table", document, table(rows))
    return 0
