"""Projector frames against the forward model of each projector."""

import dataclasses

import numpy as np
import pytest

from procam.compensate.projector_frames import projector_frames
from procam.maths.light.curves import apply_curve
from procam.model.calibration import Calibration, ProjectorCalibration

SIZE = 96
LO = 0.003
# black and colour mixing in float32, then a table's slope: light in units of white
LIGHT = 2e-5


def _light(projector: ProjectorCalibration, drive: np.ndarray) -> np.ndarray:
    """direct radiance = gain * (colour_mix @ response(drive)), black aside."""
    photometry = projector.photometry
    linear = apply_curve(drive, photometry.response.levels, photometry.response.values)
    return photometry.gain * (linear @ photometry.colour_mix.T)


def _settled(projector: ProjectorCalibration) -> np.ndarray:
    """Pixels well inside the lit part: bilinear samples there touch nothing unlit."""
    z = projector.surface.direction[..., 2]
    return projector.surface.valid & (z > np.sin(np.radians(14.0)))


@pytest.mark.parametrize("asked", [(0.5, 0.5, 0.5), (0.7, 0.4, 0.3), (0.05, 0.06, 0.04)])
def test_each_projector_gives_its_share(
    calibration: Calibration, asked: tuple[float, float, float]
) -> None:
    direct = np.broadcast_to(np.array(asked, np.float32), (SIZE, SIZE, 3))
    frames = projector_frames(np.ascontiguousarray(direct), calibration)
    for name, projector in calibration.projectors.items():
        use = (
            _settled(projector) & (frames[name].max(axis=-1) < 1) & (frames[name].min(axis=-1) > 0)
        )
        assert use.sum() > 300
        share = (np.array(asked) - LO) * projector.blend[..., None]
        light = _light(projector, frames[name])
        np.testing.assert_allclose(light[use], share[use], atol=LIGHT)


def test_a_picture_lands_the_right_way_round(calibration: Calibration) -> None:
    """Light rising to the left and to the front: bilinear sampling is exact on a linear picture."""
    row, column = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    direct = (0.2 + 0.3 * (1 - column) + 0.2 * row)[..., None].repeat(3, axis=-1)
    frames = projector_frames(direct.astype(np.float32), calibration)
    for name, projector in calibration.projectors.items():
        x, y, z = np.moveaxis(projector.surface.direction.astype(float), -1, 0)
        q = np.arccos(np.clip(z, -1, 1)) / (np.pi / 2) / np.hypot(x, y)
        column, row = (SIZE - 1) / 2 - SIZE / 2 * q * y, (SIZE - 1) / 2 + SIZE / 2 * q * x
        asked = 0.2 + 0.3 * (1 - column / SIZE) + 0.2 * row / SIZE
        use = (
            _settled(projector) & (frames[name].max(axis=-1) < 1) & (frames[name].min(axis=-1) > 0)
        )
        light = _light(projector, frames[name])
        expected = ((asked - LO) * projector.blend)[..., None]
        np.testing.assert_allclose(
            light[use], np.broadcast_to(expected, light.shape)[use], atol=1e-4
        )


def test_what_cannot_be_given_is_clipped(calibration: Calibration) -> None:
    for value, drive in ((0.0, 0.0), (99.0, 1.0)):
        frames = projector_frames(np.full((SIZE, SIZE, 3), value, np.float32), calibration)
        for name, projector in calibration.projectors.items():
            use = _settled(projector) & (projector.blend > 0.2)
            assert (frames[name][use] == drive).all()


def test_nothing_from_pixels_that_do_not_arrive(calibration: Calibration) -> None:
    frames = projector_frames(np.ones((SIZE, SIZE, 3), np.float32), calibration)
    for name, projector in calibration.projectors.items():
        assert frames[name].dtype == np.float32
        assert frames[name].shape == (*projector.surface.valid.shape, 3)
        assert not frames[name][~projector.surface.valid].any()


def test_unknown_directions_are_dark(calibration: Calibration) -> None:
    south = calibration.projectors["south"]
    direction = south.surface.direction.copy()
    direction[:5] = np.nan
    valid = south.surface.valid.copy()
    valid[:5] = False
    surface = dataclasses.replace(south.surface, direction=direction, valid=valid)
    holed = dataclasses.replace(
        calibration, projectors={"south": dataclasses.replace(south, surface=surface)}
    )
    frame = projector_frames(np.ones((SIZE, SIZE, 3), np.float32), holed)["south"]
    assert np.isfinite(frame).all() and not frame[:5].any()
