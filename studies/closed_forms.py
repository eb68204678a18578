"""Forms of inter-reflection for comparison only: single bounces, zones, the paper's equations to the letter.

The paper is van Baar et al. 2011; docs/theory/interreflection.md says where its equations need correcting.
"""

import numpy as np
from numpy.typing import NDArray

from procam.maths.light.radiosity import flux

Array = NDArray[np.float64]


def add_zoned_interreflection(direct: Array, scatter: Array, collect: Array) -> Array:
    """Total radiosity (N, C) where scattered light depends on where the direct light fell.

    b = b0 + sum over zones z of u_z (w_z . b0): `scatter` (Z, N, C) is u of each zone, `collect`
    (Z, N) the solid angle [sr] of each patch in it. A single zone gives (I11). Zones may be
    projectors, quarters of the dome, or coarse patches of a furnished room.
    """
    direct_flux = np.einsum("zn,nc->zc", collect, direct)
    return np.asarray(direct + np.einsum("znc,zc->nc", scatter, direct_flux))


def remove_zoned_interreflection(total: Array, scatter: Array, collect: Array) -> Array:
    """Inverse of `add_zoned_interreflection`, by Woodbury's identity.

    w.b = (1 + W U) w.b0 is one system of Z unknowns per channel.
    """
    system = np.eye(len(collect)) + np.einsum("yn,znc->cyz", collect, scatter)
    total_flux = np.einsum("zn,nc->cz", collect, total)
    direct_flux = np.linalg.solve(system, total_flux[..., None])[..., 0]
    return np.asarray(total - np.einsum("znc,cz->nc", scatter, direct_flux))


def bounce(direct: Array, albedo: Array, solid_angle_sr: Array, order: int) -> Array:
    """Radiosity (N, C) of the `order`-th bounce alone (1, 2, ...) on a sphere.

    b^m_i = rho_i / (4 pi) kappa^(m-1) (a.b0), kappa = a.rho / (4 pi): (I8), paper eq. 9 corrected. The
    patches are all that reflects.
    """
    kappa = flux(albedo, solid_angle_sr) / (4 * np.pi)
    return np.asarray(albedo / (4 * np.pi) * kappa ** (order - 1) * flux(direct, solid_angle_sr))


def bounce_paper(direct: Array, albedo: float, solid_angle_sr: Array, order: int) -> Array:
    """Paper eq. 9 to the letter, (rho/A_s)^m a^(m-1) (a.b0), for one albedo; see `bounce`.

    Exact only if the patches are ALL that reflects and have that albedo.
    """
    share = albedo / (4 * np.pi)
    area = float(np.sum(solid_angle_sr))
    light = share**order * area ** (order - 1) * flux(direct, solid_angle_sr)
    return np.asarray(np.broadcast_to(light, direct.shape))


def add_interreflection_paper(direct: Array, albedo: float, solid_angle_sr: Array) -> Array:
    """Paper eq. 10 to the letter, b = b0 + rho / (A_s - a rho) (a.b0).

    With the lit area alone it understates the scattered light by (1 - rho f_R) / (1 - rho f_L), f_R
    and f_L the shares of the sphere that reflect and that are lit.
    """
    area = float(np.sum(solid_angle_sr))
    return np.asarray(direct + albedo / (4 * np.pi - area * albedo) * flux(direct, solid_angle_sr))


def remove_interreflection_paper(total: Array, albedo: Array, solid_angle_sr: Array) -> Array:
    """Paper eq. 12 to the letter, b0 = b - rho/A_s (a.b).

    Exact only if the patches are ALL that reflects; with the lit area alone it understates the
    scattered light.
    """
    sphere_sr = 4 * np.pi
    return np.asarray(total - albedo / sphere_sr * flux(total, solid_angle_sr))
