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


def floor_return(half_angle: float, tilt: float, floor_albedo: float) -> float:
    """Share of a cap's light [-] that a level Lambertian floor sends back to it.

    The floor is the disc that the level plane through the rim's lowest point cuts out of the
    sphere; between it and the rim the room is black. Light of a sphere's patch spreads evenly
    over the whole sphere (paper eq. 7), so what reaches the floor is the share of the sphere
    below its plane, and reciprocity gives the way back.

    >>> round(floor_return(np.pi / 2, 0.0, 0.2), 9)  # a floor that closes a hemisphere
    0.1
    """
    depth = -np.cos(min(half_angle + abs(tilt), np.pi))  # of the plane below the centre, in radii
    to_floor = (1 - depth) / 2
    cap = 4 * np.pi * np.sin(half_angle / 2) ** 2
    back = cap * to_floor / (np.pi * (1 - depth**2))
    return float(to_floor * floor_albedo * back)


def albedo_from_feedback(
    feedback: Array, lit_sr: float, screen_sr: float, returned: float = 0.0
) -> Array:
    """Mean albedo (C,) of a cap whose lit part feeds back `feedback` (C,) [-].

    The cap of `screen_sr` is taken to have one albedo, lit (`lit_sr`) or not; `returned` is what
    its floor sends back. m = rho K a_L / (1 - rho K a_R) with K = (1 + returned / f) / (4 pi) and
    f = a_R / 4 pi, the form of science.md s.1 for a cap closed by a floor.
    """
    if not 0 < lit_sr <= screen_sr * (1 + 1e-9):
        raise InputError(
            f"lit solid angle: got {lit_sr:.4g} sr, expected between 0 and the screen's "
            f"{screen_sr:.4g} sr; check half_angle_deg in venue.toml"
        )
    fraction = screen_sr / (4 * np.pi)
    kernel = (1 + returned / fraction) / (4 * np.pi)
    return np.asarray(feedback / (kernel * (lit_sr + feedback * screen_sr)))
