"""Add and remove the light that bounces between the faces of a mesh (paper eqs. 3, 11)."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from procam.errors import CalibrationError, InputError

Array = NDArray[np.float64]
Matrix = NDArray[np.float32]
LEFT = 1e-7  # of the light, that a solution may leave unaccounted for
ROUNDS = 200
POWERS = 60  # products until the largest gain per bounce is known


def add_bounces(direct: Array, albedo: Array, factors: Matrix) -> Array:
    """Total radiosity (N, C) of faces whose direct one is (N, C) [rel], after all bounces.

    b = (I - rho F)^-1 b0, paper eq. 3. `albedo` (N, C) [-], `factors` (N, N) of `form_factors`.

    Raises
    ------
    InputError
        If the room would win light with every bounce.
    CalibrationError
        If no solution is found.
    """
    check_darkens(albedo, factors)
    columns = [_solved(direct[:, c], albedo[:, c], factors) for c in range(direct.shape[1])]
    return np.stack(columns, axis=1)


def remove_bounces(total: Array, albedo: Array, factors: Matrix) -> Array:
    """Direct radiosity (N, C) behind a total one (N, C): b0 = b - rho F b, paper eq. 11."""
    return np.asarray(total - albedo * (factors @ total.astype(np.float32)))


def check_darkens(albedo: Array, factors: Matrix) -> None:
    """Refuse a room that keeps all of its light: its largest gain per bounce must be below 1."""
    if not (albedo >= 0).all():
        raise InputError(f"albedo: got {albedo.min():.3g} at least, expected 0 or more")
    kept = factors.sum(axis=1, dtype=float)
    for channel in albedo.T:
        if (channel * kept).max() < 1:  # a bound on the gain
            continue
        gain = _largest_gain(channel, factors)
        if gain >= 1:
            raise InputError(
                f"albedo: got a room that gives back {gain:.4g} of its light at every bounce, "
                "expected less than 1; an albedo of 1 in a closed room never darkens"
            )


def _largest_gain(albedo: Array, factors: Matrix) -> float:
    """Spectral radius of rho F: all entries are positive, so that powers find it."""
    light, gain = np.ones(len(albedo)), 0.0
    for _ in range(POWERS):
        light = albedo * (factors @ light.astype(np.float32))
        gain = float(np.abs(light).max())
        if gain == 0:
            return 0.0
        light /= gain
    return gain + 1e-6  # what single precision leaves open


def _solved(direct: Array, albedo: Array, factors: Matrix) -> Array:
    def left(total: Array) -> Array:
        return np.asarray(total - albedo * (factors @ total.astype(np.float32)))

    size = len(direct)
    system = LinearOperator((size, size), matvec=left, dtype=float)
    total, failed = gmres(system, direct, rtol=LEFT, atol=0.0, restart=30, maxiter=ROUNDS)
    if failed:
        raise CalibrationError(
            f"light between faces: got no balance in {ROUNDS} rounds, expected one in about 10; is an "
            "albedo next to 1?"
        )
    return np.asarray(total)
