"""How much near veil a solve gives a camera."""

import pytest

from procam.model.optics import Sensor
from procam.workflows.solve.near_veil import _with_veil

FOUND = [(0.003, 0.03), (0.001, 0.1)]


@pytest.mark.parametrize(
    ("glare", "sigma", "share"), [(0.01, 0.001, 0.004), (0.001, 0.0005, 0.002), (0.0, 0.0, 0.0)]
)
def test_no_more_than_the_stated_glare_and_two_standard_errors(
    glare: float, sigma: float, share: float
) -> None:
    sensor = _with_veil(Sensor(12, 0.0, (), glare, sigma), FOUND)
    assert sensor.near_share == pytest.approx(share)
    if share:
        assert sensor.near_glare[0][0] == pytest.approx(3 * sensor.near_glare[1][0])
    assert (sensor.glare, sensor.glare_sigma) == (glare, sigma)
