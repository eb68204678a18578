"""Hot loops over pictures: one small C library and a NumPy twin of every function.

The library is built with the package and picks its instruction set at run time (`active`, `use`, or
PROCAM_KERNELS in the environment); without it the twins of `procam.kernels.search.reference*` run, which
are also what the tests hold it against. Pictures are uint8, uint16, float16 or float32, geometry float64.
"""

from procam.kernels.areas import solid_angles
from procam.kernels.bundle import (
    Device,
    Equations,
    Relief,
    Sight,
    bundle_equations,
    bundle_misses,
    fisheye_rays,
)
from procam.kernels.frame import bounced_light, frame_apply, frame_sums
from procam.kernels.native.loader import LEVELS, active, available, forced, use
from procam.kernels.search import PhaseFit, search_phase
from procam.kernels.warp import WarpPlan, plan_warp, warp_frame

__all__ = [
    "LEVELS",
    "Device",
    "Equations",
    "PhaseFit",
    "Relief",
    "Sight",
    "WarpPlan",
    "active",
    "available",
    "bounced_light",
    "bundle_equations",
    "bundle_misses",
    "fisheye_rays",
    "forced",
    "frame_apply",
    "frame_sums",
    "plan_warp",
    "search_phase",
    "solid_angles",
    "use",
    "warp_frame",
]
