"""States of the house: what they refuse, and how they are looked up."""

from dataclasses import replace

import numpy as np
import pytest

from procam.errors import InputError, ShapeError
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.model.venue_state import VenueState

FEEDBACK = Measured(np.full(3, 0.3), np.full(3, 0.002))


@pytest.mark.parametrize("name", ["", "a b", "../up", "-x", "full\n"])
def test_a_name_that_is_no_file_name_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"house state: got the name .*expected letters, digits"):
        VenueState(name, FEEDBACK, np.ones(3))


def test_one_ratio_per_colour() -> None:
    with pytest.raises(
        ShapeError, match=r"scatter_ratio of full has shape \(2,\); it needs \(3,\)"
    ):
        VenueState("full", FEEDBACK, np.ones(2))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_ratio_is_more_than_nothing(bad: float) -> None:
    with pytest.raises(InputError, match=r"scatter_ratio of house state full: .*more than 0"):
        VenueState("full", FEEDBACK, np.array([1.0, bad, 1.0]))


@pytest.mark.parametrize("bad", [-0.1, np.nan])
def test_light_is_not_negative(bad: float) -> None:
    ambient = np.zeros((4, 4, 3), np.float32)
    ambient[1, 2, 0] = bad
    with pytest.raises(InputError, match="ambient of house state full: got light below 0 or NaN"):
        VenueState("full", FEEDBACK, np.ones(3), ambient)


def test_an_unknown_state_is_told_those_there_are(calibration: Calibration) -> None:
    states = {n: VenueState(n, FEEDBACK, np.ones(3)) for n in ("full", "school")}
    known = replace(calibration, states=states)
    assert known.state("school").name == "school"
    with pytest.raises(InputError) as caught:
        known.state("fuller")
    assert str(caught.value) == (
        "house state: got 'fuller', expected one of full, school; `procam state VENUE fuller` "
        "measures it"
    )


def test_without_any_state_there_is_none_to_choose(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="got 'full', expected none; `procam state VENUE full`"):
        calibration.state("full")
