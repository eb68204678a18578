"""Normal equations of the bundle adjustment: camera ray, screen, projector pixel."""

from procam.kernels.bundle.api import bundle_equations, bundle_residuals
from procam.kernels.bundle.rays import fisheye_rays
from procam.kernels.bundle.reference import (
    NormalEquations,
    ObservationBlock,
    PlacedDevice,
    ShapeDerivatives,
)

__all__ = [
    "NormalEquations",
    "ObservationBlock",
    "PlacedDevice",
    "ShapeDerivatives",
    "bundle_equations",
    "bundle_residuals",
    "fisheye_rays",
]
