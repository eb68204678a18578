"""Conversion of movie frames between codecs' pixel layouts and RGB, with swscale.

swscale is accurate to half a step in 8 bits, but its 16-bit white is 255/256 of full scale for limited
range, and slightly below full scale for full range; `from_swscale` and `to_swscale` correct this.
"""

from typing import Any

import numpy as np

from procam.arrays import AnyArray

LAYOUTS = {
    (False, False): "rgb24",
    (True, False): "rgb48le",
    (False, True): "rgba",
    (True, True): "rgba64le",
}  # by whether more than 8 bits, and whether there is alpha
# exact to half a step of 8 bits; the defaults are off by up to 3
SCALING = "BICUBIC", "ACCURATE_RND", "FULL_CHR_H_INT", "FULL_CHR_H_INP"
LIMITED, FULL = 1, 2  # FFmpeg's colour ranges
RGB_MATRIX, BT709, BT601, UNKNOWN = 0, 1, 5, 2  # FFmpeg's colour matrices


class Converter:
    """Changes the pixel layout of frames with swscale's exact paths."""

    def __init__(self, av: Any) -> None:
        kinds = av.video.reformatter.Interpolation
        self._flags = kinds(0)
        for name in SCALING:
            self._flags |= kinds[name]
        self._reformatter = av.video.reformatter.VideoReformatter()

    def frame(self, frame: Any, layout: str, matrix: int, limited: tuple[bool, bool]) -> Any:
        """The frame in another layout; `limited`: whether source and result have limited range."""
        return self._reformatter.reformat(
            frame,
            format=layout,
            src_colorspace=matrix,
            dst_colorspace=matrix,
            interpolation=self._flags,
            src_color_range=LIMITED if limited[0] else FULL,
            dst_color_range=LIMITED if limited[1] else FULL,
        )


def from_swscale(pixels: AnyArray, bits: int) -> AnyArray:
    """16-bit RGB whose white is (2^bits - 1) << (16 - bits), with white at 65535."""
    top = np.uint16(((1 << bits) - 1) << (16 - bits))
    clipped = np.minimum(pixels, top)
    return np.asarray(clipped + (clipped >> np.uint16(bits)))


def to_swscale(pixels: AnyArray) -> AnyArray:
    """16-bit RGB with white at 65280, which swscale takes for white in limited range."""
    whole = np.asarray(pixels, np.uint16)
    return np.asarray(whole - (whole >> np.uint16(8)))
