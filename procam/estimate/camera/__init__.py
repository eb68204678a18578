"""One camera's photometry: noise, exposures, merging, response, veiling glare and vignetting.

`noise` and `exposure` plan photographs, `hdr` merges them, `radiance` converts counts to radiance;
`response`, `linearity`, `glare_and_vignetting` and `checks` measure what that conversion needs.
"""

from procam.estimate.camera.exposure import ExposurePlan, meter, plan_exposures
from procam.estimate.camera.glare_and_vignetting import black_level, fit_glare, fit_vignetting
from procam.estimate.camera.hdr import merge_exposures
from procam.estimate.camera.linearity import Linearity, linearity_error
from procam.estimate.camera.noise import NoiseLaw, noise_from_neighbours, noise_from_repeat
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.camera.response import CameraResponse, solve_response

__all__ = [
    "CameraResponse",
    "ExposurePlan",
    "Linearity",
    "NoiseLaw",
    "Radiometer",
    "black_level",
    "fit_glare",
    "fit_vignetting",
    "linearity_error",
    "merge_exposures",
    "meter",
    "noise_from_neighbours",
    "noise_from_repeat",
    "plan_exposures",
    "solve_response",
]
