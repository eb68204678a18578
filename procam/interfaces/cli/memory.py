"""Keeps the memory of large pictures in the process instead of giving it back after every step."""

import ctypes
import sys

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h
LARGEST = 32 * 2**20  # what glibc allows; a colour picture of 2.6 Mpx just fits
NEVER = 2**31 - 1


def keep_large_buffers() -> None:
    """Tell glibc's malloc to reuse large blocks.

    By default every large array is mapped afresh and its pages are zeroed by the kernel: a seventh
    of the time of a solve. Other C libraries are left alone.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, NEVER)
