"""Pixels in and out of PNG, TIFF and EXR files through OpenImageIO.

Every read checks that the whole file was there: a truncated EXR must never read as black.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.files.atomic import replacing, require_room
from procam.files.images.jpeg import require_whole

STORED_AS = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
SUFFIXES = (".png", ".tif", ".tiff", ".exr")  # lossless formats; OpenImageIO would write more
MOST_MIB = 4096  # of a picture in memory: 16384 x 16384 px of four floats
ROWS = 64  # read at a time, so that they fit the cache

oiio.attribute("limits:imagesize_MB", MOST_MIB)  # else a damaged header may ask for all memory


def write_image(path: Path, pixels: NDArray[np.generic], channels: Sequence[str] = ()) -> None:
    """Write (H, W) or (H, W, C) pixels durably, by the suffix and dtype (a key of `STORED_AS`).

    TIFF is uncompressed, because raw captures have to be fast; EXR has lossless zip compression.
    """
    require_suffix(path)
    data = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    height, width, count = data.shape
    spec = oiio.ImageSpec(width, height, count, STORED_AS[str(data.dtype)])
    spec.attribute("compression", {".exr": "zip", ".tif": "none"}.get(path.suffix, ""))
    if path.suffix == ".png":
        spec.attribute("png:compressionLevel", 1)
    if channels:
        spec.channelnames = tuple(channels)
    write_spec(path, data, spec)


def require_suffix(path: Path) -> None:
    """Refuse a name without the suffix of a lossless format."""
    if path.suffix not in SUFFIXES:
        raise FileFormatError(
            f"{path}: images are written as .png, .tif or .exr, not {path.suffix!r}; rename it"
        )


def write_spec(path: Path, data: NDArray[np.generic], spec: oiio.ImageSpec) -> None:
    """Write contiguous pixels (H, W, C) durably, as OpenImageIO's `spec` describes them.

    What was written is read back and compared, because OpenImageIO does not report every failed write.
    """
    with replacing(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        assert output is not None
        done = output.open(str(temporary), spec) and output.write_image(data) and output.close()
        if temporary.exists():
            require_room(temporary)  # before the library's own words about a full disk
        if not done:
            raise FileFormatError(f"{path} could not be written ({_one_line(output.geterror())})")
        if not _holds(temporary, data, spec):
            raise FileFormatError(
                f"{path} could not be written: its pixels differ when they are read back. Is the disk full "
                "or failing? Write to another one"
            )


def read_image(path: Path) -> NDArray[np.generic]:
    """Pixels (H, W, C) in the file's own type."""
    return read_spec(path)[0]


def read_spec(path: Path) -> tuple[NDArray[np.generic], oiio.ImageSpec]:
    """Pixels (H, W, C) in the file's own type, and the file's header."""
    with opened(path) as source:
        if source.format_name() == "jpeg":
            require_whole(path)
        spec = source.spec()
        pixels = _checked(path, source, source.read_image(spec.format))
    return pixels.reshape(spec.height, spec.width, spec.nchannels), spec


def read_header(path: Path) -> oiio.ImageSpec:
    """Size, type and attributes of an image file."""
    with opened(path) as source:
        return source.spec()


@contextmanager
def opened(path: Path) -> Iterator[oiio.ImageInput]:
    """An image file, open for reading; straight alpha is not multiplied into the colours."""
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; an image is needed. Check the name")
    wanted = oiio.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), wanted)
    try:
        if source is None:
            raise FileFormatError(f"{path} is not a readable image ({_one_line(oiio.geterror())})")
        if source.format_name() == "gif":  # has a palette, and may move
            raise FileFormatError(f"{path} is a GIF, whatever its name says; save it as PNG or EXR")
        yield source
    except UnicodeDecodeError as error:  # names in the header, or the library's message about them
        raise FileFormatError(f"{path} is damaged: a name in its header is no text") from error
    finally:
        if source is not None:
            source.close()


def read_rows(
    path: Path, source: oiio.ImageInput, pixel_type: str = "float"
) -> Iterator[tuple[int, NDArray[np.generic]]]:
    """First row and pixels (R, W, C) of each part of an image; a tiled one is one part."""
    spec = source.spec()
    if spec.tile_width:
        yield 0, _checked(path, source, source.read_image(pixel_type))
        return
    for y in range(0, spec.height, ROWS):
        rows = spec.y + y, spec.y + min(y + ROWS, spec.height)
        part = source.read_scanlines(*rows, 0, 0, spec.nchannels, pixel_type)
        yield y, _checked(path, source, part)


def _holds(path: Path, data: NDArray[np.generic], spec: oiio.ImageSpec) -> bool:
    """Whether a file holds pixels (H, W, C); those that it rounds to fewer bits need only be readable."""
    try:
        return _same_pixels(path, data, spec)
    except FileFormatError:
        return False


def _same_pixels(path: Path, data: NDArray[np.generic], spec: oiio.ImageSpec) -> bool:
    rounded = spec.get_int_attribute("oiio:BitsPerSample", 0) % 8
    with opened(path) as source:
        stored = source.spec()
        places = [stored.channelindex(name) for name in spec.channelnames]  # EXR sorts them
        if -1 in places:
            places = list(range(stored.nchannels))
        if (stored.height, stored.width, len(places)) != data.shape:
            return False
        for y, part in read_rows(path, source, str(spec.format)):
            rows = part.reshape(-1, stored.width, stored.nchannels)[..., places]
            wanted = data[y : y + len(rows)]
            if not rounded and not np.array_equal(rows, wanted, equal_nan=data.dtype.kind == "f"):
                return False
    return True


def _checked(
    path: Path, source: oiio.ImageInput, pixels: NDArray[np.generic] | None
) -> NDArray[np.generic]:
    """Pixels that were read without an error."""
    message, spec = source.geterror(), source.spec()
    if pixels is None or message:
        raise FileFormatError(
            f"{path} is truncated or damaged ({_one_line(message)}): it should hold "
            f"{spec.width}x{spec.height} pixels; copy or capture it again"
        )
    return np.asarray(pixels)


def _one_line(message: str) -> str:
    return " ".join(message.split())
