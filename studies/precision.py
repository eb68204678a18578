"""Compensated frames against the same equations in double precision, pixel by pixel."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.frame import STRIP, Show, dome
from procam.kernels.frame import reference
from procam.kernels.frame.api import frame_sums
from procam.kernels.frame.model import FrameModel
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from studies.measure import write

Array = NDArray[np.float64]
SIZES = (4096, 8192)
ROWS = 64
TILE = 64  # of the dither
CLEAR = 1e-5  # from a limit: which side of it a value is on does not hang on rounding
ROWS_PER_TASK = 256
GOALS = {"float32": "1e-8 (residual), 1e-6 (unclipped)", "uint8": "2e-5 (s), 0.5 (dithered)"}


def light_in_double(show: Show) -> Array:
    """What bounces to each node (M, M, 3) [rel], by the numbers that the kernels found."""
    model = show.equations.model
    terms = reference.monomials(model.direction, model.terms)
    assert show.solution is not None
    numbers = show.solution.coefficients[:, : model.terms]
    return model.spread.astype(float) * np.tensordot(terms, numbers, (0, 1))


def misses(show: Show, frame: NDArray[Any], light: Array) -> Iterator[float]:
    """Largest difference of what was written from what should be, for some rows at a time.

    Of light: where no limit holds, of the content less what bounces [rel]. Of 8 bits: from the value under
    its dither, where exact rounding leaves 0.5.
    """
    model, coding = show.equations.model, show.coding
    for start in range(0, model.size, ROWS):
        rows = slice(start, start + ROWS)
        content = coding.decoded(frame[rows]).astype(float)
        wanted = content - reference.interpolated(model, light, rows)
        lit = reference.interpolated(model, model.coverage, rows) > 0
        lo = reference.interpolated(model, model.lo, rows)
        written = show.out[rows].astype(float)
        if frame.dtype == np.uint8:
            codes = 255 * np.asarray(coding.encode(np.clip(wanted, lo, coding.top)))
            y, x = (np.arange(n) % TILE for n in codes.shape[:2])
            dithered = np.minimum(codes + coding.threshold[np.ix_(y, x)][..., None] - 0.5, 254.5)
            yield float(np.abs(written - dithered)[lit].max(initial=0))
            continue
        free = (wanted > lo + CLEAR) & (wanted < coding.top - CLEAR) & lit[..., None]
        yield float(np.abs(written - wanted)[free].max(initial=0))


def study(size: int, measured: bool, kind: type) -> dict[str, Any]:
    """A frame of a pan: how far its numbers and its picture are from those of double precision."""
    show = Show.of(size, measured, kind)
    show()
    frame = show.frames[(show.shown - 1) % 2]
    assert show.solution is not None
    light, assumed = light_in_double(show), show.solution.moments
    model = show.equations.model
    sums = reference.frame_sums(model, frame, light, "light", show.coding)
    pixels = np.zeros_like(sums)
    for rows, wanted, lo, hi in reference.frame_parts(model, frame, light, show.coding):
        sent = np.minimum(np.fmax(wanted, lo), hi).reshape(-1, 3)
        pixels += (_weighed_terms(model, rows) @ sent).T
    return {
        "size": size,
        "dome": _name(measured),
        "kind": np.dtype(kind).name,
        "kkt": float(np.abs(sums - assumed).max() / np.abs(sums).max()),
        "flux": float(np.abs(1 - assumed[:, 0] / pixels[:, 0]).max()),
        "moments": float(np.abs(pixels - assumed).max() / np.abs(pixels).max()),
        "picture": max(misses(show, frame, light)),
    }


def structures(size: int, rows: slice) -> dict[str, NDArray[np.bool_]]:
    """Where some rows (R, N) of pictures that are white there, black elsewhere, are white."""
    y, x = np.mgrid[rows, :size]
    upper, radius = y < size // 2, np.hypot(y - size / 2, x - size / 2) / (size / 2)
    return {
        "1 row in 16, upper half": (y % 16 == 0) & upper,
        "8 rows in 16, upper half": (y % 16 < 8) & upper,
        "every second row, upper half": (y % 2 == 0) & upper,
        "1 row in 32": y % 32 == 5,
        "1 column in 16, left half": (x % 16 == 0) & (x < size // 2),
        "noise": np.random.default_rng(rows.start).random(y.shape) < 0.5,
        "rim, upper half": (radius > 0.91) & upper,
        "ring": (radius > 0.925) & (radius < 0.93),
        "one row": y == int(0.11 * size),
    }


def softened(model: FrameModel) -> FrameModel:
    """A dome whose coverage fades over 3 nodes at its border, as those of calibrations do."""
    direction, inside = master_directions(model.nodes)
    per_node = np.pi / model.nodes  # of height, at the rim
    coverage = np.clip((direction[..., 2] - STRIP) / (3 * per_node) + 0.5, 0, 1) * inside
    area = master_solid_angles(model.nodes) * coverage * (model.nodes / model.size) ** 2
    return replace(
        model, coverage=coverage.astype(np.float32), solid_angle_sr=area.astype(np.float32)
    )


def structured(size: int, measured: bool) -> list[dict[str, Any]]:
    """How far sums of structured pictures are from those pixel by pixel, in double [of the light]."""
    model, coding = softened(dome(size, measured).model), Show.of(size, measured, np.uint8).coding
    nothing = np.zeros_like(model.lo)
    model = replace(model, lo=nothing, hi=None, spread=nothing + np.float32(0.1))
    pictures: dict[str, NDArray[np.uint8]] = {}
    expected: dict[str, Array] = {}
    for start in range(0, size, ROWS_PER_TASK):
        rows = slice(start, start + ROWS_PER_TASK)
        terms = _weighed_terms(model, rows)
        for name, where in structures(size, rows).items():
            picture = pictures.setdefault(name, np.zeros((size, size, 3), np.uint8))
            picture[rows] = 255 * where[..., None]
            expected[name] = expected.get(name, 0) + terms @ where.ravel()
    none, found = np.zeros_like(model.spread), []
    for name, picture in pictures.items():
        sums = frame_sums(model, picture, none, "light", coding)[1]
        off = float(np.abs(sums - expected[name]).max() / expected[name][0])
        found.append({"size": size, "dome": _name(measured), "structure": name, "off": off})
    return found


def _weighed_terms(model: FrameModel, rows: slice) -> Array:
    """Solid angle times the monomials (T, R N) of each pixel of some rows."""
    area = reference.interpolated(model, model.solid_angle_sr, rows)
    axes = [reference.interpolated(model, axis, rows) for axis in model.direction]
    terms = reference.monomials(np.stack(axes), model.terms)
    return np.asarray((terms * area).reshape(model.terms, -1))


def _name(measured: bool) -> str:
    return "measured" if measured else "uniform"


def main() -> None:
    """Run all cases and write studies/precision.json and .md."""
    cases = [(size, measured) for size in SIZES for measured in (False, True)]
    sums = [row for case in cases for row in structured(*case)]
    rows = [
        study(size, measured, kind) for kind in (np.float32, np.uint8) for size, measured in cases
    ]
    write("precision", {"frames": rows, "sums": sums}, _report(rows) + _sums_report(sums))


def _report(rows: list[dict[str, Any]]) -> list[str]:
    lines = [
        "# Compensated frames, against double precision",
        "",
        "A frame of a pan, solved by the kernels. Residual: light assumed to be sent less light sent, "
        "relative to the largest moment, by the reference implementation of the kernels' sums in double "
        "(`kernels/frame/reference.py`); the error of s is 1.2 times smaller here, the slope of the "
        "equations. Flux, moments: the same by sums over pixels with their own areas and directions, "
        "bilinear between nodes: what the reference implementation shares with the "
        "kernels counts here too. Picture: float, "
        "largest error where no limit holds [of white]; 8 bits, largest distance from the value under "
        "its dither [codes], 0.5 for exact rounding.",
        "",
        "| content | size | dome | residual | flux | moments | picture | goals |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = " | ".join(f"{row[name]:.1e}" for name in ("kkt", "flux", "moments"))
        cells += f" | {row['picture']:.3g} | {GOALS[row['kind']]}"
        lines.append(f"| {row['kind']} | {row['size']} | {row['dome']} | {cells} |")
    return lines


def _sums_report(rows: list[dict[str, Any]]) -> list[str]:
    lines = [
        "",
        "Over a few node rows the kernels take areas and directions for linear. Sums of structures (8 "
        "bits, white on black, a border that fades over 3 nodes) against those over pixels: largest "
        "difference of a moment, of the light; goal 2e-5.",
        "",
        "| structure | "
        + " | ".join(f"{r['size']}, {r['dome']}" for r in rows[:: len(rows) // 4])
        + " |",
        "|" + "---|" * 5,
    ]
    for name in dict.fromkeys(row["structure"] for row in rows):
        cells = [f"{row['off']:.1e}" for row in rows if row["structure"] == name]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    main()
