"""Pictures as the bytes of a file in a bundle: written anew, so that only their pixels get in."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from procam.files.images.photos import load_response, write_response
from procam.files.images.pixels import read_header, read_image, write_image, write_spec
from procam.files.venue.masks import read_mask

WHEN = "1980:01:01 00:00:00"  # in headers; the same session must give the same bytes


def frame_bytes(counts: NDArray[np.uint16]) -> bytes:
    """A TIFF of counts (H, W) or (H, W, 3), packed by zip: half the size of the raw ones in a session."""
    data = np.ascontiguousarray(counts if counts.ndim == 3 else counts[..., None])
    height, width, channels = data.shape
    spec = oiio.ImageSpec(width, height, channels, "uint16")
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", WHEN)
    return _file_bytes("frame.tif", lambda path: write_spec(path, data, spec))


def picture_bytes(source: Path) -> bytes:
    """A PNG of another picture's pixels."""
    return _file_bytes("picture.png", lambda path: write_image(path, read_image(source)))


def mask_bytes(source: Path) -> bytes:
    """A PNG that is white where a mask covers; the picture it was drawn over does not get in."""
    header = read_header(source)
    white = read_mask(source, (header.width, header.height)).astype(np.uint8) * np.uint8(255)
    return _file_bytes("mask.png", lambda path: write_image(path, white))


def response_bytes(source: Path) -> bytes:
    """A table of a camera's response, with all digits."""
    response = load_response(source.name, source.parent)
    assert response is not None
    return _file_bytes("response.csv", lambda path: write_response(path, *response))


def _file_bytes(name: str, write: Callable[[Path], None]) -> bytes:
    """The bytes of the file that `write` makes."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()
