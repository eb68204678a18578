"""search_phase against its reference implementation, known positions and against its own variance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels import PhaseFit
from procam.kernels.search import reference

POSITION_PX = 1e-3


@dataclass(frozen=True)
class Wave:
    """Frames of known coordinates under a set of sinusoids."""

    periods: np.ndarray
    shifts: np.ndarray
    modulation: np.ndarray
    harmonic: np.ndarray
    base: int = 3
    length: float = 1000.0

    @property
    def terms(self) -> tuple:
        return (
            *(self.periods, self.shifts, self.modulation, self.harmonic),
            *(self.base, self.length),
        )

    def frames(self, x: np.ndarray, kind: type, rng, noise: float = 0.0) -> list[np.ndarray]:
        """Offset 100, amplitude 80, in counts of 8 bit or scaled to the kind."""
        scale = {np.uint8: 1.0, np.uint16: 256.0, np.float32: 1 / 256}[kind]
        found = []
        for p, s, m, h in zip(*self.terms[:4], strict=True):
            t = 2 * np.pi * x / p - s
            value = 100 + 80 * (m * np.cos(t) + h * np.cos(2 * t)) + rng.normal(0, noise, x.shape)
            found.append(value * scale if kind is np.float32 else (value * scale).round())
        return [value.astype(kind) for value in found]


def wave(extras: int, *, harmonic: float = 0.0, period: float = 64.0) -> Wave:
    periods = np.array([period] * 3 + [period * (1.07 + 0.051 * k) for k in range(extras)])
    shifts = np.concatenate([np.arange(3) * 2 * np.pi / 3, np.linspace(0, 2, extras)])
    modulation = np.concatenate([np.full(3, 0.9), np.linspace(0.85, 0.95, extras)])
    return Wave(periods, shifts, modulation, np.full(3 + extras, harmonic))


def check(found: PhaseFit, expected: PhaseFit, scale: float = 1.0) -> None:
    """Equal to the reference, except for pixels whose two best periods are nearly tied."""
    for plane, want in zip(found, expected, strict=True):
        assert plane.dtype == np.float32
        np.testing.assert_array_equal(np.isnan(plane), np.isnan(want))
    clear = expected.margin > 1e-3 * scale**2
    assert clear.mean() > 0.99 if clear.size else True
    assert np.abs(found.position - expected.position)[clear].max(initial=0) < POSITION_PX
    tolerances = {"variance": (1e-3, 0), "amplitude": (1e-4, 1e-4), "offset": (1e-5, 1e-4)}
    tolerances |= {"residual": (1e-3, 0.02), "margin": (1e-3, 0.1)}
    for name, (relative, absolute) in tolerances.items():
        power = 2 if name in ("residual", "margin") else 1
        np.testing.assert_allclose(
            getattr(found, name)[clear],
            getattr(expected, name)[clear],
            rtol=relative,
            atol=absolute * scale**power,
            err_msg=name,
        )


SCALES = {np.uint8: 1.0, np.uint16: 256.0, np.float32: 1 / 256}


@pytest.mark.parametrize(
    ("shape", "kind", "steps"),
    [
        *(((0,), np.uint8, 2), ((1,), np.uint16, 1), ((7,), np.float32, 2), ((16,), np.uint8, 0)),
        *(((17,), np.uint16, 2), ((129,), np.float32, 0), ((33, 31), np.uint8, 1)),
        *(((2, 0), np.uint16, 0), ((2, 3, 4), np.float32, 1), ((33, 31), np.uint16, 2)),
    ],
)
def test_equals_the_reference(
    level: str, shape: tuple[int, ...], kind: type, steps: int, rng
) -> None:
    waves = wave(4, harmonic=0.02)
    frames = waves.frames(rng.uniform(0, 999, shape), kind, rng, noise=1.0)
    found = kernels.search_phase(frames, *waves.terms, steps)
    check(found, reference.search_phase(frames, *waves.terms, steps), SCALES[kind])


@pytest.mark.parametrize(
    ("extras", "harmonic"),
    [(1, 0.03), (2, 0.0), (3, 0.03), (7, 0.0), (8, 0.03), (9, 0.0), (29, 0.03)],
)
def test_any_number_of_frames(level: str, extras: int, harmonic: float, rng) -> None:
    waves = wave(extras, harmonic=harmonic)
    frames = waves.frames(rng.uniform(0, 999, 301), np.float32, rng, noise=0.3)
    found, expected = (
        search(frames, *waves.terms) for search in (kernels.search_phase, reference.search_phase)
    )
    if extras > 2:
        check(found, expected, 1 / 256)
    else:  # too few frames to separate all periods: ties, with the same choice nearly always
        assert np.mean(np.abs(found.position - expected.position) < POSITION_PX) > 0.95


def test_finds_the_place(level: str, rng) -> None:
    waves = wave(4, harmonic=0.02)
    x = rng.uniform(0, 999, (60, 70))
    fit = kernels.search_phase(waves.frames(x, np.float32, rng), *waves.terms, 4)
    assert np.abs(fit.position - x).max() < POSITION_PX
    np.testing.assert_allclose(fit.amplitude * 256, 80, rtol=1e-4)
    np.testing.assert_allclose(fit.offset * 256, 100, rtol=1e-4)
    assert (fit.residual < 1e-6 * fit.margin).all()


def test_variance_is_the_scatter(level: str, rng) -> None:
    """Over 20,000 pixels of noise 1: the deviations in units of their own sigma have variance 1."""
    waves = wave(4)
    x = rng.uniform(100, 900, 20_000)
    frames = waves.frames(x, np.float32, rng, noise=1.0)
    fit = kernels.search_phase(frames, *waves.terms)
    right = np.abs(fit.position - x) < 20
    assert right.mean() > 0.999
    pull = (fit.position - x)[right] * 256 / np.sqrt(fit.variance[right])
    assert np.var(pull) == pytest.approx(1, abs=0.04)
    assert np.mean(fit.residual[right]) * 256**2 == pytest.approx(7 - 3, rel=0.04)


def test_odd_layouts(level: str, kind: type, odd_layout: Callable, rng) -> None:
    waves = wave(4)
    frames = waves.frames(rng.uniform(0, 999, (9, 21)), kind, rng, noise=1.0)
    found = kernels.search_phase([odd_layout(f) for f in frames], *waves.terms)
    check(found, reference.search_phase(frames, *waves.terms), SCALES[kind])


def test_nan_anywhere_is_nan_everywhere(level: str, rng) -> None:
    waves = wave(4)
    frames = waves.frames(rng.uniform(0, 999, 70), np.float32, rng)
    for k, frame in enumerate(frames):
        frame[k::14] = np.nan
    fit = kernels.search_phase(frames, *waves.terms)
    for plane in fit:
        np.testing.assert_array_equal(np.isnan(plane), np.arange(70) % 14 < 7)


@pytest.mark.parametrize("value", [0, 100, 255])
def test_without_a_wave_there_is_no_place(level: str, value: int) -> None:
    fit = kernels.search_phase([np.full(19, value, np.uint8)] * 7, *wave(4).terms)
    assert np.isnan(fit.position).all()
    assert np.isnan(fit.variance).all()
    np.testing.assert_allclose(fit.offset, value, rtol=1e-6)
    assert not np.isnan([fit.amplitude, fit.residual, fit.margin]).any()


def test_one_candidate_has_no_rival(level: str, rng) -> None:
    waves = wave(2)
    x = rng.uniform(0, 40, 33)
    frames = waves.frames(x, np.float32, rng)
    fit = kernels.search_phase(frames, *waves.terms[:5], 40.0)
    assert (fit.margin == np.inf).all()
    assert np.abs(fit.position - x).max() < POSITION_PX
    alone = kernels.search_phase(frames[:3], *(v[:3] for v in waves.terms[:4]), 3, 40.0)
    assert np.abs(alone.position - x).max() < POSITION_PX


def test_threads_change_nothing(level: str, rng) -> None:
    waves = wave(4)
    frames = waves.frames(rng.uniform(0, 999, 5 * 2048 + 3), np.uint8, rng, noise=1.0)
    with kernels.forced(level, 1):
        one = kernels.search_phase(frames, *waves.terms)
    with kernels.forced(level, 2):
        two = kernels.search_phase(frames, *waves.terms)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


@given(st.integers(0, 2**31), st.floats(8, 200), st.floats(50, 4000), st.floats(0, 0.1))
def test_any_plan(seed: int, period: float, length: float, harmonic: float) -> None:
    rng = np.random.default_rng(seed)
    plan = wave(5, harmonic=harmonic, period=period)
    waves = Wave(*plan.terms[:4], 3, length)
    frames = waves.frames(rng.uniform(0, length, 40), np.uint16, rng)
    expected = reference.search_phase(frames, *waves.terms)
    for name in kernels.available():
        with kernels.forced(name):
            found = kernels.search_phase(frames, *waves.terms)
        clear = expected.margin > 1e4  # of (256 * 80)^2
        assert np.abs(found.position - expected.position)[clear].max(initial=0) < POSITION_PX


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"base": 2}, InputError, "base: 2 frames; 3 to 7"),
        ({"base": 8}, InputError, "base: 8 frames; 3 to 7"),
        ({"base": 4}, InputError, "the first 4 equal"),
        ({"periods": [-64.0] * 7}, InputError, "they must be above 0 and the first 3"),
        ({"periods": [64.0] * 6}, ShapeError, r"periods has shape \(6,\)"),
        ({"modulation": [0.0] * 7}, InputError, "modulation: .* must be above 0 in the first 3"),
        ({"harmonic": [np.inf] * 7}, InputError, "harmonic: .* not all finite"),
        ({"shifts": [0.0] * 7}, InputError, "undetermined"),
        ({"length": 0.0}, InputError, "must be above 0 px"),
        ({"steps": -1}, InputError, "steps 0 to 100"),
        ({"frames": [np.zeros(3, np.uint8)] * 33}, InputError, "frames: 33 were given; 3 to 32"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict, error: type, text: str) -> None:
    names = ("periods", "shifts", "modulation", "harmonic", "base", "length")
    given = dict(zip(names, wave(4).terms, strict=True))
    given["frames"] = [np.zeros(3, np.uint8)] * 7
    with pytest.raises(error, match=text):
        kernels.search_phase(**(given | change))
