"""Derivatives of a lens's projection by the point and by the lens's parameters."""

import numpy as np

from procam.arrays import Array
from procam.kernels.bundle.lenses import project_slopes
from procam.maths.geometry.lenses import Lens, project


def lens_parameters(lens: Lens) -> Array:
    """Focal lengths x, y and centre x, y [px], then distortion [-]: (9,) Brown, (8,) fisheye."""
    return np.concatenate([lens.focal, lens.centre, lens.distortion])


def lens_of_parameters(lens: Lens, parameters: Array) -> Lens:
    """The inverse of `lens_parameters`, for a lens of the kind of `lens`."""
    return Lens(lens.kind, parameters[:2], parameters[2:4], parameters[4:])


def project_with_derivatives(points: Array, lens: Lens) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points (N, 3), with their derivatives.

    Returns
    -------
    pixels : (N, 2) as `procam.maths.geometry.lenses.project` returns them [px].
    by_point : (N, 2, 3) by the point's coordinates [px/m].
    by_parameter : (N, 2, P) by `lens_parameters`.
    """
    _, by_point, by_parameter = project_slopes(points, lens.kind, lens_parameters(lens))
    return project(points, lens), by_point, by_parameter
