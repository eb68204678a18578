"""Figures as rows of the history: those of a run, and those that a calibration's document has."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from procam.files.history.store import storable

CHANNELS = "RGB"
# name, value, sigma, unit, op, goal, passed
Row = tuple[str, float | None, float | None, str, str | None, float | None, int | None]


def calibration_figures(path: Path) -> tuple[str, list[Row]]:
    """The session of a calibration.json, and rows of its light and its quality.

    Nothing of a document that is damaged, which whoever loads it refuses.
    """
    try:
        document = json.loads(path.read_bytes())
        rows = list(_of_document(document))
        return storable(document["provenance"].get("session", "")), rows
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        return "", []


def _of_document(document: dict[str, Any]) -> Iterator[Row]:
    for name in ("feedback", "albedo"):
        yield from figure_rows(name, {**document[name], "unit": "-"})
    # white in the camera's own unit follows the lamps; in content's unit it is 1 by definition
    white = np.linalg.inv(np.array(document["content_from_camera"], float)).sum(axis=1)
    yield from figure_rows("white_in_camera", {"value": white.tolist(), "unit": "1/s"})
    for name, state in document.get("states", {}).items():
        yield from figure_rows(f"feedback.{name}", {**state["feedback"], "unit": "-"})
    for name, entry in document["quality"].items():
        yield from figure_rows(name, entry)


def figure_rows(name: str, entry: dict[str, Any]) -> Iterator[Row]:
    """Rows of a figure as JSON has it: one of a number or a verdict, of a list one for each number.

    Lists of three are of red, green and blue: "albedo.R"; others are numbered: "residual.0".
    """
    value, sigma, goal = entry["value"], entry.get("sigma"), entry.get("goal") or {}
    passed = entry.get("pass")
    name, op = storable(name), goal.get("op")
    rest = (
        storable(entry["unit"]),
        None if op is None else storable(op),
        _number(goal.get("value")),
        None if passed is None else int(bool(passed)),
    )
    if not isinstance(value, list):
        yield name, _number(value), _number(sigma), *rest
        return
    parts = CHANNELS if len(value) == len(CHANNELS) else range(len(value))
    sigmas = sigma if isinstance(sigma, list) else [sigma] * len(value)
    for part, each, error in zip(parts, value, sigmas, strict=True):
        yield f"{name}.{part}", _number(each), _number(error), *rest


def _number(value: Any) -> float | None:
    """A number or a verdict as SQLite stores it; NaN and infinity as none."""
    return float(value) if value is not None and math.isfinite(value) else None
