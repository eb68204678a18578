"""Albedo of the floor, in traced rooms."""

from dataclasses import replace

import numpy as np
import pytest
from traced_rooms import INSIDE, TracedRoom, parts

from procam.errors import OutOfModelRange
from procam.estimate.light import floor_albedo
from procam.estimate.light.floor_albedo import (
    FloorAt,
    FloorLight,
    _weighted,
    combined_floor_albedo,
    floor_notes,
    flux_notes,
    measure_floor,
)
from procam.estimate.light.model_room import below_rim
from procam.model.screen import Dome

TILT = np.radians(10.0)


def _at(albedo: float, sigma: float) -> FloorLight:
    """A floor measured at one depth."""
    return FloorLight([FloorAt(albedo=albedo, sigma=sigma)], 0.0)


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
    # seats and steps are no level floor
    assert 0.15 * max(floor.albedo, 0.1) <= floor.sigma < 0.16
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


def test_dim_pictures_count_less(furnished: TracedRoom, rng: np.random.Generator) -> None:
    """With the same noise in each, a picture a twentieth as bright has hardly any weight."""
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()]
    dim = [replace(x, scattered=x.scattered / 20, direct=x.direct / 20) for x in found]
    noise = 0.02 * np.nanmean([x.scattered for x in found])
    noisy = [
        replace(x, scattered=x.scattered + rng.normal(0, noise, (INSIDE.size, 1))) for x in dim
    ]
    dome = Dome(6.0, np.pi / 2, TILT, 0.1, 0.05)
    bright, both = (measure_floor(x, per_flux, white, dome, 0.5) for x in (found, found + noisy))
    for one, other in zip(bright.depths, both.depths, strict=True):
        assert other.albedo == pytest.approx(one.albedo, rel=0.02)


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
    for one, two in zip(once.depths, twice.depths, strict=True):
        assert two.albedo == pytest.approx(one.albedo, rel=1e-6)
        assert two.sigma == pytest.approx(one.sigma * np.sqrt((n - 1) / (2 * n - 1)), rel=0.05)


def test_known_and_measured_floor_are_weighted_by_their_sigmas() -> None:
    dome = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03)
    assert combined_floor_albedo(dome, _at(0.2, np.inf)) == pytest.approx((0.10, 0.03))
    assert combined_floor_albedo(dome, _at(0.12, 0.03)) == pytest.approx((0.11, 0.03 / np.sqrt(2)))


def test_a_discrepancy_widens_the_error() -> None:
    dome, found = Dome(6.0, np.pi / 2, 0.0, 0.10, 0.03), _at(0.28, 0.03)
    value, sigma = combined_floor_albedo(dome, found)
    assert value == pytest.approx(0.19)
    assert sigma == pytest.approx(0.18 / np.sqrt(2) / np.sqrt(2))
    (note,) = floor_notes(dome, found)
    assert "floor_albedo is 0.1 +- 0.03 in venue.toml, but 0.28 +- 0.03" in str(note)
    assert not floor_notes(dome, _at(0.12, 0.03))


def test_a_floor_stated_without_an_error_is_not_taken_for_certain() -> None:
    """Half of the difference: either may be wrong."""
    value, sigma = combined_floor_albedo(Dome(6.0, np.pi / 2, 0.0, 0.0, 0.0), _at(0.3, 0.05))
    assert value == pytest.approx(0.15, abs=0.01)
    assert sigma == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize(("share", "named"), [(0.03, False), (0.1, True)])
def test_light_that_contradicts_itself_is_noted(share: float, named: bool) -> None:
    notes = flux_notes(FloorLight([FloorAt(albedo=0.1, sigma=0.03)], share))
    assert len(notes) == named
    assert all("disagree by 10%" in str(note) and "check vignetting" in str(note) for note in notes)


def test_light_that_cannot_be_of_these_pictures_is_refused() -> None:
    assert len(flux_notes(FloorLight([FloorAt(albedo=0.1, sigma=0.03)], 0.45))) == 1
    with pytest.raises(OutOfModelRange, match=r"disagree by 141%, more than 50%: .+ mirrored"):
        flux_notes(FloorLight([FloorAt(albedo=0.1, sigma=0.03)], 1.41))


def test_a_venue_toml_that_only_a_low_floor_would_explain_is_named_and_widens() -> None:
    """The floor may as well lie at the rim, with a wrong value in venue.toml."""
    dome = Dome(6.0, np.pi / 2, 0.0, 0.4, 0.03)
    at_rim = FloorAt(albedo=0.12, sigma=0.02, weight=0.0)
    found = FloorLight([at_rim, FloorAt(albedo=0.4, sigma=0.05, share=0.7)], 0.0)
    value, sigma = combined_floor_albedo(dome, found)
    assert value == pytest.approx(0.28)
    assert value - 2 * sigma < 0.12
    (note,) = floor_notes(dome, found)
    assert "agrees with if the floor lies well below the dome's rim" in str(note)
    assert "if it does not, it is 0.12 +- 0.02" in str(note)


def test_a_floor_that_may_be_lower_widens_what_it_returns() -> None:
    """Half the weight on a depth that returns less, below a wall that returns some: mean and spread."""
    dome = Dome(6.0, np.pi / 2, 0.0, 0.2, 1e-3)
    lower = FloorAt(albedo=0.2, sigma=0.05, share=0.5, wall=0.02, weight=0.5)
    depths = [FloorAt(albedo=0.2, sigma=0.05, weight=0.5), lower]
    value, sigma = combined_floor_albedo(dome, FloorLight(depths, 0.0))
    assert value == pytest.approx((0.2 + 0.12) / 2, rel=1e-3)
    assert sigma == pytest.approx((0.2 - 0.12) / 2, rel=1e-2)


def test_depths_weigh_by_their_agreement_with_venue_toml(furnished: TracedRoom) -> None:
    """The room's floor of 0.3 is in the rim's plane: an owner who says so rules the lowest out."""
    per_flux, white = furnished.known()
    found = [furnished.scatter_sample(lit, 0.0) for lit in parts()]
    floor = measure_floor(found, per_flux, white, Dome(6.0, np.pi / 2, TILT, 0.3, 0.03), 0.5)
    shares, albedos, weights = np.array([(x.share, x.albedo, x.weight) for x in floor.depths]).T
    assert weights.sum() == pytest.approx(1.0)
    assert shares[0] == 1.0 and (np.diff(shares[::2]) < 0).all()
    assert (np.diff(albedos[::2]) >= 0).all()
    assert weights[:3].sum() > 0.95 and weights[-1] < 1e-3


@pytest.mark.parametrize("drop_m", [1.2, 2.1])
def test_a_low_floor_returns_what_the_wall_above_it_does_too(drop_m: float) -> None:
    """A floor of 0.1 and a wall of 0.25, and an owner who knows the floor alone."""
    room = TracedRoom(0.1, deck_drop_m=drop_m, wall_albedo=0.25, tilt_deg=0.0)
    per_flux, white = room.known()
    dome = Dome(6.0, np.pi / 2, 0.0, 0.1, 0.03)
    floor = measure_floor(
        [room.scatter_sample(x, 0.0) for x in parts()], per_flux, white, dome, 0.5
    )
    value, sigma = combined_floor_albedo(dome, floor)
    below, at_rim = below_rim(dome, drop_m / 6), below_rim(dome, 0.0)
    returned = (0.1 * below.by_floor + 0.25 * below.by_wall).sum() / at_rim.by_floor.sum()
    assert abs(value - returned) < 2 * sigma < 0.05
    assert floor.depths[0].weight < 0.1


def test_depths_weigh_by_how_well_they_fit_the_pictures() -> None:
    """Of two depths that agree with venue.toml, one that leaves a tenth more of 4 pictures."""
    dome = Dome(6.0, np.pi / 2, 0.0, 0.2, 0.03)
    each = [FloorAt(albedo=0.2, sigma=0.05, misfit=misfit) for misfit in (0.8, 0.88)]
    first, second = _weighted(dome, each, 4)
    assert first.weight / second.weight == pytest.approx(1.1 ** (5 * 4 / 2))
