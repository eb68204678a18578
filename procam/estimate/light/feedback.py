"""Feedback and albedo from the separated light of all projectors.

From the scattered light per flux follow u, the feedback m = a.u (docs/theory/interreflection.md, I10) and,
under assumptions about the rest of the room, the mean albedo (I15).
"""

from collections.abc import Iterable

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.light.separation import SeparatedLight
from procam.maths.light.radiosity import albedo_from_feedback, floor_return
from procam.model.screen import Dome
from procam.model.transport import Measured

# relative, of m: the border of the lit area has the same error for all projectors, so their spread
# does not show it; three times the bias in studies/photometry.md
BORDER_SIGMA = 1e-3
SINGLE_SIGMA = 0.003  # relative, of m from one projector alone; on matte domes they differ by 0.1 %


def estimate_scatter_per_flux(lights: Iterable[SeparatedLight]) -> Image:
    """Scatter per flux u (H, W, C) [1/sr] of full white: scattered light of all projectors over their flux.

    The sum is what full white is, so how scattered light depends on its place need not be known, and a
    veil of the camera's lens that stays near its light does not count twice in some places.
    """
    scattered, flux = np.zeros(1, np.float32), np.zeros(1)
    for light in lights:
        scattered, flux = scattered + light.scattered, flux + light.flux
    return np.asarray(scattered / flux.astype(np.float32))


def estimate_feedback(
    lights: Iterable[SeparatedLight],
    lit_sr: Array,
    on_screen_sr: Array,
    *,
    glare_sigma: float,
    flux_sigma: float,
) -> Measured:
    """Feedback m (C,) with its standard error, from all projectors.

    Parameters
    ----------
    lights : of the projectors.
    lit_sr, on_screen_sr : (H, W) solid angle of the camera pixels on the lit part and on the screen.
    glare_sigma : standard error of the camera's veiling glare, which adds to every scattered sample.
    flux_sigma : relative standard error of the direct flux of all projectors.

    Notes
    -----
    Each projector alone gives an estimate of m; their spread includes the dependence on where the
    light falls.
    """
    sums = [
        [np.tensordot(lit_sr, light.scattered, 2), light.flux, _mean_light(light, on_screen_sr)]
        for light in lights
    ]
    scattered, flux, mean_light = np.moveaxis(np.array(sums), 1, 0)
    each, value = scattered / flux, scattered.sum(axis=0) / flux.sum(axis=0)
    spread = (
        each.std(axis=0, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else SINGLE_SIGMA * value
    )
    spread = np.hypot(spread, BORDER_SIGMA * value)
    veil = glare_sigma * mean_light.mean(axis=0) * lit_sr.sum() / on_screen_sr.sum()
    return Measured(value, np.sqrt(spread**2 + veil**2 + (flux_sigma * value) ** 2))


def _mean_light(light: SeparatedLight, on_screen_sr: Array) -> Array:
    """Light (C,) on the screen over the direct flux [sr]."""
    both = np.tensordot(on_screen_sr, light.direct + light.scattered, 2)
    return np.asarray(both / light.flux)


def estimate_albedo(
    feedback: Measured, lit_sr: float, screen_sr: float, dome: Dome, flux_inconsistency: float
) -> Measured:
    """Mean albedo (C,) from the feedback.

    Assumes that the unlit part of the cap has the same albedo. The standard error includes those of
    the feedback and of the floor, and `flux_inconsistency`, the relative amount of direct light that
    gloss may hide from the camera in all pictures (docs/theory/photometry.md).
    """

    def at(m: Array, floor: float) -> Array:
        returned = floor_return(dome.half_angle, dome.tilt, floor)
        return albedo_from_feedback(m, lit_sr, screen_sr, returned)

    value = at(feedback.value, dome.floor_albedo)
    by_feedback = at(feedback.value + feedback.sigma, dome.floor_albedo) - value
    by_floor = at(feedback.value, dome.floor_albedo + dome.floor_albedo_sigma) - value
    return Measured(
        value, np.sqrt(by_feedback**2 + by_floor**2 + (flux_inconsistency * value) ** 2)
    )
