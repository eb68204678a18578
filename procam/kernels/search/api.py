"""Absolute projector coordinates from sinusoids of several periods."""

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from procam.arrays import AnyArray, Array
from procam.errors import InputError, ShapeError
from procam.kernels.native.arrays import (
    aligned_empty,
    check_frames,
    kind_of,
    plain,
    pointer,
    pointers,
)
from procam.kernels.native.loader import chosen
from procam.kernels.search import reference
from procam.kernels.search.reference import TURN, PhaseFit

MOST_FRAMES = 32
RANK = 3  # unknowns of a sinusoid: offset, cosine, sine
MOST_CANDIDATES, MOST_STEPS = 1 << 14, 100  # periods in a panel; more are mistakes
BLOCK = 1 << 17  # pixels that NumPy handles at a time


class _Terms(NamedTuple):
    """Parameters of the frames, float64 (K,) each, and of the search."""

    periods: Array
    shifts: Array
    modulation: Array
    harmonic: Array
    base: int
    length: float
    steps: int


class _Search(ctypes.Structure):
    """`struct procam_search` of native/kernels.h."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("frames", "base", "candidates", "steps", "harmonics")),
        *((name, ctypes.c_float) for name in ("period", "limit")),
        *((name, ctypes.c_void_p) for name in ("weights", "terms", "rotations")),
    )


def search_phase(  # noqa: PLR0913, PLR0917
    frames: Sequence[AnyArray],
    periods: ArrayLike,
    shifts: ArrayLike,
    modulation: ArrayLike,
    harmonic: ArrayLike,
    base: int,
    length: float,
    steps: int = 2,
) -> PhaseFit:
    """Projector coordinate x of every pixel from sinusoids of several periods (micro phase shifting).

    The model is frame_k = offset + amplitude (m_k cos t_k + h_k cos 2 t_k) with
    t_k = 2 pi x / period_k - shift_k. The first `base` frames give x modulo their common period P;
    of x, x + P, ... the one with the smallest sum of squared residuals in the other frames is kept,
    without the harmonic; Gauss-Newton steps on all frames then refine offset, amplitude and x.
    No step moves x by more than a quarter of the shortest period.

    Parameters
    ----------
    frames : 3 to 32 pictures of one shape and type, uint8, uint16 or float32 [any unit].
    periods, shifts : (K,) [px], [rad].
    modulation, harmonic : (K,) m and h above, relative to `amplitude`; m is > 0 in the base.
    base : how many frames share the first period, at least 3.
    length : columns or rows of the panel [px]; x is looked for from -P/4 on.
    steps : Gauss-Newton steps.

    Returns
    -------
    PhaseFit
        position x [px]; variance: that of x for frames of unit noise variance [px^2 / unit^2];
        amplitude and offset [unit]; residual: sum of squares over all frames [unit^2]; margin: by
        how much the sum of squares of the second best period exceeds that of the best [unit^2],
        inf if there is one period only. All NaN where a frame is; position and variance NaN where
        the amplitude is below 1e-4 of the offset or the fit is singular.

    Raises
    ------
    InputError
        If the terms do not fit the frames or one another.

    References
    ----------
    M. Gupta, S. K. Nayar, "Micro Phase Shifting", CVPR 2012, doi:10.1109/CVPR.2012.6247753.

    Examples
    --------
    >>> import numpy as np
    >>> periods, shifts = [40, 40, 40, 46, 52], np.radians([0, 120, 240, 0, 0])
    >>> wave = [100 + 50 * np.cos(2 * np.pi * 137.25 / p - s) for p, s in zip(periods, shifts)]
    >>> frames = [np.full((1, 1), value, np.float32) for value in wave]
    >>> fit = search_phase(frames, periods, shifts, [1] * 5, [0] * 5, 3, 300)
    >>> print(fit.position.round(3), fit.amplitude.round(3))
    [[137.25]] [[50.]]
    """
    pictures = check_frames(frames, RANK, MOST_FRAMES)
    terms = _checked(
        len(pictures), periods, shifts, modulation, harmonic, base=base, length=length, steps=steps
    )
    fit = PhaseFit(*(aligned_empty(pictures[0].shape, np.float32) for _ in PhaseFit._fields))
    native = chosen()
    if native is None:
        _run_reference(pictures, terms, fit)
        return fit
    library, level, threads = native
    ready = [plain(picture) for picture in pictures]
    library.procam_search(
        *(level, threads, kind_of(ready[0], "frames"), ready[0].size, pointers(ready)),
        *(_c_search(terms), pointers(fit)),
    )
    return fit


def _run_reference(pictures: list[AnyArray], terms: _Terms, fit: PhaseFit) -> None:
    """The reference implementation, a block of pixels at a time."""
    flat = [picture.reshape(-1) for picture in pictures]
    planes = [plane.reshape(-1) for plane in fit]
    for first in range(0, flat[0].size, BLOCK):
        part = slice(first, first + BLOCK)
        found = reference.search_phase([frame[part] for frame in flat], *terms)
        for plane, result in zip(planes, found, strict=True):
            plane[part] = result


def _c_search(terms: _Terms) -> Any:
    """The search as `struct procam_search`; trigonometry of candidates and frames is done here.

    Per frame: cycles per pixel, shift [cycles], m, h, the factors of sin t and of 2 sin t cos t in
    the derivative by x, whether the period is that of the frame before, and cosine and sine of the
    turn from there. Per candidate and later frame: cosine and sine of its turn.
    """
    base, frequency = terms.base, 1 / terms.periods
    cycles = np.mod(terms.shifts / TURN, 1)
    slopes = [-TURN * frequency * terms.modulation, -TURN * frequency * 2 * terms.harmonic]
    same = np.append(False, np.diff(terms.periods) == 0)
    apart = -np.diff(terms.shifts, prepend=0)
    rows = [frequency, cycles, terms.modulation, terms.harmonic, *slopes]
    count = reference.candidate_count(terms.periods[0], terms.length)
    turn = TURN * np.arange(count)[:, None] * terms.periods[0] * frequency[base:]
    parts = [
        reference.sinusoid_weights(terms.shifts[:base]),
        np.stack([*rows, same, np.cos(apart), np.sin(apart)], axis=1),
        np.stack([np.cos(turn), np.sin(turn)], axis=-1),
    ]
    kept = [np.ascontiguousarray(part, np.float32) for part in parts]
    found = _Search(
        *(len(terms.periods), base, count, terms.steps, int(terms.harmonic.any())),
        *(terms.periods[0], terms.periods.min() / 4),
        *map(pointer, kept),
    )
    found.kept = kept
    return ctypes.byref(found)


def _checked(count: int, *given: ArrayLike, base: int, length: float, steps: int) -> _Terms:
    """The terms, if they fit the frames and one another."""
    names = _Terms._fields[:4]
    columns = {n: np.asarray(v, dtype=float) for n, v in zip(names, given, strict=True)}
    for name, column in columns.items():
        if column.shape != (count,):
            raise ShapeError(name, column.shape, f"({count},), one per frame")
        if not np.isfinite(column).all():
            raise InputError(f"{name}: {column} are not all finite")
    terms = _Terms(**columns, base=int(base), length=float(length), steps=int(steps))
    if not RANK <= base <= count:
        raise InputError(f"base: {base} frames; {RANK} to {count} are needed, the number of frames")
    if not (terms.periods > 0).all() or np.ptp(terms.periods[:base]) > 0:
        raise InputError(
            f"periods: {terms.periods} px; they must be above 0 and the first {base} equal"
        )
    if not (terms.modulation[:base] > 0).all():
        raise InputError(
            f"modulation: {terms.modulation}; it must be above 0 in the first {base} frames"
        )
    most = MOST_CANDIDATES * float(terms.periods[0])
    if not (0 < length <= most and 0 <= steps <= MOST_STEPS):
        raise InputError(
            f"length, steps: {length} px, {steps} steps; the length must be above 0 px and at most "
            f"{MOST_CANDIDATES} periods, steps 0 to {MOST_STEPS}"
        )
    _check_shifts(terms.shifts[:base])
    return terms


def _check_shifts(angles: Array) -> None:
    """Refuse angles [rad] that leave offset, cosine and sine undetermined."""
    rows = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    if np.linalg.matrix_rank(rows, tol=1e-6) < RANK:
        raise InputError(
            f"shifts: {angles} rad leave offset, amplitude and phase undetermined; three or more must "
            "differ modulo 2 pi"
        )
