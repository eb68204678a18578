"""Compensated frames against the same equations in double precision, pixel by pixel."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.frame import Show
from procam.kernels import reference_frame

Array = NDArray[np.float64]
HERE = Path(__file__).parent
SIZES = (4096, 8192)
ROWS = 64
TILE = 64  # of the dither
CLEAR = 1e-5  # from a limit: which side of it a value is on does not hang on rounding
GOALS = {"float32": "1e-8 (KKT), 1e-6 (unclipped)", "uint8": "2e-5 (s), .5 (dithered)"}


def light_in_double(show: Show) -> Array:
    """What bounces to each node (M, M, 3) [rel], by the numbers that the kernels found."""
    model = show.equations.model
    terms = reference_frame.monomials(model.direction, model.terms)
    numbers = show.equations.solution[0][:, : model.terms]
    return model.spread.astype(float) * np.tensordot(terms, numbers, (0, 1))


def misses(show: Show, frame: NDArray[Any], light: Array) -> Iterator[float]:
    """Largest difference of what was written from what should be, for some rows at a time.

    Of light: where no limit holds, of the content less what bounces [rel]. Of 8 bits: from the value under
    its dither, where exact rounding leaves .5.
    """
    model, coding = show.equations.model, show.coding
    for start in range(0, model.size, ROWS):
        rows = slice(start, start + ROWS)
        content = coding.decoded(frame[rows]).astype(float)
        wanted = content - reference_frame.interpolated(model, light, rows)
        lit = reference_frame.interpolated(model, model.coverage, rows) > 0
        lo = reference_frame.interpolated(model, model.lo, rows)
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
    light, assumed = light_in_double(show), show.equations.assumed()
    sums = reference_frame.frame_sums(show.equations.model, frame, light, "light", show.coding)
    return {
        "size": size,
        "dome": "measured" if measured else "even",
        "kind": np.dtype(kind).name,
        "kkt": float(np.abs(sums - assumed).max() / np.abs(sums).max()),
        "picture": max(misses(show, frame, light)),
    }


def main() -> None:
    """Run all cases and write studies/precision.json and .md."""
    rows = [
        study(size, measured, kind)
        for kind in (np.float32, np.uint8)
        for size in SIZES
        for measured in (False, True)
    ]
    (HERE / "precision.json").write_text(json.dumps(rows, indent=1) + "\n")
    (HERE / "precision.md").write_text(_report(rows))


def _report(rows: list[dict[str, Any]]) -> str:
    lines = [
        "# Compensated frames, against double precision",
        "",
        "A frame of a pan, solved by the kernels; its equations summed anew over all pixels in double "
        "precision (`kernels/reference_frame.py`). Residual: light assumed to be sent less light sent, "
        "relative to the largest moment; the error of s is 1.2 times smaller here, the slope of the "
        "equations. Picture: float, largest error where no limit holds [of white]; 8 bits, largest "
        "distance from the value under its dither [codes], .5 for exact rounding. Bands of rows share "
        "weights here too: what that costs is in docs/theory/compensation.md.",
        "",
        "| content | size | dome | residual | picture | goals |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        told = f"{row['kkt']:.1e} | {row['picture']:.3g} | {GOALS[row['kind']]}"
        lines.append(f"| {row['kind']} | {row['size']} | {row['dome']} | {told} |")
    return "\n".join([*lines, "", "`python -m studies precision`", ""])


if __name__ == "__main__":
    main()
