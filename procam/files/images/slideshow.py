"""Movies of still pictures, each held for some seconds, for media servers (extra `video`)."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.files.images.movie_file import new_movie_file, video_library

Picture = NDArray[np.uint8]
RATE = 25  # pictures per second, a rate that every server plays
CODEC, PIXELS = "prores_ks", "yuv444p10le"
OPTIONS = {"profile": "4444", "qscale": "2", "vendor": "apl0"}


def write_movie(path: Path, stills: Iterable[tuple[Picture, int]]) -> None:
    """Write pictures (H, W, 1 or 3), all of one size, each held for whole seconds: ProRes 4444.

    Every picture is coded on its own (all intra), accurate to 2 of 255. A still is encoded once, and
    its packet repeated.
    """
    av = video_library()
    with new_movie_file(path, "mov") as movie:
        stream = movie.container.add_stream(CODEC, rate=RATE, options=OPTIONS)
        stream.pix_fmt, count = PIXELS, 0
        stream.codec_context.thread_count = 1  # more threads would delay the packets
        for picture, seconds in stills:
            if not count:
                stream.height, stream.width = picture.shape[:2]
            for packet in _still(av, stream, picture):
                for _ in range(seconds * RATE):
                    movie.mux(_packet_at(av, packet, stream, count))
                    count += 1


def _still(av: Any, stream: Any, picture: Picture) -> list[Any]:
    rgb = np.ascontiguousarray(np.broadcast_to(picture, (*picture.shape[:2], 3)))
    frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
    return list(stream.encode(frame.reformat(format=PIXELS, dst_colorspace="itu709")))


def _packet_at(av: Any, packet: Any, stream: Any, index: int) -> Any:
    copy = av.Packet(bytes(packet))
    copy.stream, copy.is_keyframe = stream, True
    copy.time_base = Fraction(1, RATE)
    copy.pts = copy.dts = index
    copy.duration = 1
    return copy
