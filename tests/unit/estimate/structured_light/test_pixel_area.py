"""The standard error that a camera pixel's area adds, and pixels beyond the panel."""

import numpy as np
import pytest

from procam.estimate.structured_light.outliers import (
    drop_beyond_panel,
    with_area_error,
)
from procam.estimate.structured_light.sinusoids import (
    PLAUSIBLE_GAMMA,
    UNSEEN_HARMONIC,
    unseen_harmonic_px,
)
from procam.maths.codes.phase import Waves, equal_steps
from procam.model.correspondence import CorrespondenceMap

V, U = np.mgrid[:40, :60].astype(np.float32)


def seen(xy: np.ndarray) -> CorrespondenceMap:
    known = np.isfinite(xy).all(axis=-1)
    sigma = np.where(known[..., None], np.full(xy.shape, 0.02), np.nan)
    return CorrespondenceMap(xy.astype(np.float32), sigma.astype(np.float32), known)


def test_a_slope_of_light_enters_the_standard_error() -> None:
    """(S8): light that grows as exp(a u + b v) before a map of known slope."""
    xy = np.stack([0.8 * U + 0.1 * V, 1.5 * V - 0.3 * U], axis=-1)
    found = with_area_error(seen(xy), 100 * np.exp(0.2 * U - 0.1 * V).astype(np.float32), 1.0)
    expected = 1 / 6 * np.abs([0.8 * 0.2 - 0.1 * 0.1, -0.3 * 0.2 - 1.5 * 0.1])
    middle = found.sigma_px[5:-5, 5:-5]
    np.testing.assert_allclose(
        middle, np.broadcast_to(np.hypot(0.02, expected), middle.shape), rtol=1e-3
    )


def test_uniform_light_adds_nothing_and_holes_stay() -> None:
    xy = np.stack([U, V], axis=-1)
    xy[10:14, 20:30] = np.nan
    found = with_area_error(seen(xy), np.full(U.shape, 50, np.float32), 1.0)
    np.testing.assert_array_equal(np.isfinite(found.sigma_px[..., 0]), found.valid)
    np.testing.assert_allclose(found.sigma_px[found.valid], 0.02, rtol=1e-6)


def test_pixels_beyond_the_panel_are_dropped() -> None:
    """Blurred light of the first column, seen up to two pixels beyond it."""
    light = 100 / (1 + np.exp(-(U - 10) / 0.5))  # half at the edge of the panel, u = 10
    xy = np.stack([np.maximum(U - 10 - 0.5, 0), V + 5], axis=-1)
    found = drop_beyond_panel(seen(xy), light.astype(np.float32), (200, 200))
    assert not found.valid[:, :10].any() and found.valid[:, 11:].all()


def test_paint_inside_is_kept() -> None:
    xy = np.stack([U + 30, V + 30], axis=-1)
    light = np.where(U % 6 < 3, 20, 100).astype(np.float32)
    assert drop_beyond_panel(seen(xy), light, (200, 200)).valid.all()


def test_the_harmonic_of_a_wrong_gamma() -> None:
    """By Fourier transform, and as the error of a three-step phase."""
    phase = np.arange(4096) * 2 * np.pi / 4096
    light = np.cos(phase / 2) ** 2
    terms = np.abs(np.fft.rfft(light**PLAUSIBLE_GAMMA))
    assert terms[2] / terms[1] == pytest.approx(UNSEEN_HARMONIC, rel=1e-6)
    shifts, period = equal_steps(3), 16.0
    steps = (0.5 + 0.5 * np.cos(phase[:, None] - shifts)) ** PLAUSIBLE_GAMMA
    phasor = steps @ np.exp(1j * shifts)
    error = np.angle(phasor * np.exp(-1j * phase)) * period / (2 * np.pi)
    waves = Waves(np.full(3, period), shifts, 3)
    # harmonics beyond the second add a little
    assert np.sqrt(np.mean(error**2)) == pytest.approx(unseen_harmonic_px(waves), rel=0.15)
