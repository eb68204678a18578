"""Colour scales and values on the canvas."""

import numpy as np
import pytest

from procam.interfaces.plots.charts import Scale, on_canvas
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import master_directions, master_pixels

MINUS = "\N{MINUS SIGN}"


def test_values_are_drawn_where_their_directions_point():
    direction, inside = master_directions(33)
    elevation = direction[..., 2]
    drawn = on_canvas(STANDARD, direction[inside], elevation[inside], 33)
    np.testing.assert_allclose(drawn[inside], elevation[inside], atol=1e-12)
    column, row = master_pixels(np.array([1.0, 0.0, 0.0]), 33)  # the front
    assert row > column and np.isnan(drawn[0, 0])


def test_ticks_are_round_and_inside_the_scale():
    ticks = Scale("x", -0.2, 0.2, "signed", 100.0).ticks()
    assert [text for _, text in ticks] == [f"{MINUS}20", f"{MINUS}10", "0", "10", "20"]
    assert [place for place, _ in ticks] == pytest.approx([0, 25, 50, 75, 100])
    light = Scale("x", 0.0, 1.1, "light").ticks()
    assert all(0 <= place <= 100 for place, _ in light) and light[0] == (0.0, "0")
