"""Scatter, feedback and albedo of the dome, from the light of all projectors in content channels."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procam.arrays import Array, Image
from procam.errors import OutOfModelRange
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.feedback import estimate_albedo, estimate_feedback
from procam.estimate.light.floor_albedo import FloorLight, combined_floor_albedo, measure_floor
from procam.estimate.light.scatter_kernel import ScatterSample, ScatterSolution, solve_scatter
from procam.estimate.light.separation import SeparatedLight
from procam.estimate.light.unknown_vignetting import unknown_vignetting
from procam.maths.geometry.sphere import cap_solid_angle, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.screen import Dome
from procam.model.transport import Measured

# relative, of the veil that stays near its light where it is measured, as it is no Gaussian, and as a light
# trap at a desk sees a part of it; and of all veil where it does not show, as if half of it did stay near
MEASURED_VEIL, UNMEASURED_VEIL = 0.2, 0.1
# of the lit part of the screen, by which the camera's pixels on it may together exceed it; edges of
# pixels and of maps differ by less
MAX_EXCESS = 0.03


@dataclass(frozen=True, slots=True)
class DomeScatter:
    """Scatter, feedback and albedo of the dome; `dome` has the combined floor albedo."""

    dome: Dome
    solution: ScatterSolution
    floor: FloorLight
    feedback: Measured
    albedo: Measured


def measure_scatter(
    dome: Dome,
    view: ScreenView,
    lights: Collection[SeparatedLight],
    samples: Sequence[Sequence[ScatterSample]],
    white: Array,
    coverage: Image,
) -> DomeScatter:
    """Estimate scatter, feedback, albedo and the floor's albedo.

    Parameters
    ----------
    dome, view : the screen, and the main camera's view of it.
    lights : white of each projector. samples : of each projector.
    white : (N, C) flux of full white per cell [rel sr]. coverage : (M, M) on a dome master.

    Raises
    ------
    OutOfModelRange
        If the camera's pixels see more of the lit part of the screen than there is.
    """
    together = [x for each in samples for x in each]
    solution = solve_scatter(lights, together, view, white)
    at = master_pixels(np.nan_to_num(view.direction), len(coverage))
    lit_sr = float((master_solid_angles(len(coverage)) * coverage).sum())
    screen_sr = cap_solid_angle(dome.half_angle)
    lit_pixels_sr = sample(coverage, at) * view.weight
    _check_lens(view.camera.name, float(lit_pixels_sr.sum()), lit_sr)
    sensor = view.camera.sensor
    unknown = max(MEASURED_VEIL * sensor.near_share, UNMEASURED_VEIL * sensor.glare)
    feedback = partial(
        estimate_feedback,
        lights,
        lit_pixels_sr,
        view.weight,
        glare_sigma=np.hypot(sensor.glare_sigma, unknown),
    )
    rough = estimate_albedo(feedback(flux_sigma=0.0), lit_sr, screen_sr, dome, 0.0)
    floor = measure_floor(together, solution.in_cells, white, dome, float(rough.value.mean()))
    value, sigma = combined_floor_albedo(dome, floor)
    dome = replace(dome, floor_albedo=value, floor_albedo_sigma=sigma)
    # gloss hides the same share of a projector's light from the camera in all its pictures
    gloss = floor.flux_inconsistency / np.sqrt(len(lights))
    m = feedback(flux_sigma=np.hypot(gloss, unknown_vignetting(solution.per_flux, view)))
    rho = estimate_albedo(m, lit_sr, screen_sr, dome, floor.flux_inconsistency)
    return DomeScatter(dome, solution, floor, m, rho)


def _check_lens(camera: str, seen_sr: float, lit_sr: float) -> None:
    """Refuse a lens whose pixels see the lit part of the screen more than once: m would be too large."""
    if seen_sr > (1 + MAX_EXCESS) * lit_sr:
        raise OutOfModelRange(
            f"camera {camera}: its pixels cover {seen_sr:.3g} sr of the lit part of the screen, which has "
            f"{lit_sr:.3g} sr. The lens is wrong near the picture's edge: measure it with `procam lens "
            'board`, boards at the edge included, and set intrinsics = "fixed"'
        )
