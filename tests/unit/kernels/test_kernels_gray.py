"""fold_pairs against its twin."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels import reference

Layout = Callable[[np.ndarray], np.ndarray]


def _pictures(rng: np.random.Generator, shape: tuple[int, ...], kind: type) -> list[np.ndarray]:
    if kind is np.float32:
        return [rng.normal(0, 1, shape).astype(kind) for _ in range(2)]
    return [rng.integers(0, np.iinfo(kind).max + 1, shape).astype(kind) for _ in range(2)]


def _state(rng: np.random.Generator, shape: tuple[int, ...], kind: type) -> list[np.ndarray]:
    code = rng.integers(0, 1 << 16, shape).astype(np.uint16)
    most, least = np.sort([abs(p) for p in _pictures(rng, shape, kind)], axis=0)
    return [code, least.astype(kind), most.astype(kind)]


@pytest.mark.parametrize("without", [(), (1,), (2,), (1, 2)], ids=str)
def test_folds_as_the_twin(
    level: str, shape: tuple[int, ...], kind: type, without: tuple[int, ...], rng
) -> None:
    pictures, state = _pictures(rng, shape, kind), _state(rng, shape, kind)
    expected = [plane.copy() for plane in state]
    keep = [None if i in without else plane for i, plane in enumerate(state)]
    keep_expected = [None if i in without else plane for i, plane in enumerate(expected)]
    kernels.fold_pairs([(*pictures, 11)], *keep)
    reference.fold_pair(*pictures, 11, *keep_expected)
    np.testing.assert_array_equal(state[0], expected[0])
    np.testing.assert_array_equal(state[1], expected[1])
    np.testing.assert_array_equal(state[2], expected[2])


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_several_pairs_are_one_after_the_other(
    level: str, shape: tuple[int, ...], kind: type, count: int, rng
) -> None:
    pairs = [(*_pictures(rng, shape, kind), bit) for bit in range(count)]
    state = _state(rng, shape, kind)
    expected = [plane.copy() for plane in state]
    kernels.fold_pairs(pairs, *state)
    for pair in pairs:
        reference.fold_pair(*pair, *expected)
    for got, want in zip(state, expected, strict=True):
        np.testing.assert_array_equal(got, want)


def test_several_large_pairs_at_once(level: str, kind: type, rng) -> None:
    pairs = [(*_pictures(rng, (3, 12_345), kind), bit) for bit in (3, 9, 14)]
    state = _state(rng, (3, 12_345), kind)
    expected = [plane.copy() for plane in state]
    with kernels.forced(level, 2):
        kernels.fold_pairs(pairs, *state)
    for pair in pairs:
        reference.fold_pair(*pair, *expected)
    for got, want in zip(state, expected, strict=True):
        np.testing.assert_array_equal(got, want)


def test_odd_layouts_are_read_and_written_in_place(
    level: str, kind: type, odd_layout: Layout, rng
) -> None:
    pictures, state = _pictures(rng, (9, 21), kind), _state(rng, (9, 21), kind)
    laid = [odd_layout(plane) for plane in state]
    kernels.fold_pairs([(*map(odd_layout, pictures), 3)], *laid)
    reference.fold_pair(*pictures, 3, *state)
    for got, want in zip(laid, state, strict=True):
        np.testing.assert_array_equal(got, want)


def test_nan_is_no_contrast_and_bit_0(level: str) -> None:
    pattern = np.full(37, 5, np.float32)
    inverse = np.full(37, 2, np.float32)
    pattern[::3], inverse[1::3] = np.nan, np.nan
    code, least, most = np.zeros(37, np.uint16), np.ones(37, np.float32), np.ones(37, np.float32)
    kernels.fold_pairs([(pattern, inverse, 0)], code, least, most)
    known = np.arange(37) % 3 == 2
    np.testing.assert_array_equal(code, known)
    np.testing.assert_array_equal(least, known * 1.0)
    np.testing.assert_array_equal(most, np.where(known, 3, 1))


def test_threads_change_nothing(level: str, kind: type, rng) -> None:
    shape = (3, 40_001)
    pictures = _pictures(rng, shape, kind)
    results = []
    for threads in (1, 2):
        state = _state(np.random.default_rng(5), shape, kind)
        with kernels.forced(level, threads):
            kernels.fold_pairs([(*pictures, 15)], *state)
        results.append(state)
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)


@given(
    hnp.arrays(np.float32, (2, 19), elements=st.floats(width=32, allow_nan=True)),
    st.integers(0, 15),
)
def test_any_float(values: np.ndarray, bit: int) -> None:
    for name in kernels.available():
        codes, least, most = (
            np.zeros((2, 19), np.uint16),
            np.ones((2, 19), "f4"),
            np.ones((2, 19), "f4"),
        )
        with kernels.forced(name):
            kernels.fold_pairs([(values[0], values[1], bit)], codes[0], least[0], most[0])
        with np.errstate(over="ignore"):
            reference.fold_pair(values[0], values[1], bit, codes[1], least[1], most[1])
        np.testing.assert_array_equal(codes[0], codes[1])
        np.testing.assert_array_equal(least[0], least[1])
        np.testing.assert_array_equal(most[0], most[1])


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"bit": 16}, InputError, "bit: got 16, expected 0 to 15"),
        ({"pattern": np.zeros(4)}, InputError, "pattern: got float64, expected uint8"),
        ({"inverse": np.zeros(3, np.uint8)}, ShapeError, r"inverse has shape \(3,\)"),
        ({"inverse": np.zeros(4, np.uint16)}, InputError, "inverse: got uint16, expected uint8"),
        ({"code": np.zeros(4, np.int32)}, InputError, "code: got int32, expected uint16"),
        ({"least": np.zeros(4, np.float32)}, InputError, "least: got float32, expected uint8"),
        ({"most": np.zeros((2, 2), np.uint8)}, ShapeError, r"most has shape \(2, 2\)"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict, error: type, text: str) -> None:
    given = {"pattern": np.zeros(4, np.uint8), "inverse": np.zeros(4, np.uint8), "bit": 0}
    given |= {"code": np.zeros(4, np.uint16), "least": None, "most": None}
    given |= change
    pair = (given.pop("pattern"), given.pop("inverse"), given.pop("bit"))
    with pytest.raises(error, match=text):
        kernels.fold_pairs([pair], **given)
