"""Linearity of stripe pictures with and without a gamma."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tolerances import SIGMAS

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.camera.linearity import linearity_error

Array = np.ndarray
Curve = Callable[[Array], Array]


def srgb(light: Array) -> Array:
    """IEC 61966-2-1, written out again."""
    return np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def gamma18(light: Array) -> Array:
    return light ** (1 / 1.8)


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
    def test_a_gamma_is_found(self, curve: Curve, exponent: float) -> None:
        found = linearity_error(*stripes(curve))
        assert abs(found.error) > 0.2 > 100 * found.error_sigma
        assert found.exponent == pytest.approx(exponent, rel=0.05)

    def test_saturated_pixels_are_left_out(self) -> None:
        photos = stripes()
        photos[0][:, :50] = np.nan
        assert abs(linearity_error(*photos).error) < 1e-3

    def test_a_flickering_lamp_is_small_beside_a_gamma(self) -> None:
        assert abs(linearity_error(*stripes(drift=1.01)).exponent - 1) < 0.03

    def test_refusals(self) -> None:
        white, black, *_ = stripes()
        with pytest.raises(NotEnoughData, match="only 0 pixels are bright in both"):
            linearity_error(white, black, white, black)
        with pytest.raises(OutOfModelRange, match=r"no exponent from 0\.2 to 6 removes"):
            linearity_error(white, black, 1.3 * white, 1.2 * white)


def test_stripes_that_never_overlap_determine_no_exponent() -> None:
    """Where the pictures are nowhere bright together, light that adds up passes with an open exponent."""
    rng = np.random.default_rng(2)
    stripe = np.repeat(np.arange(60) % 2, 12)[None, :] * np.ones((80, 1))
    black = np.zeros_like(stripe)
    noise = [rng.normal(0, 1e-4, stripe.shape) for _ in range(2)]
    found = linearity_error(
        np.ones_like(stripe), black, stripe + noise[0] - 0.001, 1 - stripe + noise[1]
    )
    assert (found.exponent, found.exponent_sigma > 1) == (1, True)
