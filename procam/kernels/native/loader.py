"""Finds the compiled library, and chooses one of its instruction sets or NumPy."""

import ctypes
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from procam.errors import InputError

LEVELS = ("avx512", "avx2", "base", "numpy")
LANES = (16, 8, 4)  # floats of a vector, of each level but the last
VARIABLE = "PROCAM_KERNELS"
INTERFACE = 17  # PROCAM_INTERFACE of native/kernels.h
_INT, _SIZE, _ADDRESS = ctypes.c_int, ctypes.c_size_t, ctypes.c_void_p
_DOUBLE = ctypes.c_double
SIGNATURES = {  # level, threads, element type, pixels, ...
    "procam_search": [_INT, _INT, _INT, _SIZE, *[_ADDRESS] * 3],
    "procam_bundle": [_INT, _INT, _SIZE, _ADDRESS, _INT, _SIZE, _ADDRESS, _ADDRESS],
    "procam_residuals": [_INT, _INT, _SIZE, _ADDRESS, _ADDRESS],
    "procam_rays": [_INT, _INT, _SIZE, _ADDRESS, _ADDRESS, _INT, _ADDRESS, _DOUBLE, _ADDRESS],
    "procam_warp": [_INT, _INT, _SIZE, _ADDRESS],  # rows
    "procam_frame": [_INT, _INT, _INT, _SIZE, _SIZE, _ADDRESS, _ADDRESS],  # mode, strips, chunks
    "procam_scattered": [_INT, _INT, _INT, _INT, *[_ADDRESS] * 6],  # nodes, terms
}
MISSING = (
    "procam runs without its compiled kernels, in NumPy: same results, many times slower; "
    "install a C compiler and reinstall procam"
)


@dataclass(slots=True)
class _Choice:
    """The present level (None: not chosen yet) and number of threads (0: OpenMP's own)."""

    level: str | None = None
    threads: int = 0


_choice = _Choice()


def available() -> tuple[str, ...]:
    """Levels that run here, best first; the last is always "numpy"."""
    found = library()
    if found is None:
        return ("numpy",)
    bits = found.procam_levels()
    return (*(name for i, name in enumerate(LEVELS[:-1]) if bits >> i & 1), "numpy")


def active() -> str:
    """Level that the next call runs at.

    The first call chooses: PROCAM_KERNELS if it is set, else the best level of this processor.
    Without the library that is "numpy", with a RuntimeWarning the first time.
    """
    if _choice.level is None:
        asked = os.environ.get(VARIABLE)
        _choice.level = _checked(asked, f" ({VARIABLE})") if asked else available()[0]
        if not asked and library() is None:
            warnings.warn(MISSING, RuntimeWarning, stacklevel=2)
    return _choice.level


def use(level: str | None = None, threads: int = 0) -> str:
    """Force a level, or the best one for None; returns the level now active.

    Parameters
    ----------
    level : "avx512", "avx2", "base" (any processor; NEON on ARM) or "numpy".
    threads : threads per call; 0 leaves it to OpenMP (OMP_NUM_THREADS, the cores there are).

    Raises
    ------
    InputError
        If the level is unknown or does not run here.
    """
    if threads < 0:
        raise InputError(f"threads: {threads} is below 0; use 0 for as many as OpenMP chooses")
    _choice.level = available()[0] if level is None else _checked(level)
    _choice.threads = threads
    return _choice.level


@contextmanager
def forced(level: str | None = None, threads: int = 0) -> Iterator[str]:
    """`use` for the length of a with block."""
    before = _choice.level, _choice.threads
    try:
        yield use(level, threads)
    finally:
        _choice.level, _choice.threads = before


def chosen() -> tuple[ctypes.CDLL, int, int] | None:
    """Library, number of the level and of threads for the next call; None for NumPy."""
    level, found = active(), library()
    if level == "numpy" or found is None:
        return None
    return found, LEVELS.index(level), _choice.threads


@cache
def library() -> ctypes.CDLL | None:
    """The compiled library, or None if there is none that fits."""
    for suffix in EXTENSION_SUFFIXES:
        path = Path(__file__).parents[1] / f"_native{suffix}"
        if path.exists():
            return _opened(path)
    return None


def _opened(path: Path) -> ctypes.CDLL | None:
    """The library at `path`, its waiting threads asleep rather than spinning."""
    policy = os.environ.get("OMP_WAIT_POLICY")
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        found = ctypes.CDLL(str(path))
        fits = found.procam_interface() == INTERFACE
        for name, arguments in SIGNATURES.items():
            getattr(found, name).argtypes = arguments
    except (OSError, AttributeError):
        return None
    finally:
        if policy is None:
            del os.environ["OMP_WAIT_POLICY"]
    return found if fits else None


def _checked(level: str, source: str = "") -> str:
    """`level`, if it exists and runs here."""
    if level not in LEVELS:
        raise InputError(
            f"kernel level{source}: {level!r} is unknown; choose one of {', '.join(LEVELS)}"
        )
    if level not in available():
        built = (
            "no compiled library that loads was found"
            if library() is None
            else "this processor lacks it"
        )
        raise InputError(
            f"kernel level{source}: {level!r} does not run, {built}; try one of {', '.join(available())}"
        )
    return level
