"""Scatter, feedback and albedo of the dome, from the light of all projectors in content channels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.light.floor_albedo import FloorLight, combined_floor_albedo, measure_floor
from procam.estimate.light.scatter_kernel import ScatterSample, ScatterSolution, solve_scatter
from procam.estimate.light.separation import SeparatedLight, estimate_albedo, estimate_feedback
from procam.maths.geometry.sphere import cap_solid_angle, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.screen import Dome
from procam.model.transport import Measured

# relative, of veiling glare: what stays near its light in a real lens, while an even veil is subtracted,
# makes m wrong by .1 to .2 of the glare (studies/rooms.md, where up to .6 of it stays near)
LOCAL_VEIL = 0.15


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
    view: DomeView,
    lights: Sequence[SeparatedLight],
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
    """
    together = [x for each in samples for x in each]
    solution = solve_scatter(lights, together, view, white)
    at = master_pixels(np.nan_to_num(view.direction), len(coverage))
    lit_sr = float((master_solid_angles(len(coverage)) * coverage).sum())
    screen_sr = cap_solid_angle(dome.half_angle)
    sensor = view.camera.sensor
    feedback = partial(
        estimate_feedback,
        lights,
        sample(coverage, at) * view.solid_angle_sr,
        view.solid_angle_sr,
        glare_sigma=np.hypot(sensor.glare_sigma, LOCAL_VEIL * sensor.glare),
    )
    rough = estimate_albedo(feedback(flux_sigma=0.0), lit_sr, screen_sr, dome, 0.0)
    floor = measure_floor(together, solution.in_cells, white, dome, float(rough.value.mean()))
    value, sigma = combined_floor_albedo(dome, floor)
    dome = replace(dome, floor_albedo=value, floor_albedo_sigma=sigma)
    # gloss hides the same share of a projector's light from the camera in all its pictures
    m = feedback(flux_sigma=floor.flux_inconsistency / np.sqrt(len(lights)))
    rho = estimate_albedo(m, lit_sr, screen_sr, dome, floor.flux_inconsistency)
    return DomeScatter(dome, solution, floor, m, rho)
