"""Scattered light between the cells of a room's canvas."""

import numpy as np
import pytest

from procam.compensate.room import RoomCompensator
from procam.estimate.closed_loop.screen_scatter import RoomCells
from procam.model.screen import RoomScreen

SIZE, ALBEDO = 64, 0.5
FACTOR = np.array([1.0, 1.1, 0.9])


@pytest.fixture(scope="module")
def cells() -> RoomCells:
    screen = RoomScreen("box", (6.0, 5.0, 3.0), ("left", "front", "right", "floor"))
    screen = screen.with_others((("back", 0.2, 0.1), ("ceiling", 0.3, 0.1)))
    lit = np.full((len(screen.room.faces), 3), ALBEDO)
    paint = np.full((*screen.canvas.shape(SIZE), 3), ALBEDO, np.float32)
    return RoomCells(screen, SIZE, paint, screen.face_albedo(lit))


def _light(cells: RoomCells, seed: int) -> np.ndarray:
    count = int(cells.screen.canvas.raster(SIZE).lit.sum())
    return np.random.default_rng(seed).uniform(-0.1, 0.2, (count, 3))


def test_it_is_the_scattered_light_of_the_compensator(cells: RoomCells) -> None:
    raster, direct = cells.screen.canvas.raster(SIZE), np.abs(_light(cells, 1))
    picture = np.zeros((*raster.face.shape, 3), np.float32)
    picture[raster.lit] = direct
    room = RoomCompensator(raster, cells.screen.factors, cells.albedo)
    seen = room.none(picture).observed[raster.lit]
    np.testing.assert_allclose(cells.of(direct), seen - direct, atol=2e-4)


def test_what_is_removed_changes_the_total_as_asked(cells: RoomCells) -> None:
    change = _light(cells, 2)
    free = np.random.default_rng(3).random(change.shape) < 0.7
    found = cells.removed(change, free, FACTOR)
    total = found + FACTOR * cells.of(found)
    np.testing.assert_allclose(total[free], change[free], atol=2e-4)
    assert (found[~free] == 0).all()


def test_limits_hold_and_the_rest_is_as_asked(cells: RoomCells) -> None:
    change = _light(cells, 4)
    down, up = (np.abs(_light(cells, seed)) for seed in (5, 6))
    found = cells.limited(change, down, up, FACTOR)
    assert (found >= -down).all() and (found <= up).all()
    missed = change - found - FACTOR * cells.of(found)
    inside = (found > -down + 1e-6) & (found < up - 1e-6)
    assert inside.mean() > 0.2
    np.testing.assert_allclose(missed[inside], 0, atol=3e-4)
    assert missed[found >= up].min() > -3e-4
    assert missed[found <= -down].max() < 3e-4
