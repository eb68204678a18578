"""What glibc does with the memory of large pictures; other C libraries are left alone."""

import ctypes
import gc
import sys
from collections.abc import Callable

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # malloc.h
LARGEST = 32 * 2**20  # the largest threshold glibc allows; a colour picture of 2.6 Mpx just fits
NEVER = 2**31 - 1


def keep_large_buffers() -> None:
    """Make malloc reuse large blocks.

    By default every large array is mapped afresh and the kernel zeroes its pages, which takes a
    seventh of the time of a solve. All threads share one arena, for `return_buffers` cannot return what
    lies free at the end of another.
    """
    mallopt = _of_libc("mallopt")
    if mallopt:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, NEVER)
        mallopt(M_ARENA_MAX, 1)


def return_buffers() -> None:
    """Return the memory of blocks that nothing uses now; after a step of minutes that is no loss."""
    gc.collect()  # pictures that only a cycle of references holds
    malloc_trim = _of_libc("malloc_trim")
    if malloc_trim:
        malloc_trim(0)


def _of_libc(name: str) -> Callable[..., int] | None:
    """A function of glibc; None elsewhere."""
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), name, None)
