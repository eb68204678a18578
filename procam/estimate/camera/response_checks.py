"""Checks that one curve, one scene and the given exposures explain a set of bracketed photographs."""

import numpy as np

from procam.arrays import Array
from procam.errors import DidNotConverge, NotEnoughData, OutOfModelRange
from procam.estimate.camera.response_fit import SHUTTER_SIGMA, CameraResponseFit

MAX_GAP = (
    2  # neighbouring bins without samples, which the sigma covers; steps of 3 stops leave such gaps
)
MAX_SHUTTER_SIGMAS = 5.0
BINS, MIN_IN_BIN = 20, 8  # of the range of levels; samples that each needs
MAX_MISFIT, MISFIT_SIGMAS = (
    0.01,
    5.0,
)  # of a photograph at some level: share of the range, and noise
MAX_MOVED = 0.4  # share of the chosen blocks
MAX_SCATTER, SCATTER_RATIO = (
    0.006,
    2.5,
)  # of flat blocks: share of the range, and of their pixels' noise


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
    _check_still(fit)
    _check_scatter(fit)
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
    if (thin[MAX_GAP:] - thin[:-MAX_GAP] == MAX_GAP).any():
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


def _check_still(fit: CameraResponseFit) -> None:
    moved = float(fit.moved.mean())
    if moved > MAX_MOVED:
        raise OutOfModelRange(
            f"brackets: no curve fits {moved:.0%} of the places, more than {MAX_MOVED:.0%}; use a tripod and "
            "a still scene, fixed focus, and one picture profile"
        )


def _check_scatter(fit: CameraResponseFit) -> None:
    scatter = fit.scatter()
    pixels = float(np.median(fit.blocks.deviation[fit.use])) / fit.blocks.edge
    if scatter > max(MAX_SCATTER, SCATTER_RATIO * pixels):
        raise OutOfModelRange(
            f"brackets: flat places scatter by {scatter:.1%} of the range about the common curve, more than "
            f"{MAX_SCATTER:.1%} and than their noise; use a tripod, one picture profile, and a scene in "
            "which nothing moves"
        )


def _check_profile(fit: CameraResponseFit, number: int, residual: Array) -> None:
    """Refuse a photograph with levels off the common curve."""
    use = fit.use[number]
    bins = np.minimum(BINS * fit.predicted[number, use], BINS - 1).astype(int)
    misfit = 0.0
    for each in range(BINS):
        off = residual[use][bins == each]
        chance = MISFIT_SIGMAS * float(np.median(fit.noise)) / np.sqrt(max(off.size, 1))
        if off.size >= MIN_IN_BIN and abs(np.median(off)) > chance:
            misfit = max(misfit, float(abs(np.median(off))))
    if misfit > MAX_MISFIT:
        raise OutOfModelRange(
            f"brackets: {_name(fit, number)}: its levels are {misfit:.1%} of the range off the common curve, "
            f"more than {MAX_MISFIT:.0%}; use one picture profile, white balance and contrast for all, and a "
            "scene in which nothing moves"
        )


def _name(fit: CameraResponseFit, number: int) -> str:
    return f"photograph {number + 1} ({np.exp(fit.nominal[number]):g} s)"
