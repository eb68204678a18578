"""Decoding holds a fixed state, however many pictures arrive."""

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from procam.estimate.structured_light.codes import AxisCode, Code, make_code, picture
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import DecodeLimits
from procam.maths.codes.gray import encode_gray
from studies.one_fringe import wave_code

SHAPE = (300, 400)
LIMITS = DecodeLimits(20, 10, saturated=None)


def photographs(code: Code) -> Iterator[tuple[int, np.ndarray]]:
    """Pictures of a panel that fills the camera, uint8, made one at a time."""
    width, height = code.size
    columns = np.arange(SHAPE[1]) * width // SHAPE[1]
    rows = np.arange(SHAPE[0]) * height // SHAPE[0]
    for number, plane in enumerate(code.planes):
        seen = picture(code, plane, 1.0)[..., 0][np.ix_(rows, columns)]
        yield number, (20 + 0.7 * seen).astype(np.uint8)


def held_bytes(code: Code) -> float:
    """Most bytes per camera pixel that the decoder holds while pictures arrive, beyond the one at hand."""
    decoder, most = Decoder(code, LIMITS), 0.0
    tracemalloc.start()
    for number, image in photographs(code):
        decoder.add(number, image)
        held, _ = tracemalloc.get_traced_memory()
        most = max(most, held / image.size - 1)
    tracemalloc.stop()
    return most


def gray(bits: int) -> Code:
    length = 2**bits
    axis = AxisCode(length, codewords=encode_gray(np.arange(length)))
    return Code("gray", (length, length), axis, axis)


def test_stripes_hold_as_much_for_44_pictures_as_for_24() -> None:
    few, many = held_bytes(gray(6)), held_bytes(gray(10))
    # white, black, and per axis code, least and most contrast, and at most one pair that waits
    assert few <= 2 + 2 * 4 + 3 + 3
    assert many <= few + 1


@pytest.mark.parametrize("name", ["micro-phase", "phase-heterodyne"])
def test_waves_hold_one_axis_at_a_time(name: str) -> None:
    code = make_code(name, (400, 300))
    per_axis = (len(code.planes) - 2) / 2
    floats = 3 * 4  # place, standard error and amplitude of the axis that is done
    assert held_bytes(code) <= 2 + per_axis + 2 * floats + 1


def test_more_steps_hold_more_of_one_axis_only() -> None:
    eight, sixteen = (held_bytes(wave_code((400, 300), (400, 300), n)) for n in (8, 16))
    assert sixteen - eight <= 8 + 1
