"""What scattered light shows of a vignetting that venue.toml does not have."""

from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.unknown_vignetting import (
    USUAL,
    unknown_vignetting,
    vignetting_notes,
)
from procam.maths.geometry.lenses import Lens, unproject
from procam.model.optics import CameraModel, Sensor

SIZE = 200
LENS = Lens("kannala-brandt", np.full(2, SIZE / np.pi), np.full(2, (SIZE - 1) / 2), np.zeros(4))


def view(*vignetting: float) -> ScreenView:
    """A hemisphere as a fisheye of 180 degrees in its middle sees it."""
    pixels = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), -1).astype(float)
    rays = unproject(pixels, LENS)
    theta = np.arccos(rays[..., 2])
    on_screen = theta < np.pi / 2
    solid = np.where(on_screen, np.sinc(theta / np.pi), 0.0)
    camera = CameraModel("zenith", (SIZE, SIZE), LENS, Sensor(12, 64.0, vignetting))
    return ScreenView(camera, rays.astype(np.float32), on_screen, solid)


def uniform_light(slope: float) -> np.ndarray:
    """Uniform scattered light behind a lens that leaves exp(-slope theta^2)."""
    theta = np.arccos(view().direction[..., 2])
    return (0.05 * np.exp(-slope * theta**2)[..., None] * np.ones(3)).astype(np.float32)


def rms_of(slope: float) -> float:
    """The same, of its logarithm over a hemisphere, in closed form: theta^2 by cos theta = 0..1."""
    theta = np.arccos((np.arange(100_000) + 0.5) / 100_000)
    return slope * float(np.std(theta**2))


def test_the_fall_of_scattered_light_is_the_lens_s() -> None:
    found = unknown_vignetting(uniform_light(0.1), view())
    assert found == pytest.approx(rms_of(0.1), rel=0.01) and found > USUAL
    (note,) = vignetting_notes(uniform_light(0.1), view())
    edge = 1 - np.exp(-0.1 * (np.pi / 2) ** 2)
    assert f"scattered light falls by {edge:.0%} towards the edge" in str(note)
    assert f"by about {found:.0%} and most at the edge" in str(note)


def test_a_lens_that_seems_to_have_none_is_not_trusted() -> None:
    assert unknown_vignetting(uniform_light(0.0), view()) == USUAL
    (note,) = vignetting_notes(uniform_light(-0.01), view())
    assert "scattered light does not fall towards" in str(note)


@pytest.mark.parametrize("stated", [-0.04, 0.0])
def test_a_measured_vignetting_is_no_news(stated: float) -> None:
    assert unknown_vignetting(uniform_light(0.1), view(stated)) == 0.0
    assert vignetting_notes(uniform_light(0.1), view(stated)) == []


def test_nothing_on_the_screen() -> None:
    nothing = replace(view(), on_screen=np.zeros((SIZE, SIZE), bool))
    assert unknown_vignetting(uniform_light(0.1), nothing) == USUAL
