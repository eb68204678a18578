"""Textures that are moved and blurred by known amounts."""

import numpy as np
import pytest

from procam.arrays import Array, Image
from procam.estimate.drift.coarse_windows import find_windows
from procam.estimate.drift.displacement import (
    Motion,
    Windows,
    fit_motion,
    follow,
    grid_places,
    unmoved,
)
from procam.maths.warp import blur, sample

SHAPE = 120, 200


def tiles(rng: np.random.Generator) -> Image:
    """Shuffled tiles of 12 px, a little soft."""
    small = rng.random((SHAPE[0] // 12 + 3, SHAPE[1] // 12 + 3))
    return blur(np.kron(small, np.ones((12, 12))).astype(np.float32), 1.0)


def scene(rng: np.random.Generator, terms: Array, soft: float = 0.0) -> tuple[Image, Image, Motion]:
    """A texture before; a picture in which it is found at `motion`; and that motion."""
    wide = tiles(rng)
    motion = Motion(SHAPE, terms, np.zeros((8, 8)))
    grid = grid_places(SHAPE) + 12.0
    before = sample(wide, grid)
    back = grid
    for _ in range(20):  # the place whose picture lands here
        back = grid - motion.at(back - 12.0)
    today = sample(blur(wide, soft) if soft else wide, back)
    return before, today, motion


def seen(today: Image, rng: np.random.Generator, noise: float = 0.003) -> Image:
    return (today + rng.normal(0, noise, today.shape)).astype(np.float32)


def sampler(today: Image):
    return lambda place: sample(today, place, float("nan"))


@pytest.mark.parametrize(
    "terms",
    [
        [0.02, 0, 0, -0.013, 0, 0, 0, 0],  # a shift of 2 and 1.3 px
        [0.001, 0.01, 0, 0.002, 0, 0.01, 0, 0],  # zoom
        [0, 0, -0.004, 0, 0.004, 0, 0, 0],  # rotation
        [0.01, 0, 0, 0, 0, 0, 0.01, -0.008],  # keystone
    ],
)
def test_follows_a_projective_motion(terms: list[float], rng: np.random.Generator) -> None:
    before, today, motion = scene(rng, np.array(terms))
    turned, windows = find_windows(before, seen(today, rng))
    assert turned == "as it was" and windows is not None
    found, _ = follow(before, sampler(seen(today, rng)), fit_motion(windows, SHAPE))
    inner = grid_places(SHAPE)[20:-20, 20:-20].reshape(-1, 2)
    assert (
        np.abs(found.at(inner) - motion.at(inner)).max() < 0.04
    )  # grid px: motion varies in a window
    length, sigma = found.rms(inner)
    true = float(np.sqrt(np.mean(np.sum(motion.at(inner) ** 2, axis=-1))))
    assert abs(length - true) < max(4 * sigma, 0.01)


def test_no_motion_is_within_its_sigma(rng: np.random.Generator) -> None:
    before, today, _ = scene(rng, np.zeros(8))
    places = grid_places(SHAPE).reshape(-1, 2)
    sizes = [
        follow(seen(before, rng), sampler(seen(today, rng)), unmoved(SHAPE))[0].rms(places)
        for _ in range(8)
    ]
    assert all(length < 4 * sigma + 1e-3 for length, sigma in sizes)
    assert max(length for length, _ in sizes) < 0.02


@pytest.mark.parametrize("sigma", [0.0, 1.2, 2.5])
def test_blur(sigma: float, rng: np.random.Generator) -> None:
    before, today, _ = scene(rng, np.array([0.02, 0, 0, 0.01, 0, 0, 0, 0]), sigma)
    _, windows = follow(seen(before, rng), sampler(seen(today, rng)), unmoved(SHAPE))
    assert float(np.median(windows.blur2)) == pytest.approx(sigma**2, rel=0.05, abs=0.1)


def test_noise_is_no_blur(rng: np.random.Generator) -> None:
    before, today, _ = scene(rng, np.zeros(8))
    found = [
        np.median(
            follow(seen(before, rng, 0.03), sampler(seen(today, rng, 0.03)), unmoved(SHAPE))[
                1
            ].blur2
        )
        for _ in range(4)
    ]
    assert abs(float(np.mean(found))) < 0.05


def test_noise_is_no_motion(rng: np.random.Generator) -> None:
    """Of motions that are noise alone, the mean square less what noise adds is 0."""
    covariance = np.diag(np.full(8, 1e-8))
    places = grid_places(SHAPE)[::7, ::7].reshape(-1, 2)
    sizes = [Motion(SHAPE, rng.normal(0, 1e-4, 8), covariance).rms(places)[0] for _ in range(60)]
    assert 0.3 < np.mean([size == 0 for size in sizes]) < 0.8


@pytest.mark.parametrize(
    ("flip", "name"),
    [
        (np.s_[:, ::-1], "mirrored"),
        (np.s_[::-1], "upside down"),
        (np.s_[::-1, ::-1], "turned by 180 degrees"),
    ],
)
def test_flips_are_named(flip: tuple[slice, ...], name: str, rng: np.random.Generator) -> None:
    before, today, _ = scene(rng, np.zeros(8))
    assert find_windows(before, seen(today[flip], rng))[0] == name


def test_another_picture_is_not_found(rng: np.random.Generator) -> None:
    before, _, _ = scene(rng, np.zeros(8))
    other, _, _ = scene(np.random.default_rng(7), np.zeros(8))
    assert find_windows(before, other)[1] is None


def test_parts_that_are_found_elsewhere_do_not_count(rng: np.random.Generator) -> None:
    """A window whose picture left the grid is like another place by chance."""
    before, today, motion = scene(rng, np.array([-0.1, 0, 0, 0.05, 0, 0, 0, 0]))
    _, windows = find_windows(before, today)
    assert windows is not None and len(windows.place) > 10
    assert np.abs(windows.shift - motion.at(windows.place)).max() < 10
    found, _ = follow(before, sampler(today), fit_motion(windows, SHAPE))
    places = grid_places(SHAPE)[30:-30, 60:-30].reshape(-1, 2)
    assert np.abs(found.at(places) - motion.at(places)).max() < 0.2


def test_the_covariance_predicts_the_spread(rng: np.random.Generator) -> None:
    place = np.stack(np.meshgrid(np.linspace(10, 190, 8), np.linspace(10, 110, 5)), -1).reshape(
        -1, 2
    )
    fits = [
        fit_motion(
            Windows(place, rng.normal(0, 0.02, (40, 2)), np.full(40, 0.02), np.zeros(40)), SHAPE
        )
        for _ in range(200)
    ]
    spread = np.std([fit.terms for fit in fits], axis=0)
    predicted = np.sqrt(np.mean([np.diag(fit.covariance) for fit in fits], axis=0))
    assert np.allclose(spread, predicted, rtol=0.25)
