"""The model room against closed forms of form factors."""

from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.light.model_room import ModelRoom, below_rim
from procam.estimate.light.scatter_kernel import CELLS
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.screen import Dome

ON_CAP = master_directions(CELLS)[0][..., 2].ravel() >= 0
AREA = master_solid_angles(CELLS).ravel()[ON_CAP]


def returned(exchange: np.ndarray) -> float:
    """Share of the light of an evenly bright hemisphere that returns to it by one reflection."""
    return float(AREA @ exchange @ AREA / AREA.sum())


@pytest.mark.parametrize("drop", [0.1, 0.3, 0.5])
def test_floor_and_wall_return_what_form_factors_of_discs_say(drop: float) -> None:
    """Half of the light leaves through the opening; coaxial discs (Howell 2010, C-41) part it."""
    x = 2 + drop**2
    to_floor = (x - np.sqrt(x**2 - 4)) / 2
    to_wall = 1 - to_floor
    below = below_rim(Dome(6.0, np.pi / 2), drop)
    assert returned(below.by_floor) == pytest.approx(0.5 * to_floor**2, rel=0.06)
    assert returned(below.by_wall) == pytest.approx(0.5 * to_wall**2 / (2 * drop), rel=0.06)


def test_nothing_is_between_the_rim_and_a_floor_at_the_rim() -> None:
    below = below_rim(Dome(6.0, np.pi / 2), 0.0)
    assert returned(below.by_floor) == pytest.approx(0.5, rel=0.05)
    assert not below.by_wall.any()


def test_a_tilted_dome_has_a_level_floor() -> None:
    """Where the rim is lowest, in front, the floor is near and returns more."""
    below = below_rim(Dome(6.0, np.pi / 2, np.radians(20.0)), 0.0)
    ahead = master_directions(CELLS)[0][..., 0].ravel()[ON_CAP]
    light = below.by_floor @ AREA
    assert light[ahead > 0.8].mean() > 1.2 * light[ahead < -0.8].mean()


def test_the_slope_is_what_a_brighter_floor_changes() -> None:
    """Central difference of rooms whose floors are 0.01 brighter and darker."""
    dome = Dome(6.0, np.pi / 2)
    ahead = master_directions(CELLS)[0][..., 0].ravel() > 0.3
    white = np.where(ON_CAP, master_solid_angles(CELLS).ravel(), 0.0)
    lights = np.stack([white * ahead, white], axis=1)
    below = replace(below_rim(dome, 0.2), wall_albedo=0.25)
    darker, slope, brighter = (
        ModelRoom(dome, 0.6, floor, below).over_white(lights)[which][ON_CAP]
        for floor, which in ((0.29, 0), (0.3, 1), (0.31, 0))
    )
    np.testing.assert_allclose(slope, (brighter - darker) / 0.02, atol=1e-3 * np.abs(slope).max())
