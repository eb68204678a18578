"""Normal equations and residuals of the bundle adjustment, for one camera and one projector."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.kernels.bundle import reference
from procam.kernels.bundle.reference import Device, Equations, Relief, Sight
from procam.kernels.native.arrays import plain, pointer
from procam.kernels.native.loader import chosen

Double = NDArray[np.float64]
BLOCK = 64  # observations that C takes at a time
LEAST, TILES = 512, 16  # observations of a share of the work; shares at most
LANES = 8  # PARTIAL of native/kernels.h
MOST_COLUMNS = 128  # of slopes and the residual
LENS = {"brown": 9, "kannala-brandt": 8}


class _Sight(ctypes.Structure):
    """`struct procam_bundle` of native/kernels.h."""

    _fields_ = (
        *((n, ctypes.c_int) for n in ("waves", "fisheye_camera", "fisheye_projector", "lens_free")),
        ("radius", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("camera", "projector", "bumps")),
        *((name, ctypes.c_void_p) for name in ("rays", "seen", "weight")),
        *((name, ctypes.c_void_p) for name in ("start", "values", "slopes")),
    )


def bundle_equations(
    sight: Sight,
    ray: Double,
    seen: Double,
    weight: Double,
    relief: Relief | None = None,
    lens_free: bool = False,
) -> Equations:
    """Normal matrix, gradient and cost of what a camera sees of a projector on a round screen.

    Parameters
    ----------
    sight : camera, projector and screen.
    ray : (N, 3) unit rays in the camera's frame.
    seen : (N, 2) projector pixels that they were seen to end on [px].
    weight : (N,) of the squares of both coordinates [1/px^2].
    relief : of the screen where the rays meet it; None for an exact sphere.
    lens_free : whether lens and pupil of the camera are solved for; their rows stay 0 if not.

    Returns
    -------
    Equations
        matrix (T, T) = sum of w J^T J, gradient (T,) = sum of w J^T r, cost = sum of w |r|^2, for
        predicted minus seen pixels r and their slopes J (2, T) by (1 + K of the screen) log radius
        and bumps, (6 + L + 2 of the camera) turn [rad], shift [m], lens, pupil, and (6 + L of the
        projector) turn, shift, lens. Observations of which anything is NaN or infinite (a ray that
        misses, a point behind the projector) count as nothing. The same whatever the threads.

    Raises
    ------
    InputError
        If shapes or types do not fit one another.

    Examples
    --------
    >>> import numpy as np
    >>> lens = np.array([100.0, 100, 0, 0, 0, 0, 0, 0, 0])
    >>> device = Device(np.eye(3), np.zeros(3), "brown", lens, np.zeros(2))
    >>> ray, seen = np.array([[0.0, 0, 1]]), np.array([[2.0, 0]])
    >>> found = bundle_equations(Sight(device, device, 5.0, np.zeros(0)), ray, seen, np.ones(1))
    >>> print(found.cost, found.gradient[-9:-5])
    4.0 [ 0.  0. -2.  0.]
    """
    _check(sight, ray, seen, weight, relief)
    native = chosen()
    if native is None:
        return reference.bundle_equations(sight, ray, seen, weight, relief, lens_free)
    columns = np.ones(reference.column_count(sight), bool)
    columns[1 + len(sight.bumps) + 6 : -(6 + len(sight.projector.lens))] = lens_free
    used, count = int(columns.sum()) + 1, len(ray)
    tile = max(LEAST, -(-count // (TILES * BLOCK)) * BLOCK)
    room = np.empty((-(-count // tile), *[-(-used // 4) * 4] * 2, LANES))
    products = np.empty((used, used))
    described = _described(sight, (ray, seen, weight), relief, lens_free)
    library, level, threads = native
    library.procam_bundle(
        *(level, threads, count, ctypes.byref(described), used, tile),
        *(pointer(room), pointer(products)),
    )
    matrix, gradient = np.zeros((columns.size, columns.size)), np.zeros(columns.size)
    matrix[np.ix_(columns, columns)], gradient[columns] = products[:-1, :-1], products[:-1, -1]
    return Equations(matrix, gradient, float(products[-1, -1]))


def bundle_misses(sight: Sight, ray: Double, seen: Double, relief: Relief | None = None) -> Double:
    """Projector pixels (N, 2) that a rig predicts minus those that were seen; NaN without answer.

    The arguments are those of `bundle_equations`.
    """
    _check(sight, ray, seen, None, relief)
    native = chosen()
    if native is None:
        return reference.bundle_misses(sight, ray, seen, relief)
    library, level, threads = native
    misses, described = np.empty((len(ray), 2)), _described(sight, (ray, seen, None), relief, False)
    library.procam_misses(level, threads, len(ray), ctypes.byref(described), pointer(misses))
    return misses


def _described(
    sight: Sight, given: tuple[Double | None, ...], relief: Relief | None, lens_free: bool
) -> Any:
    """The sight as C takes it."""
    arrays = (sight.bumps, *given, *(relief or ()))
    ready = [None if a is None else plain(np.asarray(a, np.float64)) for a in arrays]
    kept = [_numbers(sight.camera), _numbers(sight.projector), *ready]
    found = _Sight(
        0 if relief is None else len(sight.bumps),
        *(device.kind == "kannala-brandt" for device in sight[:2]),
        *(lens_free, sight.radius_m, *map(pointer, kept)),
    )
    found.kept = kept
    return found


def _numbers(device: Device) -> Double:
    """`struct placed` of sight.h: turn, shift, lens made up to that of Brown, pupil."""
    rest = np.zeros(LENS["brown"] - len(device.lens))
    parts = [np.ravel(device.rotation), device.translation, device.lens, rest, device.pupil]
    return np.concatenate(parts).astype(np.float64)


def _check(
    sight: Sight, ray: Double, seen: Double, weight: Double | None, relief: Relief | None
) -> None:
    """Refuse rays, pixels, weights, lenses and a relief that do not fit one another."""
    count, waves = len(ray), len(sight.bumps)
    wanted: dict[str, tuple[Double, tuple[int, ...]]]
    wanted = {"ray": (ray, (count, 3)), "seen": (seen, (count, 2))}
    if weight is not None:
        wanted["weight"] = (weight, (count,))
    if relief is not None:
        wanted |= {"start": (relief.start, (count, 3)), "values": (relief.values, (count, waves))}
        wanted |= {"slopes": (relief.slopes, (count, waves, 3))}
    elif waves:
        raise InputError(f"relief: got none for {waves} bumps, expected where the rays meet them")
    for name, (array, shape) in wanted.items():
        if array.shape != shape:
            raise ShapeError(name, array.shape, f"{shape}")
    for device in sight[:2]:
        if len(device.lens) != LENS.get(device.kind):
            raise InputError(f"lens: got {device.kind!r} of {len(device.lens)}, expected {LENS}")
    if reference.column_count(sight) >= MOST_COLUMNS:
        raise InputError(f"bumps: got {waves}, expected {MOST_COLUMNS - 34} at most")
