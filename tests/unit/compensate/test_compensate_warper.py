"""Warper: whole numbers against exact drives; the drives themselves are tested beside it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from procam.compensate.projector_frames import Warper, projector_frames
from procam.errors import InputError, ShapeError
from procam.maths.light.curves import srgb_decode
from procam.model.calibration import Calibration

N = 96
CLOSE = 0.25  # of an 8-bit code


@pytest.fixture(scope="module")
def tile() -> np.ndarray:
    return np.random.default_rng(1).uniform(0, 1, (64, 64)).astype(np.float32)


@pytest.fixture(scope="module")
def codes() -> np.ndarray:
    """A master of 8 bits: slopes, an edge, noise."""
    row, column = np.mgrid[:N, :N]
    planes = [2 * row, np.where(column < 50, 250, 20), row + column]
    noise = np.random.default_rng(2).integers(0, 9, (N, N, 3))
    return (np.stack(planes, axis=-1) + noise).astype(np.uint8)


@pytest.fixture(scope="module", params=["plain", "exponent"])
def venue(request, make_calibration: Callable[..., Calibration]) -> Calibration:
    """A calibration; one projector may have a response that differs by place."""
    calibration = make_calibration()
    if request.param == "plain":
        return calibration
    south = calibration.projectors["south"]
    exponent = np.random.default_rng(3).uniform(0.9, 1.1, south.photometry.gain.shape)
    light = replace(south.photometry, exponent=exponent.astype(np.float32))
    return replace(calibration, projectors={"south": replace(south, photometry=light)})


def _exact(codes: np.ndarray, venue: Calibration) -> dict[str, np.ndarray]:
    return projector_frames(srgb_decode(codes / 255).astype(np.float32), venue)


def test_16_bits_are_the_exact_drives_rounded(venue: Calibration, codes: np.ndarray) -> None:
    found = Warper(venue, N, np.uint16).frame(codes)
    exact = _exact(codes, venue)
    assert found.keys() == exact.keys() == venue.projectors.keys()
    for name, frame in found.items():
        assert frame.dtype == np.uint16
        np.testing.assert_allclose(frame / 257, 255 * exact[name], atol=CLOSE)


def test_8_bits_are_the_exact_drives_dithered(
    venue: Calibration, codes: np.ndarray, tile: np.ndarray
) -> None:
    found = Warper(venue, N, thresholds=tile).frame(codes)
    for name, exact in _exact(codes, venue).items():
        height, width = exact.shape[:2]
        value = 255 * exact + tile[:height, :width, None]
        assert found[name].dtype == np.uint8
        assert (np.floor(value - CLOSE) <= found[name]).all()
        assert (found[name] <= np.floor(value + CLOSE)).all()


@pytest.mark.parametrize("kind", [np.uint16, np.float16])
def test_other_masters_are_linear(calibration: Calibration, codes: np.ndarray, kind: type) -> None:
    light = srgb_decode(codes / 255)
    master = np.rint(65535 * light).astype(kind) if kind == np.uint16 else light.astype(kind)
    found = Warper(calibration, N, np.uint16).frame(master)
    for name, exact in _exact(codes, calibration).items():
        np.testing.assert_allclose(found[name] / 257, 255 * exact, atol=CLOSE)


def test_the_transfer_function_can_be_another(calibration: Calibration, codes: np.ndarray) -> None:
    found = Warper(calibration, N, np.float32, decode=lambda v: v**2.6).frame(codes)
    exact = projector_frames(((codes / 255) ** 2.6).astype(np.float32), calibration)
    for name, drive in exact.items():
        np.testing.assert_allclose(255 * found[name], 255 * drive, atol=CLOSE)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_frames_are_written_where_asked(venue: Calibration, codes: np.ndarray, dtype) -> None:
    warper = Warper(venue, N, dtype)
    made = warper.frame(codes)
    out = {name: np.full_like(frame, 9) for name, frame in made.items()}
    found = warper.frame(codes, out)
    for name, frame in made.items():
        assert found[name] is out[name]
        np.testing.assert_array_equal(out[name], frame)


def test_a_flat_start_of_the_response_is_dark(calibration: Calibration) -> None:
    """No light is no drive, though drives up to a quarter would give none either."""
    south = calibration.projectors["south"]
    response = south.photometry.response
    values = np.maximum(response.values, response.values[len(response.levels) // 4])
    values = (values - values[0]) / (1 - values[0])
    light = replace(south.photometry, response=replace(response, values=values))
    flat = replace(calibration, projectors={"south": replace(south, photometry=light)})
    for dtype in (np.uint8, np.uint16, np.float32):
        assert not Warper(flat, N, dtype).frame(np.zeros((N, N, 3), np.uint8))["south"].any()


def test_a_pixel_that_is_all_but_dead_leaves_its_neighbours(calibration: Calibration) -> None:
    south = calibration.projectors["south"]
    gain = south.photometry.gain.copy()
    gain[10, ::5] = 1e-8
    light = replace(south.photometry, gain=gain)
    weak = replace(calibration, projectors={"south": replace(south, photometry=light)})
    sound = replace(calibration, projectors={"south": south})
    master = np.full((N, N, 3), 120, np.uint8)
    found, expected = (
        np.delete(Warper(c, N, np.uint16).frame(master)["south"][10], np.s_[::5], axis=0)
        for c in (weak, sound)
    )
    np.testing.assert_allclose(found / 257, expected / 257, atol=CLOSE)


def test_what_does_not_fit_is_refused(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="frames: float64 is not supported; choose uint8"):
        Warper(calibration, N, float)
    with pytest.raises(InputError, match="size: 1 px is too small"):
        Warper(calibration, 1)
    with pytest.raises(ShapeError, match=r"picture has shape \(95, 96, 3\)"):
        Warper(calibration, N).frame(np.zeros((N - 1, N, 3), np.uint8))
