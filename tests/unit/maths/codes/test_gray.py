"""Gray codes by brute force."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.maths.codes.gray import (
    bit_count,
    decode_gray,
    edge_distance,
    encode_gray,
    fold_pair,
    is_bright,
    long_run_codewords,
    longest_stripe,
    plain_codewords,
    shortest_stripe,
    stripe,
    xor_codewords,
)

LONG_RUNS = {  # bits: narrowest and widest stripe of the whole code
    2: (2, 2),
    3: (2, 4),
    4: (2, 8),
    5: (4, 8),
    6: (4, 8),
    7: (5, 10),
    8: (6, 11),
    9: (6, 13),
    10: (8, 15),
    11: (8, 18),
    12: (8, 20),
    13: (9, 20),
}
PANELS = (600, 720, 768, 800, 1024, 1050, 1080, 1200, 1280, 1440, 1600, 1920, 2048)
LARGE_PANELS = (2160, 2400, 2560, 2716, 3840, 4096, 4320, 5120, 7680, 8192)


@given(length=st.integers(2, 40000))
def test_bits_are_enough_and_none_is_wasted(length: int) -> None:
    bits = bit_count(length)
    assert 2**bits >= length
    assert bits == 1 or 2 ** (bits - 1) < length


@given(length=st.integers(1, 9000))
def test_round_trip_of_any_width(length: int) -> None:
    index = np.arange(length)
    np.testing.assert_array_equal(decode_gray(encode_gray(index), bit_count(length)), index)


@given(length=st.integers(2, 5000))
def test_neighbours_differ_in_one_bit(length: int) -> None:
    code = encode_gray(np.arange(length))
    np.testing.assert_array_equal(np.bitwise_count(code[1:] ^ code[:-1]), 1)


@given(length=st.integers(2, 3000))
def test_stripes_are_the_bits_of_the_code(length: int) -> None:
    planes = [stripe(length, bit) for bit in range(bit_count(length))]
    code = sum(plane.astype(int) << bit for bit, plane in enumerate(planes))
    np.testing.assert_array_equal(decode_gray(code, len(planes)), np.arange(length))


@pytest.mark.parametrize("bit", range(6))
def test_edge_distance_by_brute_force(bit: int) -> None:
    line = stripe(512, bit)
    edges = np.flatnonzero(line[1:] != line[:-1]) + 0.5
    place = np.linspace(0, 400, 1234)
    expected = np.abs(place[:, None] - edges).min(axis=1)
    np.testing.assert_allclose(edge_distance(place, bit), expected, atol=1e-9)


@pytest.mark.parametrize("bit", range(6))
def test_is_bright_reads_the_stripe_of_the_column(bit: int) -> None:
    index = np.random.default_rng(3).integers(0, 256, (12, 20)).astype(np.int32)
    np.testing.assert_array_equal(is_bright(index, bit), stripe(256, bit)[index])


@given(place=st.floats(0, 1000), bit=st.integers(0, 8))
def test_light_only_changes_across_an_edge(place: float, bit: int) -> None:
    """Inside a step shorter than the distance to the nearest edge, bright stays bright."""
    reach = edge_distance(np.array([place]), bit)[0]
    near = place + 0.999 * reach * np.linspace(-1, 1, 9)
    columns = np.rint(near[near >= -0.5]).astype(int)
    assert len(set(is_bright(columns, bit))) == 1 or reach == 0


def test_unknown_places_have_an_unknown_distance() -> None:
    found = edge_distance(np.array([np.nan, 1.0], np.float32), 0)
    assert np.isnan(found[0]) and found[1] == 0.5


def runs(codewords: np.ndarray, bit: int) -> list[int]:
    """Widths of the stripes of one plane, column by column."""
    plane = (codewords >> bit) & 1
    return [len(list(group)) for _, group in groupby(plane.tolist())]


def assert_gray(codewords: np.ndarray, length: int) -> None:
    assert codewords.shape == (length,)
    assert len(np.unique(codewords)) == length
    assert codewords.min() >= 0 and codewords.max() < 2 ** bit_count(length)
    np.testing.assert_array_equal(np.bitwise_count(codewords[1:] ^ codewords[:-1]), 1)


@given(length=st.integers(2, 3000))
def test_plain_codewords_are_the_stripes(length: int) -> None:
    code = plain_codewords(length)
    for bit in range(bit_count(length)):
        np.testing.assert_array_equal((code >> bit) & 1, stripe(length, bit))


@given(length=st.integers(2, 500), base=st.integers(0, 3))
def test_stripe_widths_by_brute_force(length: int, base: int) -> None:
    code = xor_codewords(length, base)
    planes = [runs(code, bit) for bit in range(bit_count(length))]
    assert longest_stripe(code) == max(max(plane) for plane in planes)
    inner = [width for plane in planes for width in plane[1:-1]]
    assert shortest_stripe(code) == min(inner, default=length)


@pytest.mark.parametrize("length", range(2, 1025))
def test_long_run_code_of_every_short_panel(length: int) -> None:
    code = long_run_codewords(length)
    narrowest, widest = LONG_RUNS.get(bit_count(length), (1, 1))
    assert_gray(code, length)
    assert shortest_stripe(code) >= narrowest
    assert longest_stripe(code) <= widest


@pytest.mark.parametrize("length", PANELS + LARGE_PANELS)
def test_long_run_code_of_panels(length: int) -> None:
    code = long_run_codewords(length)
    assert_gray(code, length)
    assert (shortest_stripe(code), longest_stripe(code)) == LONG_RUNS[bit_count(length)]


@given(length=st.integers(2, 8192))
def test_long_run_code_of_any_panel(length: int) -> None:
    code = long_run_codewords(length)
    narrowest, widest = LONG_RUNS.get(bit_count(length), (1, 1))
    assert_gray(code, length)
    assert shortest_stripe(code) >= narrowest
    assert longest_stripe(code) <= widest


@pytest.mark.parametrize("bits", range(2, 16))
def test_long_run_code_closes(bits: int) -> None:
    code = long_run_codewords(2**bits)
    assert_gray(code, 2**bits)
    assert int(code[0] ^ code[-1]).bit_count() == 1
    again = np.r_[code, code]
    assert shortest_stripe(again) == shortest_stripe(code)


@given(length=st.integers(2, 4096))
def test_every_plane_has_light_and_dark(length: int) -> None:
    code = long_run_codewords(length)
    assert np.bitwise_or.reduce(code) == 2 ** bit_count(length) - 1
    assert np.bitwise_and.reduce(code) == 0


def test_a_caller_cannot_spoil_the_long_run_code() -> None:
    kept = long_run_codewords(300)
    long_run_codewords(300)[:] = 0
    np.testing.assert_array_equal(long_run_codewords(300), kept)


@given(length=st.integers(2, 5000), base=st.integers(0, 1))
def test_xor_planes(length: int, base: int) -> None:
    """The base plane and the finer ones are plain; XOR with the base plane gives the rest back."""
    code, plain = xor_codewords(length, base), plain_codewords(length)
    assert len(np.unique(code)) == length
    assert code.min() >= 0 and code.max() < 2 ** bit_count(length)
    for bit in range(bit_count(length)):
        restored = (code >> bit) ^ (code >> base if bit > base else 0)
        np.testing.assert_array_equal(restored & 1, (plain >> bit) & 1)


@pytest.mark.parametrize("base", [0, 1])
@pytest.mark.parametrize("length", PANELS + LARGE_PANELS)
def test_xor_stripes_are_narrow(length: int, base: int) -> None:
    code = xor_codewords(length, base)
    assert longest_stripe(code) == 2 ** (base + 1)
    assert shortest_stripe(code) == 2**base


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_folded_pairs_hold_code_and_contrast(kind: type, rng: np.random.Generator) -> None:
    """Also over more rows than are folded at a time."""
    stack = rng.integers(0, 250, (4, 200, 700)).astype(kind)
    code, least, most = (
        np.zeros((200, 700), np.uint16),
        np.full((200, 700), 255, kind),
        0 * stack[0],
    )
    for k, bit in enumerate((15, 3)):
        fold_pair(stack[2 * k], stack[2 * k + 1], bit, (code, least, most))
    contrast = np.abs(stack[::2].astype(float) - stack[1::2])
    above = stack[::2] > stack[1::2]
    np.testing.assert_array_equal(code, above[0] * 2**15 + above[1] * 2**3)
    np.testing.assert_array_equal(least, contrast.min(axis=0))
    np.testing.assert_array_equal(most, contrast.max(axis=0))


def test_a_pixel_without_a_value_has_no_contrast_and_no_bit() -> None:
    state = np.zeros(4, np.uint16), np.full(4, np.inf, np.float32), np.zeros(4, np.float32)
    pattern, inverse = np.array([[np.nan, 1, np.inf, 5], [1, np.nan, np.inf, 2]], np.float32)
    fold_pair(pattern, inverse, 0, state)
    np.testing.assert_array_equal(np.stack(state), [[0, 0, 0, 1], [0, 0, 0, 3], [0, 0, 0, 3]])
