"""Gray codes by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.maths.gray import (
    bit_count,
    decode_gray,
    edge_distance,
    encode_gray,
    is_bright,
    stripe,
)


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
