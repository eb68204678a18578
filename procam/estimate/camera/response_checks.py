"""Checks that one curve, one scene and the given exposures explain a set of bracketed photographs."""

import numpy as np

from procam.arrays import Array
from procam.errors import DidNotConverge, NotEnoughData, OutOfModelRange
from procam.estimate.camera.response_fit import SHUTTER_SIGMA, CameraResponseFit

MAX_SHUTTER_SIGMAS = 5.0
BINS, MIN_IN_BIN = 20, 8  # of the range of levels; samples that each needs
MAX_MISFIT, MISFIT_SIGMAS = (
    0.01,
    5.0,
)  # of a photograph at some level: share of the range, and noise
MOVED_SIGMAS, MOVED_LEVEL, MAX_MOVED = 6.0, 0.015, 0.1  # of a residual; share of the blocks


def check_response(fit: CameraResponseFit) -> None:
    """Refuse a fit that the photographs contradict.

    Raises
    ------
    NotEnoughData
        Some levels have no samples.
    OutOfModelRange
        A shutter time, a moved scene or a photograph with another curve contradicts the fit.
    DidNotConverge
        The fit did not reach a minimum.
    """
    _check_coverage(fit)
    _check_shutter(fit)
    residual = np.where(fit.use, fit.residual(), np.nan)
    _check_still(fit, residual)
    for number, row in enumerate(residual):
        _check_profile(fit, number, row)
    if not fit.converged:
        raise DidNotConverge(
            "brackets: the fit did not settle; check that the photographs show one still scene at fixed "
            "settings, and add exposures"
        )


def _check_coverage(fit: CameraResponseFit) -> None:
    seen = np.histogram(fit.predicted[fit.use], BINS, (0, 1))[0]
    thin = np.flatnonzero(seen[1:-1] < MIN_IN_BIN) + 1
    if thin.size:
        low, high = thin[0] / BINS, (thin[0] + 1) / BINS
        raise NotEnoughData(
            f"brackets: only {seen[thin[0]]} places have levels of {low:.0%} to {high:.0%} of the range; "
            f"{MIN_IN_BIN} are needed. Add exposures, or a scene with all shades from deep shadow to white"
        )


def _check_shutter(fit: CameraResponseFit) -> None:
    off = np.abs(fit.shutter - fit.nominal) / SHUTTER_SIGMA
    worst = int(np.argmax(off))
    if off[worst] > MAX_SHUTTER_SIGMAS:
        raise OutOfModelRange(
            f"brackets: {_name(fit, worst)}: its light is that of {fit.exposures_s[worst]:.4g} s, more than "
            f"{MAX_SHUTTER_SIGMAS * SHUTTER_SIGMA:.0%} off; check its exposure, that ISO and aperture were "
            "fixed, and that the scene's light was steady"
        )


def _check_still(fit: CameraResponseFit, residual: Array) -> None:
    limit = np.maximum(MOVED_SIGMAS * fit.noise, MOVED_LEVEL)
    moved = float((np.abs(residual) > limit)[:, fit.use.any(axis=0)].any(axis=0).mean())
    if moved > MAX_MOVED:
        raise OutOfModelRange(
            f"brackets: no curve fits {moved:.0%} of the places, more than {MAX_MOVED:.0%}; use a tripod and "
            "a still scene, fixed focus, and one picture profile"
        )


def _check_profile(fit: CameraResponseFit, number: int, residual: Array) -> None:
    """Refuse a photograph with levels off the common curve."""
    use = fit.use[number]
    bins = np.minimum(BINS * fit.predicted[number, use], BINS - 1).astype(int)
    counts = np.bincount(bins, minlength=BINS)
    means = np.bincount(bins, residual[use], BINS) / np.maximum(counts, 1)
    chance = MISFIT_SIGMAS * float(np.median(fit.noise)) / np.sqrt(np.maximum(counts, 1))
    significant = (counts >= MIN_IN_BIN) & (np.abs(means) > chance)
    misfit = np.abs(means[significant]).max(initial=0.0)
    if misfit > MAX_MISFIT:
        raise OutOfModelRange(
            f"brackets: {_name(fit, number)}: its levels are {misfit:.1%} of the range off the common curve, "
            f"more than {MAX_MISFIT:.0%}; use one picture profile, white balance and contrast for all, and a "
            "scene in which nothing moves"
        )


def _name(fit: CameraResponseFit, number: int) -> str:
    return f"photograph {number + 1} ({np.exp(fit.nominal[number]):g} s)"
