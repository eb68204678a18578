"""Gray code planes: a picture and its inverse give one bit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.kernels import reference
from procam.kernels.arrays import check_like, kind_of, plain, pointer, pointers
from procam.kernels.loader import chosen

BITS = 16


def fold_pairs(
    pairs: Sequence[tuple[NDArray[Any], NDArray[Any], int]],
    code: NDArray[np.uint16],
    least: NDArray[Any] | None = None,
    most: NDArray[Any] | None = None,
) -> None:
    """Fold stripe pictures and their inverses into the code and the contrast seen so far, in place.

    For each (pattern, inverse, bit): code |= (pattern > inverse) << bit, least = min(least, c),
    most = max(most, c), with the contrast c = abs(pattern - inverse). A pixel that is NaN in either
    picture has c = 0 and bit 0. The state passes through the caches once for all pairs.

    Parameters
    ----------
    pairs : pictures of one shape, uint8, uint16 or float32 [any unit], and the bit of `code`,
        0 to 15, that each pair carries.
    code : uint16, same shape.
    least, most : same shape and type as the pictures, or None to leave them out [same unit].

    Raises
    ------
    InputError
        If types or shapes differ or a bit does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> code, least = np.zeros(3, np.uint16), np.full(3, 255, np.uint8)
    >>> pattern, inverse = np.array([[9, 2, 5], [1, 7, 5]], np.uint8)
    >>> fold_pairs([(pattern, inverse, 2)], code, least)
    >>> print(code, least)
    [4 0 0] [8 5 0]
    """
    if not pairs:
        return
    pictures = [np.asarray(picture) for pair in pairs for picture in pair[:2]]
    bits = np.array([bit for _, _, bit in pairs], np.intc)
    kind = _check(pictures, bits, code, least, most)
    native = chosen()
    if native is None:
        for pattern, inverse, bit in pairs:
            reference.fold_pair(pattern, inverse, bit, code, least, most)
        return
    library, level, threads = native
    ready = [plain(picture) for picture in pictures]
    state: list[NDArray[Any] | None] = [code, least, most]
    work = [None if array is None else plain(array) for array in state]
    library.procam_fold(
        *(level, threads, kind, code.size, len(pairs)),
        *(pointer(bits), pointers(ready), *map(pointer, work)),
    )
    for array, done in zip(state, work, strict=True):
        if array is not None and done is not None and done is not array:
            array[...] = done


def _check(
    pictures: list[NDArray[Any]],
    bits: NDArray[np.intc],
    code: NDArray[Any],
    least: NDArray[Any] | None,
    most: NDArray[Any] | None,
) -> int:
    """Refuse what cannot be folded; gives back the number of the element type."""
    if bits.min() < 0 or bits.max() >= BITS:
        raise InputError(f"bit: got {', '.join(map(str, bits))}, expected 0 to {BITS - 1}")
    first = pictures[0]
    kind = kind_of(first, "pattern")
    for number, picture in enumerate(pictures):
        check_like(picture, first, first.dtype, "inverse" if number % 2 else "pattern")
    check_like(code, first, np.uint16, "code")
    for name, plane in (("least", least), ("most", most)):
        if plane is not None:
            check_like(plane, first, first.dtype, name)
    for name, plane in (("code", code), ("least", least), ("most", most)):
        if plane is not None and not plane.flags.writeable:
            raise InputError(f"{name}: got a read-only array, expected one to write to; copy it")
    return kind
