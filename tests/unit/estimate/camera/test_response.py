"""Responses of simulated cameras, and photographs with every common mistake."""

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
TINY = scene(60, 90)  # for tests that solve several times


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
        bright = (found.levels > 0.2) & (found.levels < 1)  # the error of others is below 1e-3
        assert (np.abs(error) < SIGMAS * found.sigma)[bright].all()
        assert np.abs(error[~bright]).max() < 1e-3

    def test_colour_and_order_make_no_difference(self) -> None:
        tints = np.array([1.0, 0.7, 0.4])
        photos = [shoot(SMALL[..., None] * tints, e, film) for e in TWO_STOPS]
        there = solve_response(photos, TWO_STOPS, 8)
        back = solve_response(photos[::-1], TWO_STOPS[::-1], 8)
        # a sample at the edge of saturation may count in one and not in the other
        assert (np.abs(there.light - back.light) < 0.3 * there.sigma + 1e-5).all()
        assert np.sqrt(np.mean((there.light - truth(film, there.levels)) ** 2)) < GOAL

    def test_rounded_shutter_times_are_in_the_sigma(self) -> None:
        """A camera whose headers have the usual names of 1/8 ... 1/64 s."""
        true = 8 / np.array([64.0, 32, 16, 8, 4])
        nominal = 8 / np.array([60.0, 30, 15, 8, 4])
        found = solve_response(bracket(seconds=true), nominal, 8)
        error = found.light - truth(srgb, found.levels)
        assert (np.abs(error) <= SIGMAS * found.sigma)[50:].all()

    @pytest.mark.parametrize("edge", [30, 100])
    def test_a_moving_object_does_little_and_is_found(self, edge: int) -> None:
        photos = bracket(LIGHT, STOPS)
        place = slice(20, 20 + edge), slice(30, 30 + edge)
        photos[4][place] = shoot(LIGHT[100 : 100 + edge, 200 : 200 + edge], STOPS[4])
        found = solve_response(photos, STOPS, 8)
        assert np.sqrt(np.mean((found.light - truth(srgb, found.levels)) ** 2)) < GOAL
        assert found.left_out is None
        there = np.zeros_like(found.moved)
        there[10 : 10 + edge // 2, 15 : 15 + edge // 2] = True
        assert found.moved[there].mean() > 0.5 and found.moved[~there].mean() < 0.002

    def test_a_photograph_that_fits_no_other_is_left_out(self) -> None:
        photos = [*bracket(TINY, STOPS)[:5], shoot(1.4 * TINY, STOPS[5])]
        photos += bracket(TINY, STOPS)[6:]
        found = solve_response(photos, STOPS, 8)
        number, why = found.left_out or (None, "")
        assert number == 5 and "photograph" in why
        assert len(found.exposures_s) == 7
        error = found.light - truth(srgb, found.levels)
        assert (np.abs(error) <= SIGMAS * found.sigma).all()

    def test_channels_that_differ_have_curves_of_their_own(self) -> None:
        curves = (srgb, film, srgb)
        photos = [np.stack([shoot(TINY, e, curve) for curve in curves], axis=-1) for e in STOPS[1:]]
        found = solve_response(photos, STOPS[1:], 8)
        assert found.light.shape == found.sigma.shape == (256, 3)
        error = found.light - np.stack([truth(c, found.levels) for c in curves], axis=1)
        assert (np.abs(error) <= SIGMAS * found.sigma)[13:].all()

    def test_a_refused_curve_is_given_if_the_refusal_is_overruled(self) -> None:
        photos = bracket()
        photos[2] = shoot(1.3 * SMALL, TWO_STOPS[2])
        found = solve_response(photos, TWO_STOPS, 8, accept=True)
        assert "its light is that of" in found.overruled
        assert found.left_out is None and (np.diff(found.light) > 0).all()


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
    return [*bracket(LIGHT)[:2], *(shoot(LIGHT, e, film) for e in TWO_STOPS[2:])]


class TestRefuses:
    @pytest.mark.parametrize(
        ("photos", "seconds", "error", "message"),
        [
            (bracket, TWO_STOPS[:2], NotEnoughData, "2 exposures are too few"),
            (bracket, [1, 2, -4, 8], InputError, "must be finite and above zero"),
            (
                bracket,
                [1, 1.05, 2, 4],
                NotEnoughData,
                r"1 and 1\.05 s are too similar; neighbours need a ratio of 1\.2",
            ),
            (bracket, [1, 2, 4], InputError, "4 photographs and 3 exposures do not match"),
            (
                _exchanged,
                TWO_STOPS,
                OutOfModelRange,
                r"photographs 2 and 3 \(0\.25 and 1 s\): the levels change by a factor of 0\..*"
                "not exchanged, and that neither exposure nor ISO was automatic",
            ),
            (_automatic, TWO_STOPS, OutOfModelRange, r"change by a factor of 1\.000;"),
            (_walk, TWO_STOPS, OutOfModelRange, "in which nothing moves"),
            (
                _brighter,
                TWO_STOPS,
                OutOfModelRange,
                r"photograph 3 \(1 s\): its light is that of 1\.\d+ s, more than 10% off",
            ),
            (
                lambda: [np.minimum(photo, 240) for photo in bracket()],
                TWO_STOPS,
                NotEnoughData,
                r"the brightest of the photographs reaches 94% of the range; white is needed",
            ),
            (_profile, TWO_STOPS, OutOfModelRange, "off the common curve.* one picture profile"),
            (
                lambda: bracket(seconds=TWO_STOPS[:3] / 4),
                TWO_STOPS[:3] / 4,
                NotEnoughData,
                r"reaches \d+% of the range; white is needed. Take a longer exposure",
            ),
            (
                lambda: bracket(np.full((60, 60), 0.5), [0.01, 1, 100]),
                [0.01, 1, 100],
                NotEnoughData,
                r"photographs 2 and 3 \(1 and 100 s\): only 0 places are neither black nor white",
            ),
            (
                lambda: [*bracket()[:3], bracket(LIGHT)[3]],
                TWO_STOPS,
                ShapeError,
                r"photograph 4.*\(200, 300\).*\(120, 180\) like the first",
            ),
        ],
    )
    def test_photographs_without_a_common_curve(
        self,
        photos: Callable[[], list[Array]],
        seconds: Sequence[float],
        error: type[ProcamError],
        message: str,
    ) -> None:
        with pytest.raises(error, match=message):
            solve_response(photos(), seconds, 8)

    def test_pictures_of_no_shape(self) -> None:
        with pytest.raises(ShapeError, match=r"photograph 1.*\(9,\).*\(H, W\) or"):
            solve_response([np.zeros(9)] * 4, TWO_STOPS, 8)

    def test_pictures_of_one_shade(self) -> None:
        photos = [np.full((60, 60), level, np.uint8) for level in (20, 40, 80, 160, 252)]
        with pytest.raises(NotEnoughData, match="only 0 places have levels of 10% to 15%"):
            solve_response(photos, [1, 2, 4, 8, 16], 8)

    @pytest.mark.parametrize("bits", [7, 32])
    def test_depths_of_no_camera(self, bits: int) -> None:
        with pytest.raises(InputError, match=f"bits: {bits} is no depth"):
            solve_response(bracket(), TWO_STOPS, bits)

    def test_a_fit_that_does_not_settle(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(response_fit, "ROUNDS", 15)
        monkeypatch.setattr(response_fit, "NEGLIGIBLE_STEP", 0.0)
        with pytest.raises(DidNotConverge, match="the fit did not settle"):
            solve_response(bracket(), TWO_STOPS, 8)
