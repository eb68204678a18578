"""The Gray code by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.maths.codes.gray import (
    encode_gray,
    fold_pair,
    is_bright,
    stripe,
    stripe_edge_distance,
)


@given(length=st.integers(2, 40000))
def test_bits_are_enough_and_none_is_wasted(length: int) -> None:
    bits = (length - 1).bit_length()
    assert 2**bits >= length
    assert bits == 1 or 2 ** (bits - 1) < length


def test_codewords_differ_and_neighbours_differ_in_one_bit() -> None:
    code = encode_gray(np.arange(8192))
    assert len(np.unique(code)) == 8192 and code.max() < 8192
    np.testing.assert_array_equal(np.bitwise_count(code[1:] ^ code[:-1]), 1)


def test_stripes_are_the_bits_of_the_codewords() -> None:
    index = np.random.default_rng(3).integers(0, 600, (12, 20)).astype(np.int32)
    for bit in range(10):
        line = stripe(600, bit)
        np.testing.assert_array_equal(line, (encode_gray(np.arange(600)) >> bit) & 1)
        np.testing.assert_array_equal(is_bright(index, bit), line[index])


@pytest.mark.parametrize("bit", [0, 1, 5])
def test_edge_distance_by_brute_force(bit: int) -> None:
    line = stripe(512, bit)
    edges = np.flatnonzero(line[1:] != line[:-1]) + 0.5
    position = np.linspace(0, 400, 1234)
    expected = np.abs(position[:, None] - edges).min(axis=1)
    np.testing.assert_allclose(stripe_edge_distance(position, bit), expected, atol=1e-9)


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
