"""The hot loops over pictures and observations, in C with a NumPy reference implementation of each.

One package per kernel: `frame` compensates dome masters, `warp` makes projector frames, `search` finds
columns from sinusoids, `bundle` sums normal equations.

Each has an `api` that checks arguments, a `reference` in NumPy, and C headers. `native` compiles every
header three times, for AVX-512, AVX2 and NEON or plain C, and chooses at run time (`active`, `use`, or
PROCAM_KERNELS in the environment). Without the library the reference implementations run; the tests
hold the library against them. Pictures are uint8, uint16, float16 or float32, geometry is float64.
"""

from procam.kernels.bundle.api import bundle_equations, bundle_residuals
from procam.kernels.bundle.rays import fisheye_rays
from procam.kernels.bundle.reference import (
    NormalEquations,
    ObservationBlock,
    PlacedDevice,
    ShapeDerivatives,
)
from procam.kernels.frame.api import frame_apply, frame_sums, scattered_light
from procam.kernels.native.loader import LEVELS, active, available, forced, use
from procam.kernels.search.api import search_phase
from procam.kernels.search.reference import PhaseFit
from procam.kernels.warp.api import plan_warp, warp_frame
from procam.kernels.warp.reference import WarpPlan

__all__ = [
    "LEVELS",
    "NormalEquations",
    "ObservationBlock",
    "PhaseFit",
    "PlacedDevice",
    "ShapeDerivatives",
    "WarpPlan",
    "active",
    "available",
    "bundle_equations",
    "bundle_residuals",
    "fisheye_rays",
    "forced",
    "frame_apply",
    "frame_sums",
    "plan_warp",
    "scattered_light",
    "search_phase",
    "use",
    "warp_frame",
]
