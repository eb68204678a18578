"""Movies of given pictures, lossless, for tests of what reads movies."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

# of pictures by their channels and bytes, and as FFV1 stores them
LAYOUTS = {
    (3, 1): ("rgb24", "bgr0"),
    (4, 1): ("rgba", "bgra"),
    (3, 2): ("rgb48le", "gbrp16le"),
    (4, 2): ("rgba64le", "gbrap16le"),
}
SRGB = 13  # FFmpeg's number of the transfer function


def write_lossless(
    path: Path,
    pictures: Iterable[np.ndarray],
    *,
    rate: Fraction | int = 25,
    transfer: int = 2,
    primaries: int = 2,
    lost: int | None = None,
    **options: str,
) -> Path:
    """A movie of pictures (H, W, 3 or 4) of 8 or 16 bits; the one with the number `lost` is missing."""
    pictures = list(pictures)
    height, width, channels = pictures[0].shape
    layout, stored = LAYOUTS[channels, pictures[0].itemsize]
    with av.open(str(path), "w", options=options) as movie:
        stream = movie.add_stream("ffv1", rate=rate)
        stream.width, stream.height, stream.pix_fmt = width, height, stored
        stream.codec_context.color_trc = transfer
        stream.codec_context.color_primaries = primaries
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format=layout).reformat(format=stored)
            frame.pts = number
            if number != lost:
                movie.mux(stream.encode(frame))
        movie.mux(stream.encode())
    return path
