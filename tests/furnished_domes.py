"""Calibrations of domes whose furniture scatters light according to where it falls."""

from dataclasses import replace

import numpy as np

from procam.model.calibration import Calibration
from procam.model.transport import ScatterKernel


def furnished(calibration: Calibration, degree: int = 1) -> Calibration:
    """The calibration with a scatter kernel of a degree, as over a floor that returns more to one side."""
    terms = (degree + 1) ** 2
    bend = np.diag([1.0, 0.03, 0.06, 0.05, 0.02, 0.01, 0.03, 0.02, 0.01][:terms])
    bend[0, 1] = bend[1, 0] = 0.02
    profile = np.tile([1.0, 0.02, *np.zeros(terms - 2)], (3, 1))
    kernel = ScatterKernel(degree, np.stack([bend] * 3), profile)
    return replace(calibration, maps=replace(calibration.maps, kernel=kernel))
