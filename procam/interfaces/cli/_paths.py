"""Checks of what the options of a command name: output files, counts, photographs."""

import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array32
from procam.errors import FileFormatError, InputError
from procam.files.images.pixels import read_image

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".exr", ".bmp", ".pgm")
NAMED = 4  # photographs that a message names
Picture = NDArray[np.uint8] | NDArray[np.uint16] | Array32
Size = tuple[int, int]


def check_out(out: Path, suffix: str, *, option: str) -> None:
    """Refuse a file that cannot be written, by the option that named it, before anything is computed."""
    if out.suffix != suffix:
        raise InputError(f"{out}: its name must end in {suffix}; choose another {option}")
    if out.is_dir():
        raise InputError(f"{out}: this is a folder; choose a file name for {option}")
    above = next(path for path in out.absolute().parents if path.exists())
    if not above.is_dir():
        raise InputError(f"{out}: {above} is a file, not a folder; choose another {option}")
    if not os.access(above, os.W_OK | os.X_OK):
        raise InputError(
            f"{out}: there is no permission to write to {above}; choose another {option}, or change the "
            "permissions"
        )


def check_new_folder(out: Path) -> None:
    """Refuse a folder for pictures that has something in it."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is not empty; give a new or empty folder for the pictures")


def two_counts(option: str, text: str, form: str) -> Size:
    """The two numbers of an option such as 10x7."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or not all(map(int, match.groups())):
        raise InputError(f"{option}: {text!r} is not of the form {form}")
    return int(match[1]), int(match[2])


def panel_size(text: str) -> Size:
    """The projector's size of an option such as --size 1280x800."""
    return two_counts("--size", text, "WIDTHxHEIGHT, such as 1280x800")


def photographs(path: Path, suffixes: Collection[str] = SUFFIXES) -> list[Path]:
    """The pictures of a folder sorted by name, or the one file."""
    if not path.is_dir():
        return [path]
    files = sorted(p for p in path.iterdir() if p.suffix.lower() in suffixes)
    if not files:
        raise FileFormatError(
            f"{path}: there are no photographs here; they must be {', '.join(suffixes)}"
        )
    return files


def read_grey(path: Path) -> Picture:
    """A photograph (H, W) in its own type; the mean of three channels, rounded if they are integers."""
    pixels = read_image(path)[..., :3]
    if pixels.shape[-1] == 1 or pixels.dtype.kind == "u":
        middle = pixels[..., 0] if pixels.shape[-1] == 1 else np.rint(pixels.mean(axis=-1))
        return middle.astype(pixels.dtype if pixels.dtype.kind == "u" else np.float32)
    grey = np.asarray(pixels, np.float32).mean(axis=-1)
    bad = int((~np.isfinite(grey)).sum())
    if bad:
        raise FileFormatError(
            f"{path}: {bad} pixels are NaN or infinite; export the photograph again"
        )
    return grey


def one_size(sizes: Mapping[Path, Size]) -> Size:
    """The size of all pictures; refuses several, with the names of the files of each."""
    kinds = sorted(set(sizes.values()), key=[*sizes.values()].count, reverse=True)
    if len(kinds) > 1:
        each = (
            f"{width}x{height} ({some([p for p in sizes if sizes[p] == (width, height)])})"
            for width, height in kinds
        )
        raise InputError(
            f"photographs: their sizes differ: {' and '.join(each)}. Leave out those of another camera, "
            "zoom or crop, and turn off the automatic rotation"
        )
    return kinds[0]


def some(paths: Sequence[Path]) -> str:
    """Names of the first few files, and the number of the others."""
    names = [path.name for path in paths]
    return ", ".join(names[:NAMED]) + (
        f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    )
