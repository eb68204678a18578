"""Compensation of one frame: sums of its light over the dome, and the light to send."""

from procam.kernels.frame.api import check_pictures, frame_apply, frame_sums, scattered_light
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.model import TERMS, FrameModel

__all__ = [
    "TERMS",
    "Coding",
    "FrameModel",
    "check_pictures",
    "frame_apply",
    "frame_sums",
    "scattered_light",
]
