"""Normal equations of the bundle adjustment: camera ray, screen, projector pixel."""

from procam.kernels.bundle.api import bundle_equations, bundle_misses
from procam.kernels.bundle.rays import fisheye_rays
from procam.kernels.bundle.reference import Device, Equations, Relief, Sight

__all__ = [
    "Device",
    "Equations",
    "Relief",
    "Sight",
    "bundle_equations",
    "bundle_misses",
    "fisheye_rays",
]
