"""Rays of a fisheye's pixels."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from procam.arrays import Array
from procam.errors import InputError
from procam.kernels.bundle import lenses as reference
from procam.kernels.native.arrays import numbers, pointer
from procam.kernels.native.loader import chosen


def fisheye_rays(pixels: ArrayLike, lens: Array) -> Array:
    """Unit rays (..., 3) of pixels (..., 2) of a Kannala-Brandt lens.

    Kannala & Brandt 2006, doi:10.1109/TPAMI.2006.153: r = theta + k1 theta^3 + ... + k4 theta^9,
    inverted by Newton's method from a table.

    Parameters
    ----------
    pixels : (..., 2) [px].
    lens : (8,) focal x, y, centre x, y [px], k1..k4 [-].

    Returns
    -------
    (..., 3) float64; z along the view. NaN where a pixel is; any direction where a pixel lies
        beyond the radius at which the lens folds.

    Raises
    ------
    ShapeError, InputError
        Pixels that are no pairs, a lens of another number of parameters, one that is not finite or that
        folds at its centre.

    Examples
    --------
    >>> lens = np.array([100.0, 100, 320, 240, 0, 0, 0, 0])
    >>> print(fisheye_rays([320, 240 + 25 * np.pi], lens).round(6))
    [0.       0.707107 0.707107]
    """
    places = np.asarray(pixels)
    places = numbers(places, (*places.shape[:-1], 2), "pixels")
    lens = numbers(lens, (8,), "lens")
    if not np.isfinite(lens).all() or not lens[:2].all():
        raise InputError(f"lens: {lens}; all must be finite, and the focal lengths not 0")
    native = chosen()
    if native is None:
        return reference.fisheye_rays(places, lens)
    library, level, threads = native
    table, last = _angles(*lens[4:].tolist())
    if not last > 0:
        raise InputError(f"lens: with k {lens[4:]} it folds at its centre, and no pixel has a ray")
    rays = np.empty((*places.shape[:-1], 3))
    library.procam_rays(
        *(level, threads, places.size // 2, pointer(places), pointer(lens), table.size),
        *(pointer(table), (table.size - 1) / last, pointer(rays)),
    )
    return rays


@lru_cache(maxsize=32)
def _angles(*k: float) -> tuple[Array, float]:
    """Angles (KNOTS,) [rad] at equal steps of the radius up to where the lens folds, and that radius."""
    theta = np.linspace(0, np.pi, reference.KNOTS)
    reach = reference.fisheye_radius(theta, np.array(k))
    rising = int(np.argmax(np.diff(reach, append=-np.inf) <= 0)) + 1
    radius = np.linspace(0, reach[rising - 1], reference.KNOTS)
    return np.interp(radius, reach[:rising], theta[:rising]), float(reach[rising - 1])
