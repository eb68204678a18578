"""Soft edges and the common white."""

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.estimate.light.blend import Blender, common_white
from procam.maths.geometry.sphere import master_directions
from procam.model.calibration import Calibration


@pytest.fixture(scope="module")
def blender(calibration: Calibration) -> Blender:
    return Blender(calibration.projectors, calibration.screen)


def test_weights_sum_to_one_where_anything_is_lit(blender: Blender) -> None:
    direction, _ = master_directions(200)
    weights = blender.weights(direction.astype(np.float32))
    total = sum(weights.values())
    lit = total > 0
    assert lit.mean() > 0.3
    np.testing.assert_allclose(total[lit], 1, rtol=FLOAT32)
    assert not lit.all()
    for weight in weights.values():
        assert weight.min() >= 0


def test_each_end_belongs_to_one_and_the_middle_to_both(blender: Blender) -> None:
    low = np.radians(25.0)
    places = np.array(
        [[[np.cos(low), 0, np.sin(low)], [0, 0, 1.0], [-np.cos(low), 0, np.sin(low)]]], np.float32
    )
    weights = blender.weights(places)
    np.testing.assert_allclose(weights["south"][0, [0, 2]], [1, 0], atol=1e-6)
    np.testing.assert_allclose(weights["north"][0, [0, 2]], [0, 1], atol=1e-6)
    assert 0.2 < weights["south"][0, 1] < 0.8


def test_a_projector_sends_all_where_it_lights_alone_and_nothing_off_the_screen(
    blender: Blender, calibration: Calibration
) -> None:
    blended = blender.blended()
    for name, projector in calibration.projectors.items():
        surface, blend = projector.surface, blended[name].blend
        weights = blender.weights(np.nan_to_num(surface.direction))
        alone = surface.valid & (sum(weights.values()) == weights[name]) & (weights[name] > 0)
        assert alone.any() and (blend[alone] == 1).all()
        assert not blend[~surface.valid].any()


def test_there_is_no_step_anywhere(blender: Blender) -> None:
    """Weights fade to nothing at a footprint's border: neighbours differ little."""
    azimuth = np.zeros(4000)
    elevation = np.linspace(np.radians(15.0), np.radians(165.0), 4000)
    path = np.stack([np.cos(elevation), np.sin(azimuth), np.sin(elevation)], axis=-1)
    south = blender.weights(path[None].astype(np.float32))["south"][0]
    assert south.max() == pytest.approx(1, abs=1e-5) and south.min() == pytest.approx(0, abs=1e-5)
    assert np.abs(np.diff(south)).max() < 0.01


def test_common_white_is_the_least_anyone_can_do(rng: np.random.Generator) -> None:
    hi = rng.uniform(1, 2, (100, 100, 3)) * [1.0, 1.1, 0.9]
    lit = np.ones((100, 100), bool)
    lit[:3] = False
    hi[:3] = 0.01
    white = common_white(hi, lit)
    np.testing.assert_allclose(white, [1.0, 1.1, 0.9], rtol=0.01)
    assert (white >= hi[lit].min(axis=0)).all()
