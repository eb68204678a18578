"""`procam decode`: plain structured-light decoding of a folder of pictures."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError
from procam.estimate.decode import (
    CodePair,
    DecodeLimits,
    decode_gray_pairs,
    default_limits,
    drop_outside,
)
from procam.files.images import read_image, write_channels
from procam.interfaces.cli.output import Output
from procam.maths.gray import bit_count
from procam.model.correspondence import CorrespondenceMap

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".exr", ".bmp", ".pgm")


def run_decode(
    folder: Path,
    size: str,
    out: Path,
    code: str,
    limits: tuple[float | None, float | None],
    output: Output,
) -> None:
    """Decode FOLDER and write the map."""
    if code != "gray":
        raise InputError(f"code: got {code!r}, expected gray")
    found = decode_folder(folder, _size(size), limits)
    xy, sigma = found.projector_xy, found.sigma_px
    write_channels(out, {"projector.x": xy[..., 0], "projector.y": xy[..., 1], "sigma": sigma})
    share = float(found.valid.mean())
    output.say(
        f"{out} written; {int(found.valid.sum())} pixels decoded, {share:.1%} of the picture"
    )
    output.finish({"out": str(out), "decoded": int(found.valid.sum()), "share": share})


def decode_folder(
    folder: Path, size: tuple[int, int], limits: tuple[float | None, float | None]
) -> CorrespondenceMap:
    """Map of a folder of pictures in OpenCV's order; `limits` in counts, None for automatic."""
    files = sorted(p for p in folder.glob("*") if p.suffix.lower() in SUFFIXES)
    bits = {"x": bit_count(size[0]), "y": bit_count(size[1])}
    expected = 2 * sum(bits.values()) + 2
    if len(files) != expected:
        raise FileFormatError(
            f"{folder}: got {len(files)} pictures, expected {expected} for a projector of "
            f"{size[0]}x{size[1]}: {bits['x']} column bits and {bits['y']} row bits as pattern and "
            "inverse, white, black"
        )
    white, black = _grey(files[-2], None), _grey(files[-1], None)
    chosen = _limits(limits, white, black)
    planes = [(axis, bit) for axis in bits for bit in reversed(range(bits[axis]))]
    pairs = (
        CodePair(axis, bit, _grey(files[2 * i], white.shape), _grey(files[2 * i + 1], white.shape))
        for i, (axis, bit) in enumerate(planes)
    )
    return drop_outside(decode_gray_pairs(pairs, white, black, bits, chosen), size)


def _limits(
    asked: tuple[float | None, float | None],
    white: NDArray[np.float32],
    black: NDArray[np.float32],
) -> DecodeLimits:
    automatic = default_limits(white, black)
    if asked == (None, None):
        return automatic
    white_black = automatic.white_black if asked[0] is None else asked[0]
    contrast = automatic.contrast if asked[1] is None else asked[1]
    return DecodeLimits(white_black, contrast, lit_share=0.0)


def _grey(path: Path, shape: tuple[int, ...] | None) -> NDArray[np.float32]:
    pixels = np.asarray(read_image(path), np.float32)[..., :3].mean(axis=-1)
    bad = int((~np.isfinite(pixels)).sum())
    if bad:
        raise FileFormatError(
            f"{path}: got {bad} values that are NaN or infinite, expected photographs; export it again"
        )
    if shape is not None and pixels.shape != shape:
        raise FileFormatError(
            f"{path}: got {pixels.shape[1]}x{pixels.shape[0]} px, expected "
            f"{shape[1]}x{shape[0]} like the white picture"
        )
    return pixels


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or not all(int(part) for part in match.groups()):
        raise InputError(f"size: got {text!r}, expected WIDTHxHEIGHT such as 1280x800")
    return int(match[1]), int(match[2])
