"""Normal equations and residuals of the bundle adjustment, for one camera and one projector.

A camera ray meets the round screen in a point, and the projector's lens predicts the pixel that lights
it. The residual is predicted less decoded pixel. There are no points among the unknowns: the screen is
a sphere with a few harmonics, so each observation adds two rows. C fills the rows of 64 observations,
multiplies them by their transpose and keeps the sums; nothing of the size of the Jacobian is stored.
"""

import ctypes
from typing import Any

import numpy as np

from procam.arrays import Array
from procam.errors import InputError, ShapeError
from procam.kernels.bundle import reference
from procam.kernels.bundle.reference import (
    NormalEquations,
    ObservationBlock,
    PlacedDevice,
    ShapeDerivatives,
)
from procam.kernels.native.arrays import numbers, plain, pointer
from procam.kernels.native.loader import chosen

BLOCK = 64  # observations that C takes at a time
LEAST, TILES = 512, 16  # observations of a share of the work; shares at most
LANES = 8  # PARTIAL of native/kernels.h
MOST_COLUMNS = 128  # of slopes and the residual
LENS = {"brown": 9, "kannala-brandt": 8}


class _Block(ctypes.Structure):
    """`struct procam_bundle` of native/kernels.h."""

    _fields_ = (
        *(
            (n, ctypes.c_int)
            for n in ("harmonics", "fisheye_camera", "fisheye_projector", "lens_free")
        ),
        ("radius", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("camera", "projector", "harmonic_coefficients")),
        *((name, ctypes.c_void_p) for name in ("rays", "seen", "weight")),
        *((name, ctypes.c_void_p) for name in ("start", "values", "slopes")),
    )


def bundle_equations(
    block: ObservationBlock,
    ray: Array,
    seen: Array,
    weight: Array,
    derivatives: ShapeDerivatives | None = None,
    lens_free: bool = False,
) -> NormalEquations:
    """Normal matrix, gradient and cost of the observations of one projector by one camera.

    Parameters
    ----------
    block : camera, projector and screen.
    ray : (N, 3) unit rays in the camera's frame.
    seen : (N, 2) projector pixels decoded there [px].
    weight : (N,) of the squares of both coordinates [1/px^2].
    derivatives : of the screen's shape where the rays meet it; None for an exact sphere.
    lens_free : whether lens and pupil of the camera are solved for; if not, their rows stay 0.

    Returns
    -------
    NormalEquations
        matrix (T, T) = sum of w J^T J, gradient (T,) = sum of w J^T r, cost = sum of w |r|^2, with
        residuals r = predicted - seen [px] and their derivatives J (2, T) by the parameters: screen
        (1 + K: log radius, harmonic coefficients), camera (6 + L + 2: rotation [rad], translation
        [m], lens, pupil), projector (6 + L: rotation, translation, lens). An observation with NaN or
        infinity anywhere (a ray that misses, a point behind the projector) has no weight. Results do
        not depend on the number of threads.

    Raises
    ------
    InputError
        If shapes or types do not fit one another.

    Examples
    --------
    >>> import numpy as np
    >>> lens = np.array([100.0, 100, 0, 0, 0, 0, 0, 0, 0])
    >>> device = PlacedDevice(np.eye(3), np.zeros(3), "brown", lens, np.zeros(2))
    >>> ray, seen = np.array([[0.0, 0, 1]]), np.array([[2.0, 0]])
    >>> found = bundle_equations(ObservationBlock(device, device, 5.0, np.zeros(0)), ray, seen, np.ones(1))
    >>> print(found.cost, found.gradient[-9:-5])
    4.0 [ 0.  0. -2.  0.]
    """
    _check(block, ray, seen, weight, derivatives)
    native = chosen()
    if native is None:
        return reference.bundle_equations(block, ray, seen, weight, derivatives, lens_free)
    columns = np.ones(reference.column_count(block), bool)
    columns[1 + len(block.harmonic_coefficients) + 6 : -(6 + len(block.projector.lens))] = lens_free
    used, count = int(columns.sum()) + 1, len(ray)
    tile = max(LEAST, -(-count // (TILES * BLOCK)) * BLOCK)
    tiles = np.empty((-(-count // tile), *[-(-used // 4) * 4] * 2, LANES))
    products = np.empty((used, used))
    described = _c_block(block, (ray, seen, weight), derivatives, lens_free)
    library, level, threads = native
    library.procam_bundle(
        *(level, threads, count, ctypes.byref(described), used, tile),
        *(pointer(tiles), pointer(products)),
    )
    matrix, gradient = np.zeros((columns.size, columns.size)), np.zeros(columns.size)
    matrix[np.ix_(columns, columns)], gradient[columns] = products[:-1, :-1], products[:-1, -1]
    return NormalEquations(matrix, gradient, float(products[-1, -1]))


def bundle_residuals(
    block: ObservationBlock, ray: Array, seen: Array, derivatives: ShapeDerivatives | None = None
) -> Array:
    """Projector pixels (N, 2) predicted minus those seen; NaN where a ray or point has no image.

    The arguments are those of `bundle_equations`.
    """
    _check(block, ray, seen, None, derivatives)
    native = chosen()
    if native is None:
        return reference.bundle_residuals(block, ray, seen, derivatives)
    library, level, threads = native
    residuals, described = (
        np.empty((len(ray), 2)),
        _c_block(block, (ray, seen, None), derivatives, False),
    )
    library.procam_residuals(level, threads, len(ray), ctypes.byref(described), pointer(residuals))
    return residuals


def _c_block(
    block: ObservationBlock,
    given: tuple[Array | None, ...],
    derivatives: ShapeDerivatives | None,
    lens_free: bool,
) -> Any:
    """The block as `struct procam_bundle`."""
    arrays = (block.harmonic_coefficients, *given, *(derivatives or ()))
    ready = [None if a is None else plain(np.asarray(a, np.float64)) for a in arrays]
    kept = [_numbers(block.camera), _numbers(block.projector), *ready]
    found = _Block(
        0 if derivatives is None else len(block.harmonic_coefficients),
        *(device.kind == "kannala-brandt" for device in block[:2]),
        *(lens_free, block.radius_m, *map(pointer, kept)),
    )
    found.kept = kept
    return found


def _numbers(device: PlacedDevice) -> Array:
    """`struct placed` of block.h: turn, shift, lens made up to that of Brown, pupil."""
    rest = np.zeros(LENS["brown"] - len(device.lens))
    parts = [np.ravel(device.rotation), device.translation, device.lens, rest, device.pupil]
    return np.concatenate(parts).astype(np.float64)


def _check(
    block: ObservationBlock,
    ray: Array,
    seen: Array,
    weight: Array | None,
    derivatives: ShapeDerivatives | None,
) -> None:
    """Refuse rays, pixels, weights, lenses and derivatives that do not fit one another."""
    if ray.ndim != 2:
        raise ShapeError("ray", ray.shape, "(N, 3)")
    count, harmonics = len(ray), len(block.harmonic_coefficients)
    wanted: dict[str, tuple[Array, tuple[int, ...]]]
    wanted = {"ray": (ray, (count, 3)), "seen": (seen, (count, 2))}
    if weight is not None:
        wanted["weight"] = (weight, (count,))
    if derivatives is not None:
        wanted |= {
            "start": (derivatives.start, (count, 3)),
            "values": (derivatives.values, (count, harmonics)),
        }
        wanted |= {"slopes": (derivatives.slopes, (count, harmonics, 3))}
    elif harmonics:
        raise InputError(
            f"derivatives: the screen has {harmonics} harmonic coefficients, so their derivatives where the "
            "rays meet it are needed"
        )
    for name, (array, shape) in wanted.items():
        numbers(array, shape, name)
    numbers(block.harmonic_coefficients, (None,), "harmonic_coefficients")
    for device in block[:2]:
        numbers(device.rotation, (3, 3), "rotation")
        numbers(device.translation, (3,), "translation")
        numbers(device.lens, (None,), "lens")
        numbers(device.pupil, (2,), "pupil")
        if len(device.lens) != LENS.get(device.kind):
            raise InputError(
                f"lens: kind {device.kind!r} with {len(device.lens)} parameters is unknown; known: {LENS}"
            )
    if reference.column_count(block) >= MOST_COLUMNS:
        raise InputError(
            f"harmonic_coefficients: {harmonics} are too many, at most {MOST_COLUMNS - 34} are supported"
        )
