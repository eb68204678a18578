"""Pictures in and out through OpenImageIO: PNG, TIFF and EXR.

Every read checks that the whole file was there: a truncated EXR must never read as black.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.files.atomic import replacing
from procam.maths.curves import srgb_decode, srgb_encode

RGB = ("R", "G", "B")
Image = NDArray[np.float32]
STORED_AS = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
ROWS = 64  # at a time
SUFFIXES = (".png", ".tif", ".tiff", ".exr")  # what is lossless; OpenImageIO would write more


def write_image(
    path: Path, pixels: NDArray[np.generic], channels: Sequence[str] = (), exr: str = "zip"
) -> None:
    """Write (H, W) or (H, W, C) pixels durably, by the suffix and dtype (a key of `STORED_AS`).

    TIFF is written uncompressed (raw captures: speed), EXR by the lossless compression `exr`.
    """
    require_suffix(path)
    data = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    height, width, count = data.shape
    spec = oiio.ImageSpec(width, height, count, STORED_AS[str(data.dtype)])
    spec.attribute("compression", {".exr": exr, ".tif": "none"}.get(path.suffix, ""))
    if path.suffix == ".png":
        spec.attribute("png:compressionLevel", 1)
    if channels:
        spec.channelnames = tuple(channels)
    write_spec(path, data, spec)


def require_suffix(path: Path) -> None:
    """Refuse a name whose suffix no lossless picture has."""
    if path.suffix not in SUFFIXES:
        raise FileFormatError(
            f"{path}: got the suffix {path.suffix!r}, expected .png, .tif or .exr; rename it"
        )


def write_spec(path: Path, data: NDArray[np.generic], spec: oiio.ImageSpec) -> None:
    """Write contiguous pixels (H, W, C) durably, as OpenImageIO's `spec` describes them."""
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None
        if not (output.open(str(temporary), spec) and output.write_image(data)):
            raise FileFormatError(f"{path}: could not be written ({_one_line(output.geterror())})")
        if not output.close():
            raise FileFormatError(f"{path}: could not be written ({_one_line(output.geterror())})")


def read_image(path: Path) -> NDArray[np.generic]:
    """Pixels (H, W, C) in the file's own type."""
    return read_spec(path)[0]


def read_channels(path: Path) -> dict[str, Image]:
    """Channels by name, each (H, W) float32; EXR does not keep their order."""
    pixels, spec = read_spec(path)
    names = spec.channelnames
    return {name: np.asarray(pixels[..., i], np.float32) for i, name in enumerate(names)}


def read_layers(path: Path) -> dict[str, Image]:
    """Layers by name, float32: (H, W, C) of channels such as hi.R, hi.G, hi.B, (H, W) of a single one.

    Read by a few rows, which the cache holds: half the memory and time of `read_channels`.
    """
    with _opened(path) as source:
        spec = source.spec()
        places = _layers(spec.channelnames)
        found = {
            n: np.empty((spec.height, spec.width, len(k)), np.float32) for n, k in places.items()
        }
        for start, pixels in _by_rows(path, source):
            for name, channels in places.items():
                for i, k in enumerate(channels):
                    found[name][start : start + len(pixels), :, i] = pixels[..., k]
    return {name: layer[..., 0] if layer.shape[2] == 1 else layer for name, layer in found.items()}


def _layers(names: Sequence[str]) -> dict[str, list[int]]:
    """Places of the channels of each layer, as R, G, B or x, y, z."""
    found: dict[str, list[int]] = {}
    for name in sorted(names, key=lambda name: ("RGB".find(name[-1]), name)):
        found.setdefault(name.rpartition(".")[0] or name, []).append(names.index(name))
    return found


def _by_rows(path: Path, source: oiio.ImageInput) -> Iterator[tuple[int, NDArray[np.generic]]]:
    """First row and pixels (R, W, C) of each part of a picture; one of tiles is one part."""
    spec = source.spec()
    if spec.tile_width:
        yield 0, _whole(path, source, source.read_image("float"))
        return
    for y in range(0, spec.height, ROWS):
        rows = spec.y + y, spec.y + min(y + ROWS, spec.height)
        yield y, _whole(path, source, source.read_scanlines(*rows, 0, 0, spec.nchannels, "float"))


def write_channels(
    path: Path, channels: Mapping[str, NDArray[np.generic]], compression: str = "zip"
) -> None:
    """Write named (H, W) channels as a float EXR; "none" reads five times as fast as "zip"."""
    stack = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    write_image(path, stack, tuple(channels), compression)


def read_picture(path: Path) -> Image:
    """Content (H, W, 3) in linear light 0..: EXR as stored, PNG and TIFF decoded from sRGB."""
    pixels, spec = read_spec(path)
    picture = np.asarray(pixels[..., colour_places(path, spec)])
    if np.issubdtype(picture.dtype, np.integer):
        encoded = picture / np.float32(np.iinfo(picture.dtype).max)
        return srgb_decode(encoded).astype(np.float32)
    require_finite(path, picture)
    return picture.astype(np.float32)


def write_picture(path: Path, linear: Image) -> None:
    """Write linear light (H, W, 3): EXR as is, PNG and TIFF as 16-bit sRGB."""
    if path.suffix == ".exr":
        write_image(path, linear.astype(np.float32), RGB)
        return
    encoded = np.rint(srgb_encode(np.clip(linear, 0, 1)) * 65535)
    write_image(path, encoded.astype(np.uint16))


def colour_places(path: Path, spec: oiio.ImageSpec) -> list[int]:
    """Where R, G and B are among a picture's channels; refuses a picture that lacks one."""
    lookup = {name.upper(): i for i, name in enumerate(spec.channelnames)}
    if not set(RGB) <= set(lookup):
        raise FileFormatError(
            f"{path}: got channels {', '.join(spec.channelnames)}, expected R, G and B; convert it "
            "to RGB"
        )
    return [lookup[c] for c in RGB]


def require_finite(name: object, picture: NDArray[np.floating]) -> None:
    """Refuse light that is NaN or infinite; `name` tells whose it is."""
    bad = int((~np.isfinite(picture)).sum())
    if bad:
        raise FileFormatError(
            f"{name}: got {bad} values that are NaN or infinite, expected finite light; "
            "render the frame again or paint over the holes"
        )


def read_spec(path: Path) -> tuple[NDArray[np.generic], oiio.ImageSpec]:
    """Pixels (H, W, C) in the file's own type, as stored, and what the file says of them."""
    with _opened(path) as source:
        spec = source.spec()
        pixels = _whole(path, source, source.read_image(spec.format))
    return pixels.reshape(spec.height, spec.width, spec.nchannels), spec


@contextmanager
def _opened(path: Path) -> Iterator[oiio.ImageInput]:
    """A picture to be read; OpenImageIO would multiply straight alpha into colours unless told otherwise."""
    if not path.is_file():
        raise FileFormatError(f"{path}: got no such file, expected an image; check the name")
    wanted = oiio.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), wanted)
    if source is None:
        raise FileFormatError(f"{path}: got no readable image ({_one_line(oiio.geterror())})")
    try:
        yield source
    finally:
        source.close()


def _whole(
    path: Path, source: oiio.ImageInput, pixels: NDArray[np.generic] | None
) -> NDArray[np.generic]:
    """Pixels as they were read, if nothing was amiss."""
    complaint, spec = source.geterror(), source.spec()
    if pixels is None or complaint:
        raise FileFormatError(
            f"{path}: got a truncated or damaged image ({_one_line(complaint)}), expected "
            f"{spec.width}x{spec.height} whole pixels; copy or capture it again"
        )
    return np.asarray(pixels)


def _one_line(complaint: str) -> str:
    return " ".join(complaint.split())
