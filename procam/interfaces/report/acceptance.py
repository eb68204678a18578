"""The client's limits in a report: rows of figure, interval, limit and verdict, and the outcome."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from procam.arrays import Array
from procam.interfaces.report.data import Material
from procam.interfaces.report.words import quantity_text
from procam.model.acceptance import Finding, findings
from procam.model.photometry import PRIMARIES

DIGITS = 4  # so that both ends of a narrow interval differ
OF_DIFFERENCE = 2  # whose interval has 0 in it, if all is well
SIDES = {"most": "at most ", "least": "at least ", "within": "within \N{PLUS-MINUS SIGN}"}


@dataclass(frozen=True, slots=True)
class Outcome:
    """All limits in one sentence, and whether all are kept."""

    text: str
    good: bool


def found(material: Material) -> list[Finding]:
    """The figures that the client limits; none without a venue.toml."""
    limits = material.venue.table.acceptance.limits if material.venue else {}
    calibration, check = material.calibration, material.other_seat
    if calibration and check:
        calibration = replace(calibration, quality={**calibration.quality, **check.figures()})
    return list(findings(calibration, limits))


def row(finding: Finding) -> dict[str, Any]:
    """A line of the table; `values` has a text for each channel."""
    return {
        "name": finding.name,
        "label": finding.criterion.label,
        "values": list(value_texts(finding)),
        "limit": limit_text(finding),
        "verdict": finding.verdict,
    }


def verdict(judged: Sequence[Finding]) -> Outcome | None:
    """How many limits are kept; None if there are none."""
    if not judged:
        return None
    verdicts = [each.verdict for each in judged]
    kept, count = verdicts.count("pass"), len(judged)
    if kept == count:
        many = f"All {count} limits of the client are kept."
        return Outcome(many if count > 1 else "The client's one limit is kept.", True)
    missed, open_ = verdicts.count("fail"), verdicts.count("not shown")
    parts = [f"{kept} kept", f"{missed} missed", f"{open_} not shown"]
    shown = [part for part in parts if not part.startswith("0 ")]
    limits = "limits" if count > 1 else "limit"
    return Outcome(f"Of {count} {limits} of the client: {', '.join(shown)}.", False)


def limit_text(finding: Finding) -> str:
    """The limit in words."""
    return f"{SIDES[finding.criterion.side]}{_quantity(finding, finding.limit)}"


def value_texts(finding: Finding) -> Iterator[str]:
    """Each value with its 95 % interval."""
    if finding.value is None:
        yield "not measured"
        return
    interval = finding.interval()
    for i, value in enumerate(finding.value):
        channel = f"{PRIMARIES[i]} " if len(finding.value) == len(PRIMARIES) else ""
        yield f"{channel}{_quantity(finding, float(value))}{_range(finding, interval, i)}"


def _range(finding: Finding, interval: tuple[Array, Array] | None, i: int) -> str:
    if interval is None:
        return ""
    low, high = (_quantity(finding, float(end[i])) for end in interval)
    return f" ({low} to {high})" if np.isfinite(interval[0][i]) else " (interval not known)"


def _quantity(finding: Finding, value: float) -> str:
    digits = OF_DIFFERENCE if finding.criterion.side == "within" else DIGITS
    return quantity_text(finding.name, value, finding.criterion.unit, digits)
