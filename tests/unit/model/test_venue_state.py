"""Venue states: input checks, and access by name."""

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
    with pytest.raises(InputError, match="its name needs letters, digits"):
        VenueState(name, FEEDBACK, np.ones(3))


def test_one_ratio_per_colour() -> None:
    with pytest.raises(
        ShapeError, match=r"scatter_ratio of full has shape \(2,\); it needs \(3,\)"
    ):
        VenueState("full", FEEDBACK, np.ones(2))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_ratio_is_positive(bad: float) -> None:
    with pytest.raises(InputError, match=r"scatter_ratio of venue state full is .*above 0"):
        VenueState("full", FEEDBACK, np.array([1.0, bad, 1.0]))


@pytest.mark.parametrize("bad", [-0.1, np.nan])
def test_light_is_not_negative(bad: float) -> None:
    ambient = np.zeros((4, 4, 3), np.float32)
    ambient[1, 2, 0] = bad
    with pytest.raises(
        InputError, match="ambient of venue state full contains negative light or NaN"
    ):
        VenueState("full", FEEDBACK, np.ones(3), ambient)


def test_the_error_of_an_unknown_state_lists_the_measured_ones(calibration: Calibration) -> None:
    states = {n: VenueState(n, FEEDBACK, np.ones(3)) for n in ("full", "school")}
    known = replace(calibration, states=states)
    assert known.state("school").name == "school"
    with pytest.raises(InputError) as caught:
        known.state("fuller")
    assert str(caught.value) == (
        "venue state 'fuller' was not measured (measured states: full, school); run "
        "`procam state VENUE fuller`"
    )


def test_a_calibration_without_states(calibration: Calibration) -> None:
    with pytest.raises(InputError, match=r"'full' was not measured \(measured states: none\)"):
        calibration.state("full")
