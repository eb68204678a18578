"""Camera and projector lenses: pinhole with Brown distortion, and Kannala-Brandt fisheye.

Pixel (0, 0) is the centre of the top-left pixel; x points right, y down, z along the optical axis.
The tests compare both models with `cv2.projectPoints` and `cv2.fisheye.projectPoints`.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from procam.arrays import Array
from procam.kernels.bundle.lenses import fisheye_radius, project_slopes
from procam.kernels.bundle.rays import fisheye_rays

LensKind = Literal["brown", "kannala-brandt"]
NEWTON_STEPS = 12
SMALL = 1e-9


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsics of a camera or projector.

    Attributes
    ----------
    kind : "brown" (k = k1, k2, p1, p2, k3 as OpenCV orders them) or
        "kannala-brandt" (k = k1..k4 of theta + k1 theta^3 + k2 theta^5 + ...).
    focal : (2,) focal lengths in x and y [px].
    centre : (2,) principal point (x, y) [px]; lens shift moves it off the middle, or outside.
    distortion : (5,) or (4,) coefficients [-].
    """

    kind: LensKind
    focal: Array
    centre: Array
    distortion: Array


def lens_parameters(lens: Lens) -> Array:
    """Focal lengths x, y and centre x, y [px], then distortion [-]: (9,) Brown, (8,) fisheye."""
    return np.concatenate([lens.focal, lens.centre, lens.distortion])


def lens_of_parameters(lens: Lens, parameters: Array) -> Lens:
    """The inverse of `lens_parameters`, for a lens of the kind of `lens`."""
    return Lens(lens.kind, parameters[:2], parameters[2:4], parameters[4:])


def project(points: Array, lens: Lens) -> Array:
    """Pixels (..., 2) of points (..., 3) in the device's frame; NaN behind a pinhole."""
    if lens.kind == "brown":
        return _project_brown(points, lens)
    x, y, z = np.moveaxis(points, -1, 0)
    horizontal = np.hypot(x, y)
    theta = np.arctan2(horizontal, z)
    safe = np.where(horizontal > 0, horizontal, 1.0)
    scale = np.where(horizontal > 0, fisheye_radius(theta, lens.distortion) / safe, 0.0)
    return np.stack([x * scale, y * scale], axis=-1) * lens.focal + lens.centre


def project_with_derivatives(points: Array, lens: Lens) -> tuple[Array, Array, Array]:
    """`project` of points (N, 3), and its derivatives.

    By the point's coordinates (N, 2, 3) [px/m], and by `lens_parameters` (N, 2, P).
    """
    _, by_point, by_parameter = project_slopes(points, lens.kind, lens_parameters(lens))
    return project(points, lens), by_point, by_parameter


def project_before_fold(points: Array, lens: Lens) -> Array:
    """`project`, but NaN also where a pinhole's polynomial folds back: there no lens has a picture."""
    pixels = project(points, lens)
    if lens.kind != "brown":
        return pixels
    x, y, z = np.moveaxis(points, -1, 0)
    beyond = x * x + y * y >= _fold(lens.distortion) * z * z
    return np.where(beyond[..., None], np.nan, pixels)


def unproject(pixels: Array, lens: Lens) -> Array:
    """Unit rays (..., 3) of pixels (..., 2), in the device's frame."""
    if lens.kind == "kannala-brandt":
        return fisheye_rays(pixels, lens_parameters(lens))
    undistorted = _undistort_brown((pixels - lens.centre) / lens.focal, lens.distortion)
    ray = np.concatenate([undistorted, np.ones_like(undistorted[..., :1])], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def _project_brown(points: Array, lens: Lens) -> Array:
    depth = points[..., 2:]
    plane = points[..., :2] / np.where(depth > 0, depth, np.nan)
    return _distort_brown(plane, lens.distortion) * lens.focal + lens.centre


def _fold(k: Array) -> float:
    """Squared radius at which the radius in the picture stops to grow; infinite if it never does."""
    inverse = np.roots([1.0, 3 * k[0], 5 * k[1], 7 * k[4]])
    nearest = inverse.real[np.abs(inverse.imag) < SMALL * np.abs(inverse)].max(initial=SMALL)
    return float(1 / nearest)


def _distort_brown(plane: Array, k: Array) -> Array:
    """Brown (1966) with two tangential terms, coefficients in OpenCV's order."""
    x, y = plane[..., 0], plane[..., 1]
    k1, k2, p1, p2, k3 = k
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def _undistort_brown(distorted: Array, k: Array) -> Array:
    """Newton's method with the exact 2x2 Jacobian; fixed-point iteration fails for wide lenses."""
    k1, k2, p1, p2, k3 = k
    if not np.any(k):
        return distorted
    plane = distorted * _radial_start(distorted, k)
    for _ in range(NEWTON_STEPS):
        x, y = plane[..., 0], plane[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d(radial)/d(r^2) times 2
        jxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        jxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        jyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        error = _distort_brown(plane, k) - distorted
        determinant = jxx * jyy - jxy * jxy
        step = np.stack(
            [
                (jyy * error[..., 0] - jxy * error[..., 1]) / determinant,
                (jxx * error[..., 1] - jxy * error[..., 0]) / determinant,
            ],
            axis=-1,
        )
        plane = plane - step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-7:  # quadratic: the error is its square
            break
    return plane


def _radial_start(distorted: Array, k: Array) -> Array:
    """Undistorted over distorted radius (..., 1), interpolated from a table of the radial terms."""
    reach = np.sqrt(np.nanmax(np.sum(distorted**2, axis=-1), initial=0.0))
    radius = np.linspace(0, 1.5 * reach + 1e-9, 4096)
    r2 = radius * radius
    bent = radius * (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])))
    rising = int(np.argmax(np.diff(bent, append=-np.inf) <= 0)) + 1  # beyond it the lens folds
    length = np.sqrt(np.sum(distorted**2, axis=-1))
    straight = np.interp(length, bent[:rising], radius[:rising])
    return np.asarray(straight / np.maximum(length, 1e-30) + (length == 0))[..., None]
