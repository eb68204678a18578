"""Canvases: dome masters of any field of view and rotation, by their definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, FLOAT32

from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import (
    angles_from_direction,
    cap_solid_angle,
    direction_from_angles,
    master_directions,
    master_pixels,
)

FIELDS, TURNS = st.floats(0.4, 4.3), st.floats(-6.2, 6.2)


@given(st.integers(4, 64), FIELDS, TURNS)
def test_round_trip(size: int, fov: float, rotation: float) -> None:
    canvas = Canvas(fov, rotation)
    direction, inside = canvas.directions(size)
    place = np.stack(np.meshgrid(np.arange(size), np.arange(size)), -1).astype(float)
    np.testing.assert_allclose(canvas.pixels(direction, size)[inside], place[inside], atol=1e-9)


@given(FIELDS, TURNS)
def test_the_bottom_edge_is_at_the_rotation_and_half_the_field_from_the_pole(
    fov: float, rotation: float
) -> None:
    size = 101
    azimuth, _ = angles_from_direction(Canvas(fov, rotation).directions(size)[0][-1, 50])
    assert np.cos(azimuth - rotation) == pytest.approx(1, abs=CLOSED_FORM)
    rim = direction_from_angles(rotation, np.pi / 2 - fov / 2)
    at = Canvas(fov, rotation).pixels(rim, size)
    np.testing.assert_allclose(at, [50, 50 + size / 2], atol=1e-9)


def test_the_standard_canvas_is_that_of_the_maps() -> None:
    direction, inside = STANDARD.directions(33)
    expected, expected_inside = master_directions(33)
    assert np.array_equal(direction, expected) and np.array_equal(inside, expected_inside)
    assert np.array_equal(STANDARD.pixels(direction, 33), master_pixels(direction, 33))


def test_planes_are_the_same_in_single_precision() -> None:
    canvas = Canvas(3.8, 0.7)
    direction, area = canvas.planes(64)
    np.testing.assert_allclose(
        np.moveaxis(direction, 0, -1), canvas.directions(64)[0], atol=FLOAT32
    )
    np.testing.assert_allclose(area, canvas.weights(64), rtol=FLOAT32)
    assert canvas.weights(512).sum() == pytest.approx(cap_solid_angle(1.9), rel=1e-3)
