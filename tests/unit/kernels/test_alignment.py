"""Arrays at odd addresses: none reaches C, where reading numbers from there is undefined."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from procam.kernels.frame.api import frame_apply, frame_sums, scattered_light
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.model import FrameModel
from procam.kernels.native.arrays import aligned, pointer
from procam.maths.codes.dither import threshold_tile
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.transfer import transfer

N = 64
OddLayout = Callable[[np.ndarray], np.ndarray]


def room(rng: np.random.Generator) -> FrameModel:
    direction, inside = master_directions(N)
    coverage = (inside & (direction[..., 2] > 0.15)).astype(np.float32)
    around = np.ascontiguousarray(np.moveaxis(direction, -1, 0), np.float32)
    low, high, spread, lamps = rng.random((4, N, N, 3), np.float32) / 9
    solid = (master_solid_angles(N) * coverage).astype(np.float32)
    gain = np.ones((N, N), np.float32)
    return FrameModel(N, spread, low, high + 1, lamps, gain, coverage, solid, around, 4)


def laid_out(model: FrameModel, layout: OddLayout) -> FrameModel:
    arrays = {f.name: getattr(model, f.name) for f in fields(model)}
    return replace(model, **{n: layout(a) for n, a in arrays.items() if isinstance(a, np.ndarray)})


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float16, np.float32])
def test_fields_and_pictures_of_any_layout(level: str, kind: Any, odd_layout: OddLayout) -> None:
    rng = np.random.default_rng(2)
    model, known = room(rng), transfer("srgb")
    coding = Coding(known.decode, known.encode, threshold_tile(), 1.0, 1.0)
    whole = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    content = (rng.random((N, N, 3)) * whole).astype(kind)
    numbers = rng.random((3, 9))
    light = scattered_light(model, numbers, -numbers)
    odd = laid_out(model, odd_layout)
    found = scattered_light(odd, odd_layout(numbers), odd_layout(-numbers))
    np.testing.assert_array_equal(found, light)
    expected = frame_apply(model, content, light, coding)
    found = frame_apply(odd, odd_layout(content), odd_layout(light), coding)
    np.testing.assert_array_equal(found, expected)
    sums = [
        frame_sums(m, layout(content), layout(light), "light", coding)
        for m, layout in ((model, np.asarray), (odd, odd_layout))
    ]
    np.testing.assert_array_equal(sums[0], sums[1])


def test_light_in_padded_memory_at_an_odd_address(level: str) -> None:
    rng = np.random.default_rng(2)
    model, numbers, known = room(rng), rng.random((3, 9)), transfer("srgb")
    coding = Coding(known.decode, known.encode, threshold_tile(), 1.0, np.inf)
    content, light = rng.random((N, N, 3), np.float32), scattered_light(model, numbers)
    block = np.zeros(4 * (light.size + 64) + 1, np.uint8)[1:].view(np.float32)
    odd = block[: light.size].reshape(light.shape)
    odd[...] = light
    expected = frame_apply(model, content, light, coding)
    np.testing.assert_array_equal(frame_apply(model, content, odd, coding), expected)


def test_addresses_are_of_aligned_arrays_alone() -> None:
    odd = np.zeros(9, np.uint8)[1:].view(np.float64)
    with pytest.raises(AssertionError):
        pointer(odd)
    assert pointer(aligned(odd)) and pointer(aligned(odd, np.float32))
