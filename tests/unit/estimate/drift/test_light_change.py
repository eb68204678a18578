"""Light of windows: what moved flux does to it, and what the screen and lamps each account for."""

import numpy as np
import pytest

from procam.arrays import Array
from procam.estimate.drift.displacement import Motion, grid_places
from procam.estimate.drift.dome_change import Dust, Spot, find_dome_change
from procam.estimate.drift.light_change import WindowLight, moved_flux
from procam.maths.geometry.sphere import normalise

SHAPE = 60, 96


def flux(place: Array) -> Array:
    """Light times area of a panel, smooth."""
    x, y = place[..., 0] / 48 - 1, place[..., 1] / 30 - 1
    return np.asarray(np.exp(0.3 - 0.4 * x * x - 0.2 * y * y + 0.1 * x))


@pytest.mark.parametrize(
    ("terms", "bound"),
    [([0.05, 0, 0, -0.03, 0, 0, 0, 0], 1e-3), ([0, 0.02, 0, 0, 0, 0.02, 0, 0], 1e-3)],
)
def test_flux_that_moved_is_conserved(terms: list[float], bound: float) -> None:
    """A pixel's flux lands elsewhere on another area: the density there is the flux over it."""
    motion = Motion(SHAPE, np.array(terms), np.zeros((8, 8)))
    grid = grid_places(SHAPE)
    back = grid
    for _ in range(20):
        back = grid - motion.at(back)
    stretch = (1 + terms[1]) * (1 + terms[5])
    expected = np.log(flux(back) / stretch / flux(grid))
    found = moved_flux(flux(grid).astype(np.float32), motion)
    inner = np.s_[8:-8, 8:-8]
    assert np.abs(found - expected)[inner].max() < 5 * bound


def windows(rng: np.random.Generator, middle: float, change: Array | None = None) -> Array:
    """Directions (n, 3) of the windows of a projector that lights the dome about an azimuth."""
    azimuth = np.radians(middle + np.linspace(-45, 45, 16))
    elevation = np.radians(np.linspace(10, 75, 10))
    a, e = (grid.ravel() for grid in np.meshgrid(azimuth, elevation))
    return normalise(np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)], axis=1))


def seen(rng: np.random.Generator, albedo, lamps: dict[float, float]) -> dict[str, WindowLight]:
    """Light of projectors at azimuths [deg] with lamps of a given log change."""
    found = {}
    for middle, level in lamps.items():
        where = windows(rng, middle)
        log = level + albedo(where) + rng.normal(0, 1e-3, len(where))
        found[f"at{middle:g}"] = WindowLight(
            where, np.repeat(log[:, None], 3, 1), np.zeros(len(where))
        )
    return found


def clean(where: Array) -> Array:
    return np.zeros(len(where))


def dusty(where: Array) -> Array:
    return np.asarray(np.log(1 - 0.1 * (1 + where[:, 0]) / 2))


SPOT = Spot(0.25, 0.0, normalise(np.array([0.6, 0.5, 0.6])), np.radians(8.0))
LAMPS = {0.0: 0.0, 90.0: -0.2, 180.0: 0.1, 270.0: 0.0}


def test_lamps_are_no_dust(rng: np.random.Generator) -> None:
    found = find_dome_change(seen(rng, clean, LAMPS))
    assert found.dust is None and found.stain is None


def test_dust_whatever_the_lamps_do(rng: np.random.Generator) -> None:
    found = find_dome_change(seen(rng, dusty, LAMPS)).dust
    assert isinstance(found, Dust)
    where = np.concatenate([windows(rng, middle) for middle in LAMPS])
    true = 1 - np.exp(dusty(where).min() - dusty(where).max())
    assert found.loss == pytest.approx(true, abs=4 * found.sigma + 1e-3)
    assert found.direction[0] > 0.9
    away = found.log_albedo(where) - (dusty(where) - dusty(where).max())
    assert np.abs(away).max() < 4e-3


def averaged(where: Array) -> Array:
    """The spot as windows see it: a mean over their area, 6 by 7 degrees."""
    azimuth, elevation = np.arctan2(where[:, 1], where[:, 0]), np.arcsin(where[:, 2])
    parts = []
    for across in np.radians(np.linspace(-2.5, 2.5, 6)):
        for up in np.radians(np.linspace(-3.0, 3.0, 6)):
            a, e = azimuth + across / np.cos(elevation), elevation + up
            near = np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)], axis=1)
            parts.append(np.exp(SPOT.log_albedo(near)))
    return np.asarray(np.log(np.mean(parts, axis=0)))


def test_a_stain_whatever_the_lamps_do(rng: np.random.Generator) -> None:
    found = find_dome_change(seen(rng, averaged, LAMPS))
    assert found.dust is None and found.stain is not None
    assert found.stain.loss == pytest.approx(0.25, abs=0.01)
    assert float(found.stain.direction @ SPOT.direction) > np.cos(np.radians(1.0))
    assert np.degrees(found.stain.width) == pytest.approx(8.0, rel=0.1)


def test_what_scatter_leaves_is_no_dust(rng: np.random.Generator) -> None:
    def little(where: Array) -> Array:
        return np.asarray(0.01 * where[:, 0])

    light = seen(rng, little, LAMPS)
    assert find_dome_change(light).dust is not None
    assert find_dome_change(light, change_of_scatter=0.4).dust is None


def test_too_few_windows_say_nothing(rng: np.random.Generator) -> None:
    nothing = WindowLight(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    assert find_dome_change({"a": nothing}).dust is None
    assert np.isnan(nothing.level()[0]).all()


def test_scattered_light_is_taken_out(rng: np.random.Generator) -> None:
    where = windows(rng, 0.0)
    share, ratio = np.full(len(where), 0.25), np.array([1.0, 1.2, 0.8])
    log = np.log(0.75 + 0.25 * ratio) * np.ones((len(where), 3))
    light = WindowLight(where, log, share).without_scatter(ratio)
    assert np.abs(light.log_ratio).max() < 1e-12
    level, sigma = light.level()
    assert np.allclose(level, 0) and (sigma > 0).all()
