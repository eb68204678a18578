"""Keeps the memory of large pictures in the process instead of returning it after every step."""

import ctypes
import sys

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h
LARGEST = 32 * 2**20  # the largest threshold glibc allows; a colour picture of 2.6 Mpx just fits
NEVER = 2**31 - 1


def keep_large_buffers() -> None:
    """Make glibc's malloc reuse large blocks; other C libraries are left alone.

    By default every large array is mapped afresh and the kernel zeroes its pages, which takes a
    seventh of the time of a solve.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, NEVER)
