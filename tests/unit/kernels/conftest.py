"""Levels, types and memory layouts that the kernels are tested with."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from procam import kernels

KINDS = [np.uint8, np.uint16, np.float32]


@pytest.fixture(params=kernels.available())
def level(request: pytest.FixtureRequest) -> Iterator[str]:
    with kernels.forced(request.param) as active:
        yield active


@pytest.fixture(params=KINDS, ids=lambda kind: kind.__name__)
def kind(request: pytest.FixtureRequest) -> type:
    return request.param


def _strided(array: np.ndarray) -> np.ndarray:
    """Every second element of a wider array, backwards."""
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
    wide[..., ::2] = array[..., ::-1]
    return wide[..., ::2][..., ::-1]


def _unaligned(array: np.ndarray) -> np.ndarray:
    """The same values one byte past an aligned address."""
    room = np.zeros(array.nbytes + 1, np.uint8)
    view = room[1:].view(array.dtype).reshape(array.shape)
    view[...] = array
    return view


@pytest.fixture(params=[_strided, _unaligned], ids=["strided", "unaligned"])
def odd_layout(request: pytest.FixtureRequest) -> Callable[[np.ndarray], np.ndarray]:
    return request.param
