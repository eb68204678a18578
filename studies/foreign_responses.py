"""Errors and intervals of `response` on photographs of cameras outside its model.

Truth must lie within two standard errors at nine of ten levels in nine of ten seeds, and the standard
error must not exceed twice the real error.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import CalibrationError
from procam.estimate.camera.response import CameraResponse, solve_response
from studies.foreign_brackets import CASES, Case, shoot, true_light
from studies.measure import side_by_side, write

Array = NDArray[np.float64]
SEEDS = 100  # per case
SUPPORTED = slice(
    13, 250
)  # levels of 255 that photographs hold; the ends are 0 and 1 by definition
SHARE = 0.9  # of the levels of a seed, within two standard errors


def main() -> None:
    """Run all cases and write studies/foreign_responses.json and .md."""
    found = side_by_side(_run, list(product(range(len(CASES)), range(SEEDS))))
    rows = [summary(c, found[i * SEEDS : (i + 1) * SEEDS]) for i, c in enumerate(CASES)]
    rows.append(total(rows))
    write("foreign_responses", {"seeds": SEEDS, "cases": rows}, table(rows))


def run(case: Case, seed: int) -> dict[str, Any]:
    """Errors of one set of brackets: `within`, `error`, `sigma` and `left_out`; or `refused`, why."""
    brackets = shoot(case, seed)
    try:
        found = solve_response(brackets.photographs, brackets.nominal_s, 8)
    except CalibrationError as error:
        return {"refused": str(error)}
    error, sigma = errors(case, found)
    return {
        "within": float((np.abs(error) <= 2 * sigma).mean()),
        "error": float(np.sqrt(np.mean(error**2))),
        "sigma": float(np.sqrt(np.mean(sigma**2))),
        "left_out": (found.left_out[0] if found.left_out else None) == brackets.wrong,
        "curves": (found.light.ndim == 2) == (len(case.curves) == 3),
    }


def _run(job: tuple[int, int]) -> dict[str, Any]:
    number, seed = job
    return run(CASES[number], seed)


def errors(case: Case, found: CameraResponse) -> tuple[Array, Array]:
    """Errors (K, C) of the light at the supported levels, and their standard errors (K, C)."""
    true = np.stack([true_light(curve, found.levels) for curve in case.curves], axis=1)
    light, sigma = (
        values if values.ndim == 2 else values[:, None] for values in (found.light, found.sigma)
    )
    error, spread = np.broadcast_arrays(light - true, sigma)
    return error[SUPPORTED], spread[SUPPORTED]


def summary(case: Case, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a case over its seeds."""
    solved = [row for row in results if "refused" not in row]
    rms = {
        name: float(np.sqrt(np.mean([row[name] ** 2 for row in solved])))
        for name in ("error", "sigma")
    }
    return {
        "case": case.name,
        "seeds": len(results),
        "within": float(np.mean([row["within"] for row in solved])),
        "seeds_within": sum(row["within"] >= SHARE for row in solved),
        "error": rms["error"],
        "sigma": rms["sigma"],
        "sigma_over_error": rms["sigma"] / rms["error"],
        "wrong_curves": sum(not row["curves"] for row in solved),
        "wrong_left_out": sum(not row["left_out"] for row in solved),
        "refused": dict(Counter(row["refused"] for row in results if "refused" in row)),
    }


def total(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """All cases together; the ratio is that of their geometric mean."""
    refused = Counter[str]()
    for row in rows:
        refused.update(row["refused"])
    mean = {name: float(np.mean([row[name] for row in rows])) for name in ("within",)}
    squares = {
        name: float(np.sqrt(np.mean([row[name] ** 2 for row in rows])))
        for name in ("error", "sigma")
    }
    ratio = float(np.exp(np.mean(np.log([row["sigma_over_error"] for row in rows]))))
    counts = ("seeds", "seeds_within", "wrong_curves", "wrong_left_out")
    sums = {name: sum(row[name] for row in rows) for name in counts}
    return {
        "case": "all",
        **mean,
        **squares,
        **sums,
        "sigma_over_error": ratio,
        "refused": dict(refused),
    }


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    return (
        f"| {row['case']} | {row['within']:.1%} | {row['seeds_within']} of {row['seeds']} | "
        f"{row['error']:.4f} | {row['sigma']:.4f} | {row['sigma_over_error']:.2f} | "
        f"{sum(row['refused'].values())} | {row['wrong_left_out']} | {row['wrong_curves']} |"
    )


def table(rows: Iterable[dict[str, Any]]) -> list[str]:
    """The results as lines of Markdown."""
    return [
        "# Responses of cameras outside the estimator's model",
        "",
        f"{SEEDS} sets of 8-bit brackets per case: electrons, saturation, the camera's curve, rounding, "
        "shutters off by 1 %. Errors of the light are",
        "shares of white at levels 13 to 249 of 255. A seed counts as within if truth is within two standard "
        f"errors at {SHARE:.0%} of its levels; refused sets do not count.",
        "",
        "| case | levels within 2 sigma | seeds within | rms error | rms sigma | sigma / error | refused | "
        "another photograph left out | wrongly one or three curves |",
        "|---|---|---|---|---|---|---|---|---|",
        *(line(row) for row in rows),
    ]
