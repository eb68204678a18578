"""Figures and their goals."""

import json

import pytest

from procam.model.quality import Figure, Goal


@pytest.mark.parametrize(
    ("value", "goal", "passed"),
    [
        (0.5, Goal("<=", 0.5), True),
        (0.51, Goal("<=", 0.5), False),
        (0.5, Goal(">=", 0.5), True),
        (0.49, Goal(">=", 0.5), False),
        (True, Goal("==", True), True),
        (False, Goal("==", True), False),
        (3.0, None, None),
        ([1.0, 2.0], Goal("<=", 5.0), None),
    ],
)
def test_passed(value: float, goal: Goal | None, passed: bool | None) -> None:
    assert Figure(value, "-", goal).passed is passed


@pytest.mark.parametrize("op", ["<=", ">=", "=="])
def test_nan_never_passes(op: str) -> None:
    assert Figure(float("nan"), "-", Goal(op, 1.0)).passed is False
    assert Figure(float("nan"), "-", Goal(op, float("nan"))).passed is False


def test_as_dict_is_what_summary_json_carries() -> None:
    figure = Figure(0.3, "arcmin", Goal("<=", 0.5), 12, "mean angle")
    assert json.loads(json.dumps(figure.as_dict())) == {
        "value": 0.3,
        "unit": "arcmin",
        "goal": {"op": "<=", "value": 0.5},
        "pass": True,
        "samples": 12,
        "note": "mean angle",
        "sigma": None,
    }
    assert Figure(1.0, "-").as_dict()["goal"] is None
