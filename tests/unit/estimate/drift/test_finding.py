"""Advice of findings."""

import pytest

from procam.estimate.drift.finding import advice_by_hand


@pytest.mark.parametrize(
    "advice",
    [
        "recalibrate it: procam recalibrate",
        "focus its lens, then recalibrate it",
        "recalibrate it; replace the lamp if it goes on",
        "set its gamma or picture mode as it was, or recalibrate it",
    ],
)
def test_by_hand_nothing_is_recalibrated_alone(advice: str) -> None:
    said = advice_by_hand(advice)
    assert "recalibrate" not in said and "calibrate again: procam session plan, add, solve" in said


def test_other_advice_stays() -> None:
    assert advice_by_hand("switch it off") == "switch it off"
