"""Glare, vignetting and black level from photographs of a simulated camera."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tolerances import SIGMAS

from procam.errors import InputError, NotEnoughData, OutOfModelRange, ProcamError
from procam.estimate.camera.glare_and_vignetting import (
    GLARE_VARIATION,
    black_level,
    fit_glare,
    fit_vignetting,
    linear_light,
)
from procam.estimate.camera.radiance import Radiometer
from procam.maths.geometry.lenses import Lens
from procam.model.optics import CameraModel, Sensor

Array = np.ndarray
SIZE = 161
MIDDLE = 80.0
V1, V2 = -0.12, -0.03
BLACK, SCALE = 256.0, 40000.0
LENS = Lens("kannala-brandt", np.full(2, 60.0), np.full(2, MIDDLE), np.array([0.02, -0.004, 0, 0]))
CAMERA = CameraModel("desk", (SIZE, SIZE), LENS, Sensor(16, BLACK, (V1, V2)))
RADIOMETER = Radiometer(CAMERA)
ROWS, COLUMNS = np.indices((SIZE, SIZE))
CIRCLE = np.hypot(ROWS - MIDDLE, COLUMNS - MIDDLE) <= SIZE / 2
PLACES = ((80, 80), (40, 60), (115, 70), (75, 120))
HOLE_PX, INSIDE_PX = 14, 9


def fall(v1: float = V1, v2: float = V2) -> Array:
    """By Newton's method from the pixel's radius to its angle."""
    radius = np.hypot(ROWS - MIDDLE, COLUMNS - MIDDLE) / 60
    theta = radius.copy()
    for _ in range(20):
        theta -= (theta + 0.02 * theta**3 - 0.004 * theta**5 - radius) / (
            1 + 0.06 * theta**2 - 0.02 * theta**4
        )
    return 1 + v1 * theta**2 + v2 * theta**4


def surround(place: tuple[float, float], residual: float = 0.0) -> Array:
    """Bright paper, lit from the left, with a black hole that gives off `residual`."""
    paper = 0.7 + 0.2 * np.cos(COLUMNS / 60) + 0.1 * np.sin(ROWS / 15)
    hole = np.hypot(COLUMNS - place[0], ROWS - place[1]) <= HOLE_PX
    return np.where(hole, residual, paper) * CIRCLE


def uniform_glare(light: Array, glare: float) -> Array:
    return (1 - glare) * light + glare * light[CIRCLE].mean()


def wide_glare(light: Array, glare: float) -> Array:
    """Light spread by a Gaussian as wide as a third of the picture, and so uneven."""
    return (1 - glare) * light + glare * gaussian_filter(light, 50, mode="constant", truncate=6)


def photograph(
    light: Array, *, seed: int = 0, noise: float = 8.0, darkening: Array | None = None
) -> Array:
    darkening = fall() if darkening is None else darkening
    counts = BLACK + SCALE * light * darkening
    counts += np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(np.rint(counts), 0, 65535).astype(np.uint16)


def traps(number: int) -> list[tuple[float, float, float]]:
    return [(x, y, INSIDE_PX) for x, y in PLACES[:number]]


def lights(
    glare: float,
    number: int = 1,
    add: Callable[[Array, float], Array] = uniform_glare,
    **more: float,
) -> list[Array]:
    return [
        linear_light(photograph(add(surround(place, **more), glare), seed=i), RADIOMETER)
        for i, place in enumerate(PLACES[:number])
    ]


class TestFlatLight:
    def test_counts_become_light(self) -> None:
        truth = surround(PLACES[0])
        light = linear_light(photograph(truth, noise=0), RADIOMETER)
        assert light.shape == (SIZE, SIZE, 1)
        np.testing.assert_allclose(light[CIRCLE, 0] / SCALE, truth[CIRCLE], atol=1.5 / SCALE)

    def test_saturated_is_unknown_but_not_in_merged_exposures(self) -> None:
        counts = photograph(surround(PLACES[0]))
        counts[80, 20] = 65535
        assert np.isnan(linear_light(counts, RADIOMETER)).sum() == 1
        merged = np.full((SIZE, SIZE, 3), 1e5)
        np.testing.assert_allclose(linear_light(merged, RADIOMETER)[80, 80], 1e5, rtol=1e-9)


class TestGlare:
    @pytest.mark.parametrize("glare", [0.002, 0.01, 0.04])
    def test_an_uniform_glare(self, glare: float) -> None:
        found = fit_glare(lights(glare, 3), traps(3), RADIOMETER.seen)
        assert abs(found.glare - glare) < SIGMAS * 2e-5  # counts of noise and rounding, averaged
        assert found.sigma == pytest.approx(5e-4, rel=0.05)  # the trap's own, alone
        assert len(found.each) == 3

    def test_an_ununiform_glare_is_in_the_sigma(self) -> None:
        """The truth is the average glare, as a share of the mean; no single place shows it."""
        found = fit_glare(lights(0.01, 4, wide_glare), traps(4), RADIOMETER.seen)
        shares = []
        for place in PLACES:
            light = surround(place)
            veil = wide_glare(light, 0.01) - 0.99 * light
            shares.append(veil[CIRCLE].mean() / wide_glare(light, 0.01)[CIRCLE].mean())
        assert abs(found.glare - np.mean(shares)) < 2 * found.sigma < 0.3 * found.glare
        assert np.ptp(found.each) > 1e-3

    def test_one_photograph_allows_for_an_ununiform_glare(self) -> None:
        found = fit_glare(lights(0.01), traps(1), RADIOMETER.seen)
        assert found.sigma == pytest.approx(np.hypot(GLARE_VARIATION * 0.01, 5e-4), rel=0.02)

    def test_colour(self) -> None:
        shares = (0.008, 0.01, 0.012)
        truth = np.stack([uniform_glare(surround(PLACES[0]), g) for g in shares], axis=-1)
        counts = np.rint(BLACK + SCALE * truth * fall()[..., None]).astype(np.uint16)
        found = fit_glare([linear_light(counts, RADIOMETER)], traps(1), RADIOMETER.seen)
        assert found.glare == pytest.approx(0.01, abs=1e-5)
        assert found.sigma > 0.002  # of the channels

    def test_a_grey_trap_within_its_stated_light(self) -> None:
        """A trap that reflects a thousandth, stated as such: one sigma off."""
        own = 1e-3 * surround(PLACES[0])[CIRCLE].mean()
        found = fit_glare(lights(0.01, 3, residual=own), traps(3), RADIOMETER.seen, trap_sigma=1e-3)
        assert 0.8e-3 < found.glare - 0.01 < 1.2e-3
        assert found.sigma >= 1e-3

    def test_agrees_with_the_radiometer(self) -> None:
        """With the estimated glare the radiometer gives a black hole."""
        from procam.model.frame import CameraSettings, Frame

        counts = photograph(uniform_glare(surround(PLACES[1]), 0.03), noise=0)
        light = linear_light(counts, RADIOMETER)
        glare = fit_glare([light], [traps(2)[1]], RADIOMETER.seen).glare
        camera = replace(CAMERA, sensor=replace(CAMERA.sensor, glare=glare))
        radiance = Radiometer(camera).radiance(Frame(counts, CameraSettings(1.0), 0.0, 1.0))
        hole = np.hypot(COLUMNS - PLACES[1][0], ROWS - PLACES[1][1]) <= INSIDE_PX
        assert np.abs(radiance[hole]).mean() < 2e-5 * radiance[CIRCLE].mean() + 1.0 / 65535


def _grey() -> tuple[list[Array], Sequence[object]]:
    return lights(0.01, residual=0.06), traps(1)


def _lit() -> tuple[list[Array], Sequence[object]]:
    (light,) = lights(0.01)
    return [light + 300 * (COLUMNS[..., None] > PLACES[0][0])], traps(1)


def _rim() -> tuple[list[Array], Sequence[object]]:
    return lights(0.01), [(*PLACES[0], HOLE_PX + 0.5)]


def _below_black() -> tuple[list[Array], Sequence[object]]:
    return [light - 200 for light in lights(0.001)], traps(1)


def _burnt() -> tuple[list[Array], Sequence[object]]:
    (light,) = lights(0.01)
    light[30:40, 60:80] = np.nan
    return [light], traps(1)


def _unlit() -> tuple[list[Array], Sequence[object]]:
    return [0 * lights(0.01)[0]], traps(1)


class TestGlareRefuses:
    @pytest.mark.parametrize(
        ("given", "error", "message"),
        [
            (_grey, OutOfModelRange, r"the trap has \d\.\d% of the mean light, more than 5%"),
            (_lit, OutOfModelRange, r"in a part of it, more than 25% apart"),
            (
                _rim,
                OutOfModelRange,
                r"(of the mean light, more than 5%|the circle touches its rim)",
            ),
            (_below_black, OutOfModelRange, r"darker than black by 0\.\d+% of .* --dark"),
            (
                _burnt,
                NotEnoughData,
                r"\d\.\d% of the picture is saturated, more than 0\.1%",
            ),
            (_unlit, NotEnoughData, "the mean is 0 above black"),
            (
                lambda: (lights(0.01), [(80, 80, 3)]),
                NotEnoughData,
                r"the trap has 29 pixels, 0 of them saturated; it needs 100",
            ),
            (
                lambda: (lights(0.01), [(3, 3, 9)]),
                InputError,
                "the trap is not within the image circle",
            ),
            (
                lambda: (lights(0.01), [(500, 80, 9)]),
                InputError,
                "the trap is not within the image circle",
            ),
        ],
    )
    def test_refusals(
        self,
        given: Callable[[], tuple[list[Array], list[tuple[float, float, float]]]],
        error: type[ProcamError],
        message: str,
    ) -> None:
        photos, places = given()
        with pytest.raises(error, match=message):
            fit_glare(photos, places, RADIOMETER.seen)


def flat(turns: int, *, gradient: float = 0.0, v1: float = V1, v2: float = V2) -> list[Array]:
    """Paper that is brighter on one side, photographed with the camera turned by 90 degrees."""
    plain = Radiometer(replace(CAMERA, sensor=replace(CAMERA.sensor, vignetting=())))
    paper = 0.8 * (1 + gradient * (COLUMNS - MIDDLE) / MIDDLE)
    return [
        linear_light(photograph(np.rot90(paper, k), seed=k, darkening=fall(v1, v2)), plain)
        for k in range(turns)
    ]


class TestVignetting:
    @pytest.mark.parametrize("turns", [1, 4])
    def test_even_light(self, turns: int) -> None:
        found = fit_vignetting(flat(turns), RADIOMETER.rays, RADIOMETER.seen)
        assert (np.abs(found.coefficients - [V1, V2]) < SIGMAS * found.sigma).all()
        assert found.sigma.max() < 2e-3 and found.uneven < 1e-3
        assert np.degrees(found.reach) == pytest.approx(75, abs=1)

    def test_uneven_light_averages_out_over_four_turns(self) -> None:
        found = fit_vignetting(flat(4, gradient=0.15), RADIOMETER.rays, RADIOMETER.seen)
        np.testing.assert_allclose(found.coefficients, [V1, V2], atol=1e-3)

    def test_an_ordinary_lens_whose_axis_is_off(self) -> None:
        lens = Lens("brown", np.full(2, 150.0), np.array([90.0, 70.0]), np.zeros(5))
        camera = CameraModel("b", (SIZE, SIZE), lens, Sensor(16, BLACK))
        x, y = (COLUMNS - 90) / 150, (ROWS - 70) / 150
        theta = np.arctan(np.hypot(x, y))
        radiometer = Radiometer(camera)
        counts = photograph(np.full((SIZE, SIZE), 0.8), darkening=1 - 0.6 * theta**2)
        found = fit_vignetting([linear_light(counts, radiometer)], radiometer.rays, radiometer.seen)
        assert (np.abs(found.coefficients - [-0.6, 0.0]) < SIGMAS * found.sigma).all()

    @pytest.mark.parametrize(
        ("photos", "error", "message"),
        [
            (
                lambda: flat(1, gradient=0.15),
                OutOfModelRange,
                r"varies by \d\.\d% round the axis.*90",
            ),
            (
                lambda: [light * (fall(0.1, 0) > 1.07)[..., None] + light for light in flat(1)],
                OutOfModelRange,
                r"the light is \d+\.\d% off 1 \+ v1 theta\^2 \+ v2 theta\^4, more than 2%",
            ),
            (
                lambda: flat(1, v1=0.1, v2=0),
                OutOfModelRange,
                r"the rim is at 11\d\.\d% of the centre",
            ),
            (
                lambda: [light * np.nan for light in flat(1)],
                NotEnoughData,
                r"100\.0% of it is saturated",
            ),
            (
                lambda: [-light for light in flat(1)],
                NotEnoughData,
                "the light near the lens's axis is",
            ),
        ],
    )
    def test_refusals(
        self, photos: Callable[[], list[Array]], error: type[ProcamError], message: str
    ) -> None:
        with pytest.raises(error, match=message):
            fit_vignetting(photos(), RADIOMETER.rays, RADIOMETER.seen)

    def test_too_little_of_the_picture(self) -> None:
        seen = np.hypot(ROWS - MIDDLE, COLUMNS - MIDDLE) < 3
        with pytest.raises(
            NotEnoughData, match=r"only \d places in the picture have enough pixels"
        ):
            fit_vignetting(flat(1), RADIOMETER.rays, seen)


class TestBlackLevel:
    def test_noise_and_hot_pixels(self) -> None:
        rng = np.random.default_rng(1)
        dark = np.rint(rng.normal(256.3, 6, (400, 600))).astype(np.uint16)
        dark[rng.random(dark.shape) < 1e-3] = 9000
        level, sigma = black_level(dark, 14)
        assert abs(level - 256.3) < SIGMAS * sigma < 0.5

    def test_warm_corners_are_in_the_sigma(self) -> None:
        rows, columns = np.indices((200, 300))
        dark = (
            100
            + 4 * (rows / 200) * (columns / 300)
            + np.random.default_rng(2).normal(0, 2, rows.shape)
        )
        level, sigma = black_level(np.rint(dark).astype(np.uint16), 12)
        assert abs(level - 101) < 0.1 and 0.7 < sigma < 1.1

    @pytest.mark.parametrize(
        ("dark", "error", "message"),
        [
            (
                np.full((100, 100), 2000),
                OutOfModelRange,
                "dark: the photograph has up to 2000 counts",
            ),
            (
                np.where(np.arange(10000).reshape(100, 100) % 50 < 3, 900, 64),
                OutOfModelRange,
                r"6\.0% of its pixels differ",
            ),
            (np.full((10, 10), 64), NotEnoughData, "dark: 100 pixels are too few"),
        ],
    )
    def test_refusals(self, dark: Array, error: type[ProcamError], message: str) -> None:
        with pytest.raises(error, match=message):
            black_level(dark, 12)
