"""A projector that shows its pictures mirrored, found by what a camera sees of them."""

import numpy as np
import pytest

from procam.estimate.light.mirrored import found_flip


def picture(rng: np.random.Generator) -> np.ndarray:
    """A picture without symmetry: tiles of random levels."""
    return np.kron(rng.random((6, 8)), np.ones((20, 20))).astype(np.float32)


def seen(shown: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Shares of white (n,) at panel pixels (n, 2), with noise and scattered light."""
    height, width = shown.shape
    at = rng.uniform([0, 0], [width - 1, height - 1], (4000, 2))
    light = shown[tuple(np.rint(at[:, ::-1]).astype(int).T)] ** 2.2
    return 0.1 + 0.9 * light + 0.05 * rng.normal(size=len(at)), at


def test_flips_are_named(rng: np.random.Generator) -> None:
    drawn = picture(rng)
    for shown, what in (
        (drawn, ""),
        (drawn[:, ::-1], "mirrored"),
        (drawn[::-1], "upside down"),
        (drawn[::-1, ::-1], "upside down and mirrored"),
    ):
        share, at = seen(shown, rng)
        assert found_flip(share, drawn, at) == what


def test_what_is_its_own_mirror_image_is_none(rng: np.random.Generator) -> None:
    half = picture(rng)
    both = np.concatenate([half, half[:, ::-1]], axis=1)
    share, at = seen(both[:, ::-1], rng)
    assert found_flip(share, both, at) == ""


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_uniform_pictures_show_nothing(rng: np.random.Generator, level: float) -> None:
    uniform = np.full((120, 160), level, np.float32)
    share, at = seen(uniform, rng)
    assert found_flip(share, uniform, at) == ""
    assert found_flip(np.full(len(at), np.nan), picture(rng), at) == ""
