"""Light on the dome: direct/global separation, scatter kernel, albedo, response, blend, absolute colour.

`separation` splits each projector's white; `scatter_kernel`, `floor_albedo` and `stability` work on its
samples; `footprint`, `blend` and `luminance_matching` describe how projectors share the dome; `absolute`
and `colour_spaces` add a hand meter's colours; `audience` compares a venue state with the calibration.
"""

from procam.estimate.light.absolute import AbsoluteLight, fit_absolute
from procam.estimate.light.audience import AudienceView, ZoneObservation, audience_feedback
from procam.estimate.light.inpaint import fill_light, fill_picture, pixels_without_pattern
from procam.estimate.light.projector_response import ProjectorResponseFit, fit_colour, tile_levels
from procam.estimate.light.scatter_kernel import ScatterCells, ScatterSample, solve_scatter
from procam.estimate.light.separation import SeparatedLight, Separation
from procam.estimate.light.stability import StabilityChecks

__all__ = [
    "AbsoluteLight",
    "AudienceView",
    "ProjectorResponseFit",
    "ScatterCells",
    "ScatterSample",
    "SeparatedLight",
    "Separation",
    "StabilityChecks",
    "ZoneObservation",
    "audience_feedback",
    "fill_light",
    "fill_picture",
    "fit_absolute",
    "fit_colour",
    "pixels_without_pattern",
    "solve_scatter",
    "tile_levels",
]
