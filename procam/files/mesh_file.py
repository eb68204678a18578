"""The mesh of a room as a file beside its calibration, as it was cut for tracing light."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError
from procam.maths.mesh.rooms import Room

NAME = "screen.npz"
NUMBERS = ("vertices", "faces", "part", "place", "size_m", "smooth")
DAMAGED = (EOFError, LookupError, OSError, ValueError, zipfile.BadZipFile, zlib.error)
LARGEST_M = 1e4  # of a coordinate


def write_mesh(path: Path, room: Room) -> None:
    """Write a mesh as NPZ."""
    np.savez(path, names=np.array(room.names), **{n: np.asarray(getattr(room, n)) for n in NUMBERS})  # type: ignore[arg-type] # allow_pickle


def read_mesh(path: Path) -> Room:
    """Read a mesh.

    Raises
    ------
    FileFormatError
        The file is missing, damaged, or no mesh.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in ("names", *NUMBERS)}
            return _room(arrays)
    except DAMAGED as error:
        raise FileFormatError(
            f"{path}: the mesh of the room cannot be read ({error}); copy the calibration again"
        ) from error


def _room(arrays: dict[str, AnyArray]) -> Room:
    """The room of arrays whose shapes, types and bounds are checked."""
    vertices, faces, part = arrays["vertices"], arrays["faces"], arrays["part"]
    names = tuple(map(str, arrays["names"]))
    for name, found, columns in (
        ("vertices", vertices, 3),
        ("faces", faces, 3),
        ("place", arrays["place"], 2),
    ):
        if found.ndim != 2 or found.shape[1] != columns or not len(found):
            raise ValueError(f"{name} has shape {found.shape}")
    if part.shape != faces.shape[:1] or len(arrays["place"]) != len(vertices):
        raise ValueError("part and place do not belong to its faces and vertices")
    if faces.dtype.kind not in "iu" or part.dtype.kind not in "iu":
        raise ValueError("faces and part are no whole numbers")
    if not (np.abs(vertices) < LARGEST_M).all():
        raise ValueError("vertices are NaN or too far")
    for name, found, most in (("faces", faces, len(vertices)), ("part", part, len(names))):
        if found.min() < 0 or found.max() >= most:
            raise ValueError(f"{name} has numbers {found.min()} to {found.max()} of {most}")
    width, height = map(float, arrays["size_m"])
    if not (0 < width < LARGEST_M and 0 < height < LARGEST_M):
        raise ValueError(f"its canvas is {width} x {height} m")
    return Room(
        names,
        vertices.astype(float),
        faces.astype(np.intp),
        part.astype(np.intp),
        arrays["place"].astype(float),
        (width, height),
        bool(arrays["smooth"]),
    )
