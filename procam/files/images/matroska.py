"""Checksums of a Matroska file's header, which FFmpeg writes and does not check.

The header has the size of the pictures, and nothing else in a lossless movie repeats it. Elements are an
id, a size and a content (RFC 8794); a content that begins with a CRC-32 element is checked by it.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path

HEADER_BYTES = 2**20  # of a file; pictures begin long before
SEGMENT, CLUSTER = 0x18538067, 0x1F43B675
CRC = b"\xbf\x84"  # an element of four bytes


def header_is_whole(path: Path) -> bool:
    """Whether no checksum in the header is wrong; a header without any is taken as it is."""
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES)
    return all(
        zlib.crc32(content[6:]) == int.from_bytes(content[2:6], "little")
        for content in _elements(data)
        if content.startswith(CRC)
    )


def _elements(data: bytes) -> Iterator[bytes]:
    """Contents of the elements before the first pictures, those of the segment one by one."""
    at = 0
    while at < len(data):
        number, at = _number(data, at, keep_marker=True)
        size, at = _number(data, at, keep_marker=False)
        if number == CLUSTER:
            return
        if number == SEGMENT:
            continue
        yield data[at : at + size]
        at += max(size, 1)


def _number(data: bytes, at: int, *, keep_marker: bool) -> tuple[int, int]:
    """A number of one to eight bytes, its length in its leading zeros, and where the next begins."""
    first = data[at] if at < len(data) else 0
    length = 9 - first.bit_length() if first else 8
    value = int.from_bytes(data[at : at + length], "big")
    return (value if keep_marker else value & ~(1 << 7 * length)), at + length
