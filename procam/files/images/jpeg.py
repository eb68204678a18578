"""Checks that the data of a JPEG are whole.

Decoders go on after damage: what they cannot read is grey, and what follows a damaged part is displaced and
of other brightness. They report data that end too early, but not data that are left over, which damage leaves
as often. So the last bytes are cut off: a picture that is still complete without them was damaged.
"""

import struct
from pathlib import Path
from tempfile import TemporaryDirectory

import OpenImageIO as oiio

from procam.errors import FileFormatError

START_OF_SCAN, END = 0xDA, 0xD9
FILL = 0xFF
NO_LENGTH = (0x01, *range(0xD0, 0xD9))  # markers without a segment
WITHIN_SCAN = (0x00, *range(0xD0, 0xD8), FILL)  # after 0xFF in a scan's data
SPARE = 16  # bytes; some cameras fill up the data with a few


def require_whole(path: Path) -> None:
    """Refuse a JPEG whose data end too early or go on for too long.

    Raises
    ------
    FileFormatError
        It is damaged.
    """
    data = path.read_bytes()
    end = _end_of_data(data)
    if end is None:
        raise FileFormatError(f"{path} is truncated; copy it again")
    with TemporaryDirectory() as folder:
        cut = Path(folder) / "cut.jpg"
        cut.write_bytes(data[: end - SPARE] + data[end:])
        if _reads_without_complaint(cut):
            raise FileFormatError(
                f"{path} is damaged: its picture is complete before its data end, so that a part of it is "
                "displaced. Copy it from the camera's card again, or photograph again"
            )


def _end_of_data(data: bytes) -> int | None:
    """Where the data of the last scan end; None if there is no end."""
    place = 2
    while place + 4 <= len(data):
        if data[place] != FILL:
            return None
        marker = data[place + 1]
        if marker == FILL:
            place += 1
        elif marker in NO_LENGTH:
            place += 2
        elif marker == START_OF_SCAN:
            start, place = place, _end_of_scan(data, _after_segment(data, place))
            if data[place : place + 2] == bytes((FILL, END)):
                return place
            if place == start:
                return None
        else:
            place = _after_segment(data, place)
    return None


def _after_segment(data: bytes, place: int) -> int:
    return place + 2 + max(2, struct.unpack_from(">H", data, place + 2)[0])


def _end_of_scan(data: bytes, place: int) -> int:
    """Place of the marker after a scan; the end of all if there is none."""
    while (place := data.find(FILL, place)) >= 0 and place + 1 < len(data):
        if data[place + 1] not in WITHIN_SCAN:
            return place
        place += 1
    return len(data)


def _reads_without_complaint(path: Path) -> bool:
    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()
        return False
    pixels = source.read_image(source.spec().format)
    whole = pixels is not None and not source.geterror()
    source.close()
    return whole
