"""Least times: every input byte read once and every output byte written once; so many instructions."""

import ctypes
import hashlib
import json
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from procam.kernels.native.arrays import aligned_empty

LINE = 64
COUNTED = Path(__file__).with_name("instructions.json")


@cache
def _library() -> ctypes.CDLL | None:
    """floor.c compiled for this machine, or None without a compiler."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "floor.so"
        source = Path(__file__).with_suffix(".c")
        command = ["gcc", "-O3", "-march=native", "-fopenmp", "-shared", "-fPIC"]
        try:
            subprocess.run([*command, str(source), "-o", str(path)], check=True)
        except (OSError, subprocess.CalledProcessError):
            return None
        found = ctypes.CDLL(str(path))
    found.floor_read.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
    found.floor_copy.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t]
    found.floor_instructions.argtypes = [ctypes.c_size_t]
    found.floor_instructions.restype = ctypes.c_int
    return found


def name() -> str:
    """What the floor is made of here."""
    made = "non-temporal copy in C" if _library() else "np.sum and np.copyto, no compiler found"
    return f"floor: inputs read once, outputs written once ({made})"


class Floor:
    """Moves as many bytes as a kernel that reads `source` once and writes `written` bytes once."""

    def __init__(self, source: np.ndarray, written: int) -> None:
        self._source = source.reshape(-1).view(np.uint8)
        self._copied = min(written, self._source.size) // LINE * LINE
        target = aligned_empty((written // 4,), np.float32)
        self._target = target.view(np.uint8)

    @classmethod
    def of_bytes(cls, read: int, written: int) -> "Floor":
        """Moves so many bytes. Memory that nobody wrote to is one page of zeros, and reads too fast."""
        return cls(np.full(-(-read // LINE) * LINE, 1, np.uint8), written)

    def __call__(self) -> None:
        library, rest = _library(), self._source[self._copied :]
        if library is None:
            np.copyto(self._target[: self._copied], self._source[: self._copied])
            rest.view(np.uint8).sum()
            return
        library.floor_copy(self._target.ctypes.data, self._source.ctypes.data, self._copied)
        library.floor_read(rest.ctypes.data, rest.size)


def counted(path: str) -> float:
    """Instructions per value or pixel at AVX2: see benchmarks.instructions.

    Raises
    ------
    RuntimeError
        If the kernels have changed since they were counted.
    """
    document = json.loads(COUNTED.read_text())
    if document["sources"] != sources():
        raise RuntimeError(
            f"{COUNTED.name}: kernels have changed; run python -m benchmarks.instructions"
        )
    return float(document["instructions"][path])


def sources() -> str:
    """Hash of the kernels' C sources."""
    files = sorted((COUNTED.parents[1] / "procam/kernels").rglob("*.[ch]"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


class Instructions:
    """As many instructions as a kernel executes, none of which waits for another."""

    def __init__(self, count: float) -> None:
        self._count = int(count)

    def __call__(self) -> None:
        library = _library()
        if library is not None:
            library.floor_instructions(self._count)
