"""Checksums of FFV1 (RFC 9043, s. 4.9): FFmpeg conceals a damaged slice and says nothing."""

import zlib
from collections.abc import Iterator

FOOTER, CHECKED_FOOTER = 3, 8  # bytes after a slice: its size; and a status and a checksum
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
ONES = 0xFFFFFFFF
STARTS = 0, 0x5E31029E  # of the checksum; the second one in version 4


def has_checksums(packet: bytes) -> bool | None:
    """Whether the slices of a frame carry checksums; None if it is no row of slices at all."""
    if list(_slices(packet, CHECKED_FOOTER)):
        return True
    return False if list(_slices(packet, FOOTER)) else None


def is_whole(packet: bytes) -> bool:
    """Whether a frame is a row of slices whose checksums hold."""
    slices = list(_slices(packet, CHECKED_FOOTER))
    return bool(slices) and any(
        all(_remainder(packet[part], start) == start for part in slices) for start in STARTS
    )


def _slices(packet: bytes, footer: int) -> Iterator[slice]:
    """The slices of a frame, the last one first; none unless they fill it."""
    found, end = [], len(packet)
    while end >= footer:
        size = int.from_bytes(packet[end - footer : end - footer + 3]) + footer
        found.append(slice(end - size, end))
        end -= size
    yield from found if end == 0 else ()


def _remainder(data: bytes, start: int) -> int:
    """CRC with FFV1's polynomial, most significant bit first: zlib's with all bits reversed, like `start`."""
    return zlib.crc32(data.translate(REVERSED), start ^ ONES) ^ ONES
