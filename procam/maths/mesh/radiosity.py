"""Add and remove inter-reflected light between the faces of a mesh (docs/theory/interreflection.md)."""

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from procam.arrays import Array, Array32
from procam.errors import CalibrationError, InputError

ACCURACY = 1e-7  # relative residual of a solution
ROUNDS = 200
POWERS = 60  # iterations of the power method
SINGLE = 1e-6  # error of a gain that is computed in single precision


def add_mesh_interreflection(direct: Array, albedo: Array, factors: Array32) -> Array:
    """Total radiosity (N, C) of faces with direct radiosity (N, C) [rel].

    b = (I - rho F)^-1 b0, docs/theory/interreflection.md (I3). `albedo` (N, C) [-], `factors` (N, N)
    of `form_factors`.

    Raises
    ------
    InputError
        If the room would gain light with every bounce.
    CalibrationError
        If the solver does not converge.
    """
    check_gain(albedo, factors)
    columns = [_solved(direct[:, c], albedo[:, c], factors) for c in range(direct.shape[1])]
    return np.stack(columns, axis=1)


def remove_mesh_interreflection(total: Array, albedo: Array, factors: Array32) -> Array:
    """Direct radiosity (N, C) of a total one (N, C): docs/theory/interreflection.md (I4)."""
    return np.asarray(total - albedo * (factors @ total.astype(np.float32)))


def check_gain(albedo: Array, factors: Array32) -> None:
    """Refuse a room whose gain per bounce, the spectral radius of rho F, is not below 1."""
    if not (albedo >= 0).all():
        raise InputError(f"albedo: the lowest is {albedo.min():.3g}; an albedo is 0 or more")
    kept = factors.sum(axis=1, dtype=float)
    for channel in albedo.T:
        if (channel * kept).max() < 1:  # a bound on the gain
            continue
        gain = _largest_gain(channel, factors)
        if gain >= 1:
            raise InputError(
                f"albedo: the room returns {gain:.4g} of its light at every bounce and would never get "
                "dark. Lower the albedos, or open the mesh."
            )


def _largest_gain(albedo: Array, factors: Array32) -> float:
    """Spectral radius of rho F, whose entries are not negative, by the power method."""
    light, gain = np.ones(len(albedo)), 0.0
    for _ in range(POWERS):
        light = albedo * (factors @ light.astype(np.float32))
        gain = float(np.abs(light).max())
        if gain == 0:
            return 0.0
        light /= gain
    return gain + SINGLE


def _solved(direct: Array, albedo: Array, factors: Array32) -> Array:
    def product(total: Array) -> Array:
        return np.asarray(total - albedo * (factors @ total.astype(np.float32)))

    size = len(direct)
    system = LinearOperator((size, size), matvec=product, dtype=float)
    total, failed = gmres(system, direct, rtol=ACCURACY, atol=0.0, restart=30, maxiter=ROUNDS)
    if failed:
        raise CalibrationError(
            f"light between faces: no solution after {ROUNDS} rounds, where 10 are usual. Check that no "
            "albedo is close to 1."
        )
    return np.asarray(total)
