"""Blacks that no photograph shows alone, against constructed ones."""

import numpy as np
import pytest

from procam.estimate.light.separation import SeparatedLight
from procam.estimate.light.shared_black import fit_shared_black
from procam.maths.geometry.sphere import master_directions

SIZE = 96
BLACK = {"south": 6e-4, "north": 9e-4}  # of white


def pictures() -> dict[str, SeparatedLight]:
    """Two pictures that overlap, darker towards their corners, on a dome with scattered light."""
    y, x = np.mgrid[:SIZE, :SIZE] / (SIZE - 1)
    lights = {}
    for name, middle in (("south", 0.38), ("north", 0.62)):
        inside = (np.abs(x - middle) < 0.3) & (np.abs(y - 0.5) < 0.35)
        falloff = 1 - 0.8 * ((x - middle) ** 2 + (y - 0.5) ** 2)
        direct = np.where(inside, falloff, 0)[..., None] * np.array([1.0, 0.9, 0.8])
        scattered = np.full_like(direct, 0.15)
        image, veil = direct.astype(np.float32), scattered.astype(np.float32)
        lights[name] = SeparatedLight(image, veil, np.ones(3), inside)
    return lights


def dark(lights: dict[str, SeparatedLight], uniform: bool, room: float) -> np.ndarray:
    """Radiance of all blacks and of the room, which is brighter on one side."""
    total = np.zeros((SIZE, SIZE, 3))
    for name, light in lights.items():
        white = light.direct + light.scattered
        black = light.lit[..., None] * light.direct[light.lit].mean(axis=0) + light.scattered
        total += BLACK[name] * (black if uniform else white)
    side = np.linspace(0.5, 1.5, SIZE)[:, None]
    return (total + room * side * np.ones((SIZE, SIZE))[..., None] if room else total).astype(
        np.float32
    )


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("room", [0.0, 3e-4, 3e-3])
def test_the_sum_is_within_its_error(uniform: bool, room: float) -> None:
    lights = pictures()
    direction, inside = master_directions(SIZE)
    found = fit_shared_black(
        dark(lights, uniform, room), lights, direction.astype(np.float32), inside
    )
    true = dark(lights, uniform, 0.0)[inside].mean(axis=0)
    assert np.all(np.abs(found.total - true) < 2 * found.sigma), (found.total / true, found.sigma)
    assert np.all(found.sigma < 0.6 * true)
    if not room:
        assert np.allclose(found.total, true, rtol=0.1)


def test_one_picture_that_covers_all_is_not_separated_from_the_room() -> None:
    everywhere = np.ones((SIZE, SIZE), bool)
    image = np.ones((SIZE, SIZE, 3), np.float32)
    light = SeparatedLight(image, 0 * image, np.ones(3), everywhere)
    direction, inside = master_directions(SIZE)
    found = fit_shared_black(2e-3 * image, {"south": light}, direction.astype(np.float32), inside)
    assert np.all(found.sigma > 0.3 * found.total)


def test_unknown_pixels_are_left_out() -> None:
    lights, (direction, inside) = pictures(), master_directions(SIZE)
    light = dark(lights, uniform=False, room=0.0)
    whole = fit_shared_black(light, lights, direction.astype(np.float32), inside)
    light[40:44, 40:44] = np.nan
    found = fit_shared_black(light, lights, direction.astype(np.float32), inside)
    assert np.allclose(found.total, whole.total, rtol=0.02)
