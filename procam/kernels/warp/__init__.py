"""Frames of one projector, sampled from a dome master of direct light."""

from procam.kernels.warp.api import plan_warp, warp_frame
from procam.kernels.warp.reference import WarpPlan

__all__ = ["WarpPlan", "plan_warp", "warp_frame"]
