"""The examples that come with procam are those that the simulator writes."""

from importlib import resources

import pytest

from simulators.template import example_text

VENUES = resources.files("calib_data") / "venues"
SIMULATED = sorted(v.name for v in VENUES.iterdir() if v.name.startswith("simulated-"))


@pytest.mark.parametrize("name", SIMULATED)
def test_examples_are_up_to_date(name: str) -> None:
    stored = (VENUES / name / "venue.toml").read_text("utf-8")
    assert stored == example_text(name.removeprefix("simulated-"))
