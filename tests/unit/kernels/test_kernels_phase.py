"""wrapped_phase against its twin and against known waves."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels import reference

ANGLE_RAD = 4e-6
UNEVEN = np.array([0.1, 1.7, 3.0, 4.4, 5.9])


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs((a.astype(float) - b + np.pi) % (2 * np.pi) - np.pi)


def _wave(rng, shape: tuple[int, ...], kind: type, shifts: np.ndarray) -> list[np.ndarray]:
    scale = {np.uint8: 255, np.uint16: 65535, np.float32: 1}[kind]
    phase = rng.uniform(0, 2 * np.pi, shape)
    frames = [scale * (0.5 + 0.4 * np.cos(phase - shift)) for shift in shifts]
    return [(f if kind is np.float32 else f.round()).astype(kind) for f in frames]


def _check(found: tuple, expected: tuple) -> None:
    scale = max(1.0, float(np.nanmax(expected[1], initial=0)))
    np.testing.assert_array_less(_apart(found[0], expected[0]), ANGLE_RAD)
    for got, want in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(got, want, rtol=2e-6, atol=2e-6 * scale)


@pytest.mark.parametrize(
    "shifts", [np.arange(3) * 2 * np.pi / 3, UNEVEN, np.arange(8) * np.pi / 4, np.arange(64) * 0.7]
)
def test_fits_as_the_twin(level: str, shape: tuple[int, ...], kind: type, shifts, rng) -> None:
    frames = _wave(rng, shape, kind, shifts)
    found = kernels.wrapped_phase(frames, shifts)
    _check(found, reference.wrapped_phase(frames, shifts))
    assert all(plane.dtype == np.float32 and plane.shape == shape for plane in found)
    without = kernels.wrapped_phase(frames, shifts, with_offset=False)
    np.testing.assert_array_equal(without[0], found[0])
    np.testing.assert_array_equal(without[1], found[1])
    assert without[2] is None


def test_angles_all_round(level: str) -> None:
    """The polynomial holds 4e-6 rad on a fine circle, its corners included, and stays below a turn."""
    phase = np.concatenate([np.linspace(0, 2 * np.pi, 100_001), np.arange(9) * np.pi / 4, [-1e-9]])
    frames = [np.cos(phase - shift).astype(np.float32) for shift in UNEVEN]
    found, amplitude, offset = kernels.wrapped_phase(frames, UNEVEN)
    assert _apart(found, phase).max() < ANGLE_RAD
    assert found.min() >= 0
    assert found.astype(float).max() < 2 * np.pi
    np.testing.assert_allclose(amplitude, 1, rtol=1e-6)
    np.testing.assert_allclose(offset, 0, atol=1e-6)


def test_odd_layouts(level: str, kind: type, odd_layout: Callable, rng) -> None:
    frames = _wave(rng, (9, 21), kind, UNEVEN)
    _check(
        kernels.wrapped_phase([odd_layout(f) for f in frames], UNEVEN),
        reference.wrapped_phase(frames, UNEVEN),
    )


@pytest.mark.parametrize("start", [0, 1])
def test_writes_to_the_arrays_given(level: str, start: int, rng) -> None:
    frames = _wave(rng, (77,), np.uint8, UNEVEN)
    room = np.full((3, 80), -1, np.float32)
    out = [row[start : start + 77] for row in room]
    found = kernels.wrapped_phase(frames, UNEVEN, out=out)
    assert all(got is given for got, given in zip(found, out, strict=True))
    _check(found, reference.wrapped_phase(frames, UNEVEN))
    assert (np.delete(room, slice(start, start + 77), axis=1) == -1).all()


def test_nan_stays_and_dark_is_phase_0(level: str, rng) -> None:
    frames = _wave(rng, (50,), np.float32, UNEVEN)
    frames[3][::7] = np.nan
    phase, amplitude, offset = kernels.wrapped_phase(frames, UNEVEN)
    for plane in (phase, amplitude, offset):
        np.testing.assert_array_equal(np.isnan(plane), np.arange(50) % 7 == 0)
    dark = kernels.wrapped_phase([np.zeros(5, np.uint8)] * 3, [0, 2, 4])
    for plane in dark:
        np.testing.assert_array_equal(plane, 0)


def test_threads_change_nothing(level: str, rng) -> None:
    frames = _wave(rng, (3, 40_001), np.uint8, UNEVEN)
    with kernels.forced(level, 1):
        one = kernels.wrapped_phase(frames, UNEVEN)
    with kernels.forced(level, 2):
        two = kernels.wrapped_phase(frames, UNEVEN)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


@given(
    st.lists(st.floats(0, 6.2), min_size=3, max_size=9, unique=True),
    st.floats(0, 6.28),
    st.floats(0.1, 1e4),
)
def test_any_shifts(shifts: list[float], phase: float, amplitude: float) -> None:
    design = np.stack([np.ones(len(shifts)), np.cos(shifts), np.sin(shifts)])
    weight = np.linalg.pinv(design).max() if np.linalg.matrix_rank(design, tol=0.1) == 3 else np.inf
    if weight > 5:
        return  # the shifts lie too close together for float32
    frames = [np.full(3, 2 * amplitude + amplitude * np.cos(phase - s), "f4") for s in shifts]
    for name in kernels.available():
        with kernels.forced(name):
            found = kernels.wrapped_phase(frames, shifts)
        assert _apart(found[0], np.full(3, phase)).max() < 2e-5 * max(1, weight)
        np.testing.assert_allclose(found[1], amplitude, rtol=2e-5 * max(1, weight))


@pytest.mark.parametrize(
    ("frames", "shifts", "error", "text"),
    [
        ([np.zeros(4, np.uint8)] * 2, [0, 1], InputError, "frames: got 2, expected 3 to 64"),
        ([np.zeros(4)] * 3, [0, 2, 4], InputError, "frame 0: got float64, expected uint8"),
        (
            [np.zeros(4, "u1"), np.zeros(5, "u1"), np.zeros(4, "u1")],
            [0, 2, 4],
            ShapeError,
            "frame 1",
        ),
        ([np.zeros(4, np.uint8)] * 3, [0, 2], ShapeError, r"shifts has shape \(2,\)"),
        ([np.zeros(4, np.uint8)] * 3, [0, 2, np.nan], InputError, "expected finite angles"),
        ([np.zeros(4, np.uint8)] * 3, [0, 2, 0], InputError, "undecided"),
        ([np.zeros(4, np.uint8)] * 4, [1, 1 + 2 * np.pi, 2, 2], InputError, "undecided"),
    ],
)
def test_what_does_not_fit_is_refused(frames, shifts, error: type, text: str) -> None:
    with pytest.raises(error, match=text):
        kernels.wrapped_phase(frames, shifts)


def test_unfit_results_are_refused() -> None:
    frames = [np.zeros(4, np.uint8)] * 3
    planes = [np.zeros(8, np.float32)[::2]] * 3
    with pytest.raises(InputError, match="out: got 3 arrays, expected 2: phase, amplitude"):
        kernels.wrapped_phase(frames, [0, 2, 4], with_offset=False, out=planes)
    with pytest.raises(InputError, match="out phase: expected a writable, contiguous, aligned"):
        kernels.wrapped_phase(frames, [0, 2, 4], out=planes)
    with pytest.raises(InputError, match="out phase: got float64, expected float32"):
        kernels.wrapped_phase(frames, [0, 2, 4], out=[np.zeros(4)] * 3)
