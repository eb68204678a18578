"""Add and remove the inter-reflection of a concave screen (docs/theory/interreflection.md).

On a sphere every patch lights every other alike, so all bounces of all patches depend on the picture
through one scalar per channel, its direct flux a.b0. In the measured form u (`scatter_per_flux`) is the
scattered radiosity per unit of that flux, and the feedback m = a.u is total over direct flux, less 1.
`sphere_scatter` computes u from albedo and area.
"""

import numpy as np

from procam.arrays import Array
from procam.errors import InputError, ShapeError

ROUNDING = 1e-9


def flux(radiosity: Array, solid_angle_sr: Array) -> Array:
    """Flux a.b (C,) [rel sr] of radiosity (N, C) over patches of `solid_angle_sr` (N,)."""
    light, area = np.asarray(radiosity), np.asarray(solid_angle_sr)
    if light.ndim != 2:
        raise ShapeError("radiosity", light.shape, "(N, C), patches and channels")
    if area.shape != light.shape[:1]:
        raise ShapeError("solid_angle_sr", area.shape, f"({light.shape[0]},)")
    return np.asarray(area @ light)


def _checked(light: Array, scatter_per_flux: Array) -> Array:
    """Scatter per flux (N, C) that fits the light (N, C)."""
    scatter = np.asarray(scatter_per_flux)
    if scatter.shape != np.shape(light):
        raise ShapeError("scatter_per_flux", scatter.shape, f"{np.shape(light)} like the light")
    return scatter


def add_interreflection(direct: Array, scatter_per_flux: Array, solid_angle_sr: Array) -> Array:
    """Total radiosity (N, C) [rel] of direct radiosity (N, C), all bounces included.

    b_i = b0_i + u_i (a.b0), docs/theory/interreflection.md (I11); exact on a sphere.

    Parameters
    ----------
    direct : (N, C) radiosity of N patches and C channels [rel].
    scatter_per_flux : (N, C) u of (I10) [1/sr], as from `sphere_scatter`.
    solid_angle_sr : (N,) of the patches, seen from the sphere's centre [sr].

    Returns
    -------
    total : (N, C) [rel].

    Raises
    ------
    ShapeError
        If the numbers of patches or channels differ.

    Examples
    --------
    >>> u, a = np.full((4, 1), 0.1), np.ones(4)
    >>> add_interreflection(np.ones((4, 1)), u, a).ravel().tolist()
    [1.4, 1.4, 1.4, 1.4]
    """
    total_flux = flux(direct, solid_angle_sr)
    return np.asarray(direct + _checked(direct, scatter_per_flux) * total_flux)


def remove_interreflection(total: Array, scatter_per_flux: Array, solid_angle_sr: Array) -> Array:
    """Direct radiosity (N, C) [rel] of a total one (N, C); the inverse of `add_interreflection`.

    b0_i = b_i - u_i (a.b) / (1 + m), m = a.u: docs/theory/interreflection.md (I12).

    Parameters
    ----------
    total : (N, C) radiosity of N patches and C channels [rel].
    scatter_per_flux : (N, C) u of (I10) [1/sr], as from `sphere_scatter`.
    solid_angle_sr : (N,) of the patches, seen from the sphere's centre [sr].

    Returns
    -------
    direct : (N, C) [rel].

    Raises
    ------
    ShapeError
        If the numbers of patches or channels differ.

    Examples
    --------
    >>> u, a = np.full((4, 1), 0.1), np.ones(4)
    >>> remove_interreflection(np.full((4, 1), 1.4), u, a).ravel().round(9).tolist()
    [1.0, 1.0, 1.0, 1.0]
    """
    total_flux = flux(total, solid_angle_sr)
    scatter = _checked(total, scatter_per_flux)
    return np.asarray(total - scatter * total_flux / (1 + flux(scatter, solid_angle_sr)))


def sphere_scatter(albedo: Array, solid_angle_sr: Array, returned: float = 0.0) -> Array:
    """Scattered radiosity per flux u (N, C) [1/sr] of all that reflects on a sphere or cap, lit or not.

    u_i = rho_i K / (1 - K sum_j a_j rho_j) with K = (1 + returned / f) / (4 pi) and f the cap's share
    of the sphere: docs/theory/interreflection.md (I6), (I15). A patch that several projectors light
    counts once.

    Parameters
    ----------
    albedo : (N, C) of N patches and C channels [-]. solid_angle_sr : (N,) of the patches [sr].
    returned : share of its light that a floor returns to the cap, from `floor_return` [-].

    Returns
    -------
    scatter_per_flux : (N, C) [1/sr].

    Raises
    ------
    InputError
        If albedo is not within 0 to 1, solid angles are below 0 or sum to 0 or more than a sphere, or the
        room would reflect as much light as it receives, or more.

    Examples
    --------
    >>> u = sphere_scatter(np.full((1, 1), 0.5), np.array([2 * np.pi]))  # a hemisphere
    >>> round(float(u[0, 0] * 2 * np.pi), 9)  # m = kappa / (1 - kappa), kappa = 0.25
    0.333333333
    """
    received = flux(albedo, solid_angle_sr)
    fraction = float(np.sum(solid_angle_sr)) / (4 * np.pi)
    if not ((np.asarray(albedo) >= 0) & (np.asarray(albedo) <= 1)).all():
        raise InputError("albedo: each value needs to be between 0 and 1")
    if not (np.asarray(solid_angle_sr) >= 0).all() or not 0 < fraction <= 1 + ROUNDING:
        raise InputError(
            f"solid_angle_sr: the sum is {4 * np.pi * fraction:.4g} sr; none may be below 0, and the sum "
            "needs to be above 0 and at most that of a sphere, 4 pi"
        )
    if not 0 <= returned < 1:
        raise InputError(
            f"returned: {returned} is no share of light; it needs to be from 0 to below 1"
        )
    kernel = (1 + returned / fraction) / (4 * np.pi)
    kappa = kernel * received
    if (kappa > 1 - ROUNDING).any():
        raise InputError(
            f"albedo: the room reflects {kappa.max():.3g} of its light at every bounce; it needs to "
            "reflect less than 1, so lower the albedo"
        )
    return np.asarray(albedo * kernel / (1 - kappa))


def floor_return(half_angle: float, tilt: float, floor_albedo: float) -> float:
    """Share of a cap's light [-] that a level Lambertian floor returns to it.

    The floor is the disc that the level plane through the rim's lowest point cuts out of the sphere;
    between it and the rim the room is black. Light from a patch of a sphere is uniform over the whole
    sphere (I5), so the floor receives the share of the sphere below its plane; reciprocity gives the
    share that it returns (I14).

    >>> round(floor_return(np.pi / 2, 0.0, 0.2), 9)  # a floor that closes a hemisphere
    0.1
    """
    depth = -np.cos(min(half_angle + abs(tilt), np.pi))  # floor below the centre, in radii
    to_floor = (1 - depth) / 2
    cap = 4 * np.pi * np.sin(half_angle / 2) ** 2
    back = cap * to_floor / (np.pi * (1 - depth**2))
    return float(to_floor * floor_albedo * back)


def albedo_from_feedback(
    feedback: Array, lit_sr: float, screen_sr: float, returned: float = 0.0
) -> Array:
    """Mean albedo (C,) of a cap from its feedback (C,) [-].

    Assumes one albedo for the whole cap of `screen_sr`, of which `lit_sr` is lit; `returned` is from
    `floor_return`. Solves m = rho K a_L / (1 - rho K a_R) for rho, with K = (1 + returned / f) / (4 pi)
    and f = a_R / 4 pi: (I15) over the lit part.

    Raises
    ------
    InputError
        If the lit part is empty or larger than the cap.
    """
    if not 0 < lit_sr <= screen_sr * (1 + 1e-9):
        raise InputError(
            f"the lit solid angle is {lit_sr:.4g} sr; it needs to be between 0 and the screen's "
            f"{screen_sr:.4g} sr, so check half_angle_deg in venue.toml"
        )
    fraction = screen_sr / (4 * np.pi)
    kernel = (1 + returned / fraction) / (4 * np.pi)
    return np.asarray(feedback / (kernel * (lit_sr + feedback * screen_sr)))
