"""Phase of sinusoidal patterns."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from procam.errors import InputError, ShapeError
from procam.kernels import reference
from procam.kernels.arrays import check_frames, kind_of, plain, pointer, pointers, result_planes
from procam.kernels.loader import chosen

Plane = NDArray[np.float32]
MOST_FRAMES = 64
RANK = 3


def wrapped_phase(
    frames: Sequence[NDArray[Any]],
    shifts: ArrayLike,
    *,
    with_offset: bool = True,
    out: Sequence[Plane | None] | None = None,
) -> tuple[Plane, Plane, Plane | None]:
    """Phase, amplitude and offset of every pixel under shifted sinusoids.

    Least squares of frame_k = offset + amplitude cos(phase - shift_k), for any shifts.

    Parameters
    ----------
    frames : 3 to 64 pictures of one shape and type, uint8, uint16 or float32 [any unit].
    shifts : (N,) one per frame [rad].
    with_offset : False leaves the offset out, which is faster.
    out : float32 arrays (phase, amplitude[, offset]) to write to; saves making them anew.

    Returns
    -------
    phase : float32, [0, 2 pi) [rad], within 4e-6; NaN where a frame is NaN.
    amplitude : float32 [unit of the frames].
    offset : float32 [unit of the frames], or None.

    Raises
    ------
    InputError
        If the shifts cannot tell three unknowns apart, or types or shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> shifts = np.radians([0, 120, 240])
    >>> frames = (7 + 2 * np.cos(np.array([[1.0], [4.0]]) - shifts)).astype(np.float32)
    >>> phase, amplitude, offset = wrapped_phase(list(frames.T), shifts)
    >>> print(phase.round(4), amplitude.round(4), offset.round(4))
    [1. 4.] [2. 2.] [7. 7.]
    """
    pictures = check_frames(frames, RANK, MOST_FRAMES)
    angles = check_shifts(shifts, len(pictures))
    shape = pictures[0].shape
    wanted = ["phase", "amplitude", "offset"][: 3 if with_offset else 2]
    planes = result_planes(out, wanted, shape)
    native = chosen()
    if native is None:
        found = reference.wrapped_phase(pictures, angles, with_offset)
        for plane, result in zip(planes, found, strict=False):
            plane[...] = result
    else:
        library, level, threads = native
        ready = [plain(picture) for picture in pictures]
        weights = reference.sinusoid_weights(angles).astype(np.float32)
        addresses = [pointer(plane) for plane in planes] + [None] * (3 - len(planes))
        library.procam_phase(
            *(level, threads, kind_of(ready[0], "frames"), ready[0].size, len(ready)),
            *(pointers(ready), pointer(weights), *addresses),
        )
    return planes[0], planes[1], planes[2] if with_offset else None


def check_shifts(shifts: ArrayLike, count: int) -> NDArray[np.float64]:
    """`count` finite angles [rad] that tell offset, cosine and sine apart."""
    angles = np.asarray(shifts, dtype=float)
    if angles.shape != (count,):
        raise ShapeError("shifts", angles.shape, f"({count},), one per frame")
    if not np.isfinite(angles).all():
        raise InputError(f"shifts: got {angles}, expected finite angles [rad]")
    rows = np.stack([np.ones(count), np.cos(angles), np.sin(angles)])
    if np.linalg.matrix_rank(rows, tol=1e-6) < RANK:
        raise InputError(
            f"shifts: got {angles} rad, which leave offset, amplitude and phase undecided; "
            "expected three or more that differ modulo a turn"
        )
    return angles
