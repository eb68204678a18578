"""Form factors of a room as a file beside its calibration, so that they are not computed at every start."""

import hashlib
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError
from procam.maths.mesh.compressed import TOLERANCE, CompressedFactors, Level, Near
from procam.model.screen import RoomScreen

NAME = "form-factors.npz"
CHECK = "check"
LEVEL = ("rows", "starts", "partner")
NEAR = ("blocks", "starts", "one")
DAMAGED = (EOFError, LookupError, OSError, ValueError, zipfile.BadZipFile, zlib.error)


def write_form_factors(path: Path, screen: RoomScreen) -> None:
    """Write the factors of a room as NPZ."""
    arrays = _arrays(screen.factors)
    np.savez(path, **{CHECK: _check(screen, arrays), **arrays})  # type: ignore[arg-type] # allow_pickle


def read_form_factors(path: Path, screen: RoomScreen) -> CompressedFactors:
    """Read the factors of a room.

    Raises
    ------
    FileFormatError
        The file is missing, damaged, or of another mesh.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
            check = bytes(arrays.pop(CHECK))
            if check != bytes(_check(screen, arrays)):
                raise ValueError("it is of another mesh, or altered")
            levels = [
                Level(*(arrays[f"level_{depth}_{part}"] for part in LEVEL))
                for depth in range(int(arrays["depth"]))
            ]
            near = Near(*(arrays[f"near_{part}"] for part in NEAR))
            return CompressedFactors(arrays["area"], arrays["face"], levels, near)
    except DAMAGED as error:
        raise FileFormatError(
            f"{path}: form factors cannot be read ({error}); delete it, and they are computed anew"
        ) from error


def with_form_factors(screen: RoomScreen, path: Path) -> RoomScreen:
    """The room with the factors of a file; without, they are computed when they are needed."""
    with suppress(FileFormatError):
        return screen.with_factors(read_form_factors(path, screen))
    return screen


def _arrays(factors: CompressedFactors) -> dict[str, AnyArray]:
    """All arrays by name."""
    parts = {f"level_{i}": (level, LEVEL) for i, level in enumerate(factors.levels)}
    every = {**parts, "near": (factors.near, NEAR)}
    found = {
        f"{name}_{n}": getattr(part, n) for name, (part, names) in every.items() for n in names
    }
    return {"area": factors.area, "face": factors.face, "depth": np.array(len(parts)), **found}


def _check(screen: RoomScreen, arrays: Mapping[str, AnyArray]) -> AnyArray:
    """Hash (32,) of the mesh, the tolerance and the arrays."""
    room = screen.room
    found = hashlib.sha256(repr(TOLERANCE).encode())
    found.update((np.round(room.vertices, 6) + 0.0).tobytes() + room.faces.tobytes())
    for name in sorted(arrays):
        found.update(name.encode() + str(arrays[name].shape).encode() + arrays[name].tobytes())
    return np.frombuffer(found.digest(), np.uint8)
