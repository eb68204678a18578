"""The response fit on exact levels of a curve that its spline can represent."""

from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.camera import response_fit
from procam.estimate.camera.response_curve import LogSlopeCurve, initial_curve
from procam.estimate.camera.response_fit import Blocks, CameraResponseFit

SECONDS = np.array([0.1, 0.3, 0.9, 2.7])
INITIAL = initial_curve()


def curve_and_fit() -> tuple[LogSlopeCurve, CameraResponseFit]:
    wave = 0.3 * np.sin(np.arange(len(INITIAL.bends)) / 5)
    curve = replace(INITIAL, bends=INITIAL.bends + wave)
    light = curve.light()
    exposed = np.geomspace(1e-3, 10.0, 400) * light[-1] * SECONDS[:, None]
    level = np.interp(exposed, light, curve.levels)
    sound = (level > 0.001) & (level < 0.999)
    return curve, CameraResponseFit(Blocks(2, level, 0 * level, sound), SECONDS)


def test_derivatives_of_the_curve() -> None:
    curve = curve_and_fit()[0]
    for i in (0, 7, len(curve.bends) - 1):
        step = 1e-5 * np.eye(len(curve.bends))[i]
        ahead, back = (replace(curve, bends=curve.bends + s * step).light() for s in (1, -1))
        np.testing.assert_allclose(curve.by_bends()[:, i], (ahead - back) / 2e-5, atol=1e-9)


def test_an_exact_curve_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    # a power of the light explains shutter times that are off by the same power
    monkeypatch.setattr(response_fit, "SHUTTER_SIGMA", 1e-5)
    curve, fit = curve_and_fit()
    fit.solve()
    np.testing.assert_allclose(fit.exposures_s, SECONDS, rtol=1e-3)
    assert fit.residual_rms() < 1e-4
    light, sigma = fit.table(curve.levels)
    np.testing.assert_allclose(light, curve.light() / curve.light()[-1], atol=1e-3)
    assert (light[0], light[-1], sigma[-1]) == (0, 1, 0)


def test_noise_is_that_of_the_levels_not_of_what_a_fit_leaves(rng: np.random.Generator) -> None:
    """Each block's brightness is fitted to its few levels, which takes a share of their noise away."""
    _, exact = curve_and_fit()
    blocks = exact.blocks
    level = blocks.level + rng.normal(0, 0.004, blocks.level.shape)
    fit = CameraResponseFit(replace(blocks, level=level), SECONDS)
    fit.solve()
    middle = fit.use & (fit.predicted > 0.1) & (fit.predicted < 0.9)
    assert np.median(fit.noise[middle]) == pytest.approx(0.004, rel=0.1)
