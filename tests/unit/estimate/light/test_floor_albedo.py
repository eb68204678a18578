"""Albedo of the floor, in traced rooms."""

from dataclasses import replace

import numpy as np
import pytest
from traced_rooms import TracedRoom, parts

from procam.estimate.light import floor_albedo
from procam.estimate.light.floor_albedo import (
    FloorLight,
    combined_floor_albedo,
    discrepancy,
    floor_notes,
    measure_floor,
)
from procam.model.screen import Dome

TILT = np.radians(10.0)


@pytest.mark.parametrize("asked", [0.0, 0.3])
def test_floor_albedo_of_a_traced_room(
    asked: float, bare: TracedRoom, furnished: TracedRoom
) -> None:
    room = furnished if asked else bare
    per_flux, white = room.known()
    found = [room.scatter_sample(lit, 0.003) for lit in parts()]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    floor = measure_floor(found, per_flux, white, dome, 0.5)
    assert abs(floor.albedo - asked) < 2.5 * floor.sigma + 0.005
    assert 0.1 * floor.albedo <= floor.sigma < 0.04  # seats and steps are no level floor
    assert floor.flux_inconsistency < 0.02


def test_scales_of_pictures_do_not_count_for_the_floor(furnished: TracedRoom) -> None:
    """A projector that has drifted, or whose gloss hides light, gives the same floor."""
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()]
    drifted = [replace(x, scattered=x.scattered * (1 + 0.1 * i)) for i, x in enumerate(found)]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    first, second = (measure_floor(x, per_flux, white, dome, 0.5) for x in (found, drifted))
    assert second.albedo == pytest.approx(first.albedo, rel=0.02)
    assert second.flux_inconsistency == pytest.approx(np.std(0.1 * np.arange(8)), rel=0.1)


def test_the_floors_error_is_that_of_a_mean_of_pictures(
    furnished: TracedRoom, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of n pictures it is a standard deviation over sqrt(n - 1); twice the same ones are 2 n."""
    monkeypatch.setattr(floor_albedo, "MODEL_SIGMA", 0.0)
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.003) for lit in parts()[::2]]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    once, twice = (measure_floor(x, per_flux, white, dome, 0.5) for x in (found, found + found))
    n = len(found)
    assert twice.albedo == pytest.approx(once.albedo, rel=1e-6)
    assert twice.sigma == pytest.approx(once.sigma * np.sqrt((n - 1) / (2 * n - 1)), rel=0.05)


def test_known_and_measured_floor_are_weighted_by_their_sigmas() -> None:
    dome = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03)
    assert combined_floor_albedo(dome, FloorLight(0.2, np.inf, 0.0)) == pytest.approx((0.10, 0.03))
    assert combined_floor_albedo(dome, FloorLight(0.12, 0.03, 0.0)) == pytest.approx(
        (0.11, 0.03 / np.sqrt(2))
    )


def test_a_discrepancy_widens_the_error() -> None:
    dome, found = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03), FloorLight(0.28, 0.03, 0.0)
    value, sigma = combined_floor_albedo(dome, found)
    assert value == pytest.approx(0.19)
    assert sigma == pytest.approx(0.18 / np.sqrt(2) / np.sqrt(2))
    assert discrepancy(dome, found) == pytest.approx(0.18 / 0.03 / np.sqrt(2))
    (note,) = floor_notes(dome, found)
    assert "floor_albedo is 0.1 +- 0.03 in venue.toml, but 0.28 +- 0.03" in note
    assert not floor_notes(dome, FloorLight(0.12, 0.03, 0.0))
