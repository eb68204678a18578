"""Add and remove the light that bounces round a concave screen (science.md s.1).

Measured form: u (`scatter_per_flux`) is the scattered radiosity per unit of direct flux, so all
bounces of all patches are one scalar per colour and m = a.u (`feedback`) is how much light they add.
"""

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError

Array = NDArray[np.float64]


def flux(radiosity: Array, solid_angle_sr: Array) -> Array:
    """Total a.b (C,) [rel sr] of radiosities (N, C) over patches of `solid_angle_sr` (N,)."""
    if radiosity.shape[:1] != solid_angle_sr.shape:
        raise ShapeError("solid_angle_sr", solid_angle_sr.shape, f"({radiosity.shape[0]},)")
    return np.asarray(solid_angle_sr @ radiosity)


def add_interreflection(direct: Array, scatter_per_flux: Array, solid_angle_sr: Array) -> Array:
    """Total radiosity (N, C) that direct radiosity (N, C) [rel] becomes after all bounces.

    b_i = b0_i + u_i (a.b0), the measured form of science.md s.1; exact on a sphere.

    >>> u, a = np.full((4, 1), 0.1), np.ones(4)
    >>> add_interreflection(np.ones((4, 1)), u, a).ravel().tolist()
    [1.4, 1.4, 1.4, 1.4]
    """
    return np.asarray(direct + scatter_per_flux * flux(direct, solid_angle_sr))


def remove_interreflection(total: Array, scatter_per_flux: Array, solid_angle_sr: Array) -> Array:
    """Direct radiosity (N, C) behind a total one (N, C) [rel]; the inverse of the above.

    b0_i = b_i - u_i (a.b) / (1 + m), m = a.u: paper eq. 12 with its correction (science.md s.1).
    """
    feedback = flux(scatter_per_flux, solid_angle_sr)
    return np.asarray(total - scatter_per_flux * flux(total, solid_angle_sr) / (1 + feedback))


def remove_interreflection_paper(total: Array, albedo: Array, solid_angle_sr: Array) -> Array:
    """Paper eq. 12 to the letter, b0 = b - rho/A_s (a.b), kept for comparison.

    Exact only if the patches given are ALL that reflects: with the lit area alone it understates
    the pollution wherever anything else in the room reflects (science.md s.1).
    """
    sphere_sr = 4 * np.pi
    return np.asarray(total - albedo / sphere_sr * flux(total, solid_angle_sr))


def albedo_from_feedback(
    feedback: Array, lit_sr: float, screen_sr: float, floor_albedo: float
) -> Array:
    """Mean albedo (C,) of a cap whose lit part feeds back `feedback` (C,) [-].

    The cap of `screen_sr` is taken to have one albedo, lit (`lit_sr`) or not, and to be closed by
    a Lambertian floor: m = rho K a_L / (1 - rho K a_R), K = [1 + rho_f (1-f)/f] / (4 pi), f = a_R / 4 pi
    (science.md s.1, "cap closed by a floor").
    """
    if not 0 < lit_sr <= screen_sr * (1 + 1e-9):
        raise InputError(
            f"lit solid angle: got {lit_sr:.4g} sr, expected between 0 and the screen's "
            f"{screen_sr:.4g} sr; check half_angle_deg in venue.toml"
        )
    fraction = screen_sr / (4 * np.pi)
    kernel = (1 + floor_albedo * (1 - fraction) / fraction) / (4 * np.pi)
    return np.asarray(feedback / (kernel * (lit_sr + feedback * screen_sr)))
