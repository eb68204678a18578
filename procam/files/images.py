"""Pictures in and out through OpenImageIO: PNG, TIFF and EXR.

Every read checks that the whole file was there: a truncated EXR must never read as black.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.files.atomic import replacing
from procam.maths.curves import srgb_decode, srgb_encode

RGB = ("R", "G", "B")
Image = NDArray[np.float32]
STORED_AS = {"uint8": "uint8", "uint16": "uint16", "float32": "float"}
SUFFIXES = (".png", ".tif", ".tiff", ".exr")  # what is lossless; OpenImageIO would write more


def write_image(path: Path, pixels: NDArray[np.generic], channels: Sequence[str] = ()) -> None:
    """Write (H, W) or (H, W, C) pixels durably, by the suffix and dtype (uint8, uint16, float32).

    TIFF is written uncompressed (raw captures: speed), EXR losslessly with zip.
    """
    if path.suffix not in SUFFIXES:
        raise FileFormatError(
            f"{path}: got the suffix {path.suffix!r}, expected .png, .tif or .exr; rename it"
        )
    data = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    height, width, count = data.shape
    spec = oiio.ImageSpec(width, height, count, STORED_AS[str(data.dtype)])
    spec.attribute("compression", {".exr": "zip", ".tif": "none"}.get(path.suffix, ""))
    if path.suffix == ".png":
        spec.attribute("png:compressionLevel", 1)
    if channels:
        spec.channelnames = tuple(channels)
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None
        if not (output.open(str(temporary), spec) and output.write_image(data)):
            raise FileFormatError(f"{path}: could not be written ({_one_line(output.geterror())})")
        output.close()


def read_image(path: Path) -> NDArray[np.generic]:
    """Pixels (H, W, C) in the file's own type."""
    return _read(path)[0]


def read_channels(path: Path) -> dict[str, Image]:
    """Channels by name, each (H, W) float32; EXR does not keep their order."""
    pixels, names = _read(path)
    return {name: np.asarray(pixels[..., i], np.float32) for i, name in enumerate(names)}


def write_channels(path: Path, channels: Mapping[str, NDArray[np.generic]]) -> None:
    """Write named (H, W) channels as a float EXR."""
    stack = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    write_image(path, stack, tuple(channels))


def read_picture(path: Path) -> Image:
    """Content (H, W, 3) in linear light 0..: EXR as stored, PNG and TIFF decoded from sRGB."""
    pixels, names = _read(path)
    lookup = {name.upper(): i for i, name in enumerate(names)}
    if not set(RGB) <= set(lookup):
        raise FileFormatError(
            f"{path}: got channels {', '.join(names)}, expected R, G and B; convert it to RGB"
        )
    picture = np.asarray(pixels[..., [lookup[c] for c in RGB]])
    if np.issubdtype(picture.dtype, np.integer):
        encoded = picture / np.float32(np.iinfo(picture.dtype).max)
        return srgb_decode(encoded).astype(np.float32)
    bad = int((~np.isfinite(picture)).sum())
    if bad:
        raise FileFormatError(
            f"{path}: got {bad} values that are NaN or infinite, expected finite light; "
            "render the frame again or paint over the holes"
        )
    return picture.astype(np.float32)


def write_picture(path: Path, linear: Image) -> None:
    """Write linear light (H, W, 3): EXR as is, PNG and TIFF as 16-bit sRGB."""
    if path.suffix == ".exr":
        write_image(path, linear.astype(np.float32), RGB)
        return
    encoded = np.rint(srgb_encode(np.clip(linear, 0, 1)) * 65535)
    write_image(path, encoded.astype(np.uint16))


def _read(path: Path) -> tuple[NDArray[np.generic], list[str]]:
    if not path.is_file():
        raise FileFormatError(f"{path}: got no such file, expected an image; check the name")
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise FileFormatError(f"{path}: got no readable image ({_one_line(oiio.geterror())})")
    try:
        spec = source.spec()
        pixels = source.read_image(spec.format)
        complaint = source.geterror()
    finally:
        source.close()
    if pixels is None or complaint:
        raise FileFormatError(
            f"{path}: got a truncated or damaged image ({_one_line(complaint)}), expected "
            f"{spec.width}x{spec.height} whole pixels; copy or capture it again"
        )
    return np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels), list(
        spec.channelnames
    )


def _one_line(complaint: str) -> str:
    return " ".join(complaint.split())
