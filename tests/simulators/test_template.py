"""The examples that come with procam are those that the simulator writes."""

import tomllib
from importlib import resources
from pathlib import Path

import pytest

from simulators.backend import read_settings
from simulators.scene import SceneSize
from simulators.template import example_text, room_text, server_text, venue_text

VENUES = resources.files("calib_data") / "venues"
SIMULATED = sorted(v.name for v in VENUES.iterdir() if v.name.startswith("simulated-"))


@pytest.mark.parametrize("name", SIMULATED)
def test_examples_are_up_to_date(name: str) -> None:
    stored = (VENUES / name / "venue.toml").read_text("utf-8")
    assert stored == example_text(name.removeprefix("simulated-"))


def test_the_size_of_maps_is_of_the_screen(tmp_path: Path) -> None:
    size = SceneSize(map_size=128)
    for text in (venue_text("standard", size), room_text(1, size), server_text(size)):
        tables = tomllib.loads(text)
        assert tables["screen"]["map_size"] == 128
        read_settings(tables["simulated"], tmp_path)
