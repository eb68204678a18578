"""Drives for projectors whose response differs by place: what they send is what was asked."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from procam.compensate.projector_frames import projector_frames
from procam.maths.geometry.sphere import master_pixels
from procam.maths.light.curves import apply_curve
from procam.maths.warp import sample
from procam.model.calibration import Calibration

N = 64


def test_the_exponent_is_undone(make_calibration: Callable[..., Calibration]) -> None:
    calibration = make_calibration()
    south = calibration.projectors["south"]
    shape = south.photometry.gain.shape
    rng = np.random.default_rng(3)
    exponent = rng.uniform(0.9, 1.1, shape).astype(np.float32)
    light = replace(south.photometry, exponent=exponent)
    bent = replace(calibration, projectors={"south": replace(south, photometry=light)})
    asked = np.full((N, N, 3), 0.3, np.float32)
    drive = projector_frames(asked, bent)["south"]
    response = apply_curve(drive, light.response.levels, light.response.values)
    sent = light.gain * (response**exponent @ light.colour_mix.T)
    at = master_pixels(np.nan_to_num(south.surface.direction), N)
    black = sample(
        bent.maps.lo, master_pixels(np.nan_to_num(south.surface.direction), bent.maps.size)
    )
    wanted = (sample(asked, at) - black) * south.blend[..., None]
    inside = (drive > 0.02).all(axis=-1) & (drive < 0.98).all(axis=-1)
    assert inside.sum() > 100
    np.testing.assert_allclose(sent[inside], wanted[inside], rtol=0.002, atol=1e-4)
    plain = projector_frames(asked, replace(calibration, projectors={"south": south}))["south"]
    assert np.abs(plain - drive)[inside].max() > 0.01
