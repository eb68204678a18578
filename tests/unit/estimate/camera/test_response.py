"""Responses of cameras that are built here, and photographs with every common mistake."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tolerances import SIGMAS

from procam.errors import (
    DidNotConverge,
    InputError,
    NotEnoughData,
    OutOfModelRange,
    ProcamError,
    ShapeError,
)
from procam.estimate.camera import response_fit
from procam.estimate.camera.linearity import linearity_error
from procam.estimate.camera.response import solve_response

Array = np.ndarray
Curve = Callable[[Array], Array]
STOPS = 2.0 ** np.arange(-4, 4)
TWO_STOPS = 4.0 ** np.arange(-2, 2)
GOAL = 0.003  # rms of the light, a share of white
FINE = np.linspace(0, 1, 40001)


def srgb(light: Array) -> Array:
    """IEC 61966-2-1, written out again."""
    return np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gamma18(light: Array) -> Array:
    return light ** (1 / 1.8)


def film(light: Array) -> Array:
    """An S: gamma 2.2, then a contrast curve that rolls off at both ends."""
    even = light ** (1 / 2.2)
    return 0.35 * even + 0.65 * even**2 * (3 - 2 * even)


def truth(curve: Curve, levels: Array) -> Array:
    return np.interp(levels, curve(FINE), FINE)


def scene(height: int = 200, width: int = 300) -> Array:
    """Smooth shades over three decades, with a little texture."""
    rng = np.random.default_rng(3)
    shade = gaussian_filter(rng.normal(size=(height, width)), 12)
    shade = (shade - shade.min()) / np.ptp(shade)
    texture = 0.02 * gaussian_filter(rng.normal(size=(height, width)), 1.0)
    return 1.3 * np.exp(np.log(1e-3) * (1 - shade) + texture)


LIGHT = scene()
SMALL = scene(120, 180)


def shoot(light: Array, exposure_s: float, curve: Curve = srgb, bits: int = 8) -> Array:
    """Shot noise of 200 to 1 at white, read noise, saturation, then the curve and rounding."""
    rng = np.random.default_rng(int(1000 * exposure_s) + bits)
    exposed = light * exposure_s
    noise = np.sqrt(0.005**2 * exposed + 0.0005**2)
    exposed = np.clip(exposed + noise * rng.normal(size=light.shape), 0, 1)
    return np.rint(curve(exposed) * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)


def bracket(
    light: Array = SMALL, seconds: Sequence[float] = TWO_STOPS, curve: Curve = srgb
) -> list[Array]:
    return [shoot(light, exposure, curve) for exposure in seconds]


class TestFinds:
    @pytest.mark.parametrize(
        ("curve", "bits"), [(srgb, 8), (gamma18, 8), (film, 8), (film, 12), (np.copy, 16)]
    )
    def test_curves(self, curve: Curve, bits: int) -> None:
        photos = (shoot(LIGHT, exposure, curve, bits) for exposure in STOPS)
        found = solve_response(photos, STOPS, bits)
        assert (np.diff(found.levels) > 0).all() and (np.diff(found.light) > 0).all()
        np.testing.assert_array_equal([found.light[0], found.light[-1]], [0, 1])
        error = found.light - truth(curve, found.levels)
        assert np.sqrt(np.mean(error**2)) < GOAL
        told = (found.levels > 0.2) & (found.levels < 1)  # darker ones err by a ten-thousandth
        assert (np.abs(error) < SIGMAS * found.sigma)[told].all()
        assert np.abs(error[~told]).max() < 1e-3

    def test_colour_and_order_make_no_difference(self) -> None:
        tints = np.array([1.0, 0.7, 0.4])
        photos = [shoot(SMALL[..., None] * tints, e, film) for e in TWO_STOPS]
        there = solve_response(photos, TWO_STOPS, 8)
        back = solve_response(photos[::-1], TWO_STOPS[::-1], 8)
        # a sample at the edge of saturation may count in one and not in the other
        np.testing.assert_allclose(there.light, back.light, atol=GOAL / 10)
        assert np.sqrt(np.mean((there.light - truth(film, there.levels)) ** 2)) < GOAL

    def test_rounded_shutter_times_are_in_the_sigma(self) -> None:
        """A camera that calls 1/8 ... 1/64 s by their usual names."""
        true = 8 / np.array([64.0, 32, 16, 8, 4])
        told = 8 / np.array([60.0, 30, 15, 8, 4])
        found = solve_response(bracket(seconds=true), told, 8)
        error = found.light - truth(srgb, found.levels)
        assert (np.abs(error) < SIGMAS * found.sigma)[50:].all()

    def test_somebody_in_a_corner_does_little(self) -> None:
        photos = bracket(LIGHT, STOPS)
        photos[4][20:50, 30:60] = shoot(LIGHT[100:130, 200:230], STOPS[4])
        found = solve_response(photos, STOPS, 8)
        assert np.sqrt(np.mean((found.light - truth(srgb, found.levels)) ** 2)) < GOAL


def _exchanged() -> list[Array]:
    photos = bracket()
    return [photos[0], photos[2], photos[1], photos[3]]


def _automatic() -> list[Array]:
    return [shoot(SMALL, 1.0)] * 4


def _one(photo: Array) -> list[Array]:
    photos = bracket()
    return [*photos[:2], photo, photos[3]]


def _walk() -> list[Array]:
    return _one(shoot(np.roll(SMALL, 3, axis=1), TWO_STOPS[2]))


def _brighter() -> list[Array]:
    return _one(shoot(1.3 * SMALL, TWO_STOPS[2]))


def _profile() -> list[Array]:
    photos = bracket(LIGHT, STOPS)
    return [*photos[:4], *(shoot(LIGHT, e, film) for e in STOPS[4:])]


def _crossed_by_somebody() -> list[Array]:
    light = LIGHT.copy()
    light[40:140, 60:160] = LIGHT[100:200, 200:300]
    photos = bracket(LIGHT, STOPS)
    return [*photos[:4], shoot(light, STOPS[4]), *photos[5:]]


class TestRefuses:
    @pytest.mark.parametrize(
        ("photos", "seconds", "error", "told"),
        [
            (bracket, TWO_STOPS[:2], NotEnoughData, "got 2 exposures, expected 3 or more"),
            (bracket, [1, 2, -4, 8], InputError, "expected finite ones above zero"),
            (
                bracket,
                [1, 1.05, 2, 4],
                NotEnoughData,
                r"got exposures of 1 and 1.05 s, a ratio of 1.050, expected 1.2 or more",
            ),
            (bracket, [1, 2, 4], InputError, "got 4 photographs and 3 exposures; give one each"),
            (
                _exchanged,
                TWO_STOPS,
                OutOfModelRange,
                r"photographs 2 and 3 \(0.25 and 1 s\): got levels that change by a factor of 0\..*"
                "are they exchanged, or was exposure or ISO automatic",
            ),
            (_automatic, TWO_STOPS, OutOfModelRange, r"change by a factor of 1\.000, expected"),
            (_walk, TWO_STOPS, OutOfModelRange, "nothing that moves"),
            (
                _brighter,
                TWO_STOPS,
                OutOfModelRange,
                r"photograph 3 \(1 s\): got the light of 1\.\d+ s, expected its own within 10%",
            ),
            (
                _crossed_by_somebody,
                STOPS,
                OutOfModelRange,
                r"got 1\d% of the places that no curve fits, expected 10% at most; use a tripod",
            ),
            (_profile, STOPS, OutOfModelRange, "one picture profile"),
            (
                lambda: bracket(seconds=TWO_STOPS[:3] / 4),
                TWO_STOPS[:3] / 4,
                NotEnoughData,
                r"got \d places at levels \d+% to \d+% of the range",
            ),
            (
                lambda: bracket(np.full((60, 60), 0.5), [0.01, 1, 100]),
                [0.01, 1, 100],
                NotEnoughData,
                r"photographs 2 and 3 \(1 and 100 s\): got 0 places that are neither black nor white",
            ),
            (
                lambda: [*bracket()[:3], bracket(LIGHT)[3]],
                TWO_STOPS,
                ShapeError,
                r"photograph 4: got shape \(200, 300\), expected \(120, 180\) like the first",
            ),
        ],
    )
    def test_what_tells_no_curve(
        self,
        photos: Callable[[], list[Array]],
        seconds: Sequence[float],
        error: type[ProcamError],
        told: str,
    ) -> None:
        with pytest.raises(error, match=told):
            solve_response(photos(), seconds, 8)

    def test_pictures_of_no_shape(self) -> None:
        with pytest.raises(
            ShapeError, match=r"photograph 1: got shape \(9,\), expected \(H, W\) or"
        ):
            solve_response([np.zeros(9)] * 4, TWO_STOPS, 8)

    def test_pictures_of_one_shade(self) -> None:
        photos = [np.full((60, 60), 20 * step, np.uint8) for step in (1, 2, 4, 8)]
        with pytest.raises(NotEnoughData, match=r"got 0 places at levels 10% to 15% of the range"):
            solve_response(photos, [1, 2, 4, 8], 8)

    @pytest.mark.parametrize("bits", [7, 32])
    def test_depths_of_no_camera(self, bits: int) -> None:
        with pytest.raises(InputError, match=f"bits: got {bits}, expected 8 to 16"):
            solve_response(bracket(), TWO_STOPS, bits)

    def test_a_fit_without_end(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(response_fit, "ROUNDS", 15)
        monkeypatch.setattr(response_fit, "SMALL_STEP", 0.0)
        with pytest.raises(DidNotConverge, match="no end of the fit within 15 steps"):
            solve_response(bracket(), TWO_STOPS, 8)


def stripes(curve: Curve = np.copy, drift: float = 1.0) -> list[Array]:
    """White, black, stripes and their inverse on a screen that scatters a third of its light."""
    rng = np.random.default_rng(5)
    shape = (150, 200)
    rows, columns = np.indices(shape)
    screen = (0.7 + 0.1 * np.sin(rows / 30)) * (1 - 0.3 * ((columns - 100) / 100) ** 2)
    pattern = gaussian_filter((columns // 8 % 2).astype(float), 1.2)
    photos = []
    for drive, factor in ((1.0, drift), (0.0, 1.0), (pattern, 1.0), (1 - pattern, 1.0)):
        light = screen * (drive + 0.3 * np.mean(drive) + 0.02) * factor / 1.2
        noisy = light + 0.004 * np.sqrt(light) * rng.normal(size=shape)
        photos.append(curve(np.maximum(noisy, 0)) * 4000)
    return photos


class TestLinearity:
    def test_linear_light_passes(self) -> None:
        found = linearity_error(*stripes())
        assert abs(found.error) < SIGMAS * found.error_sigma < 1e-3
        assert abs(found.exponent - 1) < SIGMAS * found.exponent_sigma < 1e-3

    @pytest.mark.parametrize(
        ("curve", "exponent"),
        [(srgb, 2.2), (lambda x: x ** (1 / 2.2), 2.2), (gamma18, 1.8), (np.square, 0.5)],
    )
    def test_a_gamma_is_told(self, curve: Curve, exponent: float) -> None:
        found = linearity_error(*stripes(curve))
        assert abs(found.error) > 0.2 > 100 * found.error_sigma
        assert found.exponent == pytest.approx(exponent, rel=0.05)

    def test_a_pure_gamma_within_its_error(self) -> None:
        found = linearity_error(*stripes(gamma18))
        assert abs(found.exponent - 1.8) < SIGMAS * found.exponent_sigma < 2e-3

    def test_saturated_pixels_are_left_out(self) -> None:
        photos = stripes()
        photos[0][:, :50] = np.nan
        assert abs(linearity_error(*photos).error) < 1e-3

    def test_a_flickering_lamp_is_small_beside_a_gamma(self) -> None:
        assert abs(linearity_error(*stripes(drift=1.01)).exponent - 1) < 0.03

    def test_refusals(self) -> None:
        white, black, pattern, inverse = stripes()
        with pytest.raises(
            ShapeError, match=r"pattern: got shape \(149, 200\), expected \(150, 20"
        ):
            linearity_error(white, black, pattern[1:], inverse)
        with pytest.raises(
            NotEnoughData, match="got 0 pixels where both pattern and inverse shine"
        ):
            linearity_error(white, black, white, black)
        with pytest.raises(OutOfModelRange, match=r"which no exponent from 0\.2 to 6 mends"):
            linearity_error(white, black, 1.3 * white, 1.2 * white)


def test_stripes_that_never_overlap_tell_no_exponent() -> None:
    """Light that adds up, and nowhere two pictures at once: no curve can be told, and none is blamed."""
    rng = np.random.default_rng(2)
    stripe = np.repeat(np.arange(60) % 2, 12)[None, :] * np.ones((80, 1))
    black = np.zeros_like(stripe)
    noise = [rng.normal(0, 1e-4, stripe.shape) for _ in range(2)]
    found = linearity_error(
        np.ones_like(stripe), black, stripe + noise[0] - 0.001, 1 - stripe + noise[1]
    )
    assert (found.exponent, found.exponent_sigma > 1) == (1, True)
