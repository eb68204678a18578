"""Colour mixing and response curves from synthetic light."""

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.light.projector_response import (
    TILE_MARGIN_PX,
    ProjectorResponseFit,
    fit_colour,
    tile_levels,
)
from procam.estimate.structured_light.patterns import LEVELS, level_pictures, level_tile
from procam.maths.warp import blur

MIX = np.array([[0.93, 0.06, 0.01], [0.05, 0.9, 0.05], [0.01, 0.04, 0.95]])
SHAPE, TILE = (180, 240), 6


@pytest.fixture
def direct(rng: np.random.Generator) -> np.ndarray:
    """White's direct light, uneven and not neutral."""
    return (rng.uniform(2, 4, (*SHAPE, 1)) * [0.9, 1.0, 0.7]).astype(np.float32)


class TestColour:
    def test_recovers_the_mixing(self, direct: np.ndarray) -> None:
        fit = fit_colour([direct * MIX[:, c].astype(np.float32) for c in range(3)], direct)
        np.testing.assert_allclose(fit.mix, MIX, rtol=FLOAT32)
        assert fit.additivity_error < FLOAT32

    def test_white_boost_shows(self, direct: np.ndarray) -> None:
        fit = fit_colour([direct * MIX[:, c].astype(np.float32) for c in range(3)], 1.25 * direct)
        assert fit.additivity_error == pytest.approx(0.2, rel=1e-4)
        np.testing.assert_allclose(fit.mix.sum(axis=1), 1, rtol=1e-12)

    def test_dim_and_unknown_pixels_do_not_count(self, direct: np.ndarray) -> None:
        primaries = [direct * MIX[:, c].astype(np.float32) for c in range(3)]
        direct[0, :20] = 0.01
        primaries[0][0, :20] = 5.0
        primaries[1][3, 3, 2] = np.nan
        np.testing.assert_allclose(fit_colour(primaries, direct).mix, MIX, rtol=1e-4)


class TestTiles:
    size = (1280, 640)
    tile = level_tile(size)
    picture = np.repeat(level_pictures(size)[0] / np.float32(255), 3, axis=-1)

    def _at(self, x: float, y: float, lit: bool = True) -> int:
        xy = np.array([[[x, y]]], np.float32)
        return int(tile_levels(self.picture, xy, np.array([[lit]]))[0, 0])

    def test_names_the_level_under_the_middle_of_a_tile(self) -> None:
        for row in range(5):
            for column in range(10):
                level = self._at(self.tile * (column + 0.5), self.tile * (row + 0.5))
                drive = self.picture[self.tile * row, self.tile * column, 0]
                assert LEVELS[level] == round(255 * float(drive))

    def test_keeps_clear_of_tile_edges(self) -> None:
        step = np.linspace(-self.tile / 2, self.tile / 2, 2 * self.tile + 1)
        middle = self.tile / 2
        known = [d for d in step if self._at(self.tile - 0.5 + d, middle) >= 0]
        assert min(abs(d) for d in known) > TILE_MARGIN_PX
        assert min(abs(d) for d in known) <= TILE_MARGIN_PX + 0.5

    def test_levels_are_pure_where_defocus_mixes_neighbours(self) -> None:
        """A blur of 1.5 projector pixels changes no level that is used by 0.1 % of white."""
        width, height = self.size
        xy = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)
        level = tile_levels(self.picture, xy, np.ones((height, width), bool))
        seen = blur(self.picture[..., 0] ** 2.2, 1.5)
        expected = (np.array(LEVELS)[level] / 255) ** 2.2
        away = np.abs(seen - expected)[level >= 0]
        assert away.max() < 1e-3
        assert (level >= 0).mean() > 0.4

    def test_nothing_where_nothing_is_lit_or_known(self) -> None:
        assert self._at(16, 16) >= 0
        assert self._at(16, 16, lit=False) == -1
        assert self._at(np.nan, np.nan) == -1


def _light(direct: np.ndarray, curve: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Direct light of a level picture: each primary by `curve` (levels, 3), mixed."""
    return (direct * (curve[level] @ MIX.T)).astype(np.float32)


@pytest.fixture
def level(rng: np.random.Generator) -> np.ndarray:
    """Levels (H, W) of tiles with unknown edges."""
    rows, columns = SHAPE[0] // TILE, SHAPE[1] // TILE
    tiles = rng.permutation(np.resize(np.arange(len(LEVELS)), rows * columns))
    inside = np.arange(TILE) > 0
    known = np.kron(np.ones((rows, columns)), np.outer(inside, inside)) > 0
    levels = np.kron(tiles.reshape(rows, columns), np.ones((TILE, TILE), int))
    return np.where(known, levels, -1)


class TestResponse:
    drive = np.array(LEVELS)[:, None] / 255
    curve = drive ** np.array([2.2, 2.3, 2.0])

    def test_recovers_a_known_curve(self, direct: np.ndarray, level: np.ndarray) -> None:
        fit = ProjectorResponseFit(direct, MIX)
        fit.add(_light(direct, self.curve, level), level)
        found = fit.curve()
        expected = found.levels[:, None] ** np.array([2.2, 2.3, 2.0])
        np.testing.assert_allclose(found.values, expected, atol=0.001)
        at = np.rint(np.array(LEVELS) / 255 * 256).astype(int)[[0, -1]]
        np.testing.assert_allclose(found.values[at], [[0] * 3, [1] * 3], atol=1e-9)
        assert (np.diff(found.values, axis=0) >= 0).all()

    @pytest.mark.parametrize("shared", [False, True])
    def test_sigma_is_that_of_the_mean(
        self, rng: np.random.Generator, direct: np.ndarray, level: np.ndarray, shared: bool
    ) -> None:
        """Errors of pixels, or of tiles, in a level and in black and white, which it is compared with."""
        noise = rng.normal(0, 0.02, (*SHAPE, 3))
        if shared:
            noise = np.kron(noise[::TILE, ::TILE], np.ones((TILE, TILE, 1)))
        fit = ProjectorResponseFit(direct, np.eye(3))
        fit.add((direct * (self.curve[level] + noise)).astype(np.float32), level)
        tiles = SHAPE[0] * SHAPE[1] / TILE**2 / len(LEVELS)
        of_level = 0.02 / np.sqrt(tiles * (1 if shared else (TILE - 1) ** 2))
        expected = of_level * np.sqrt(1 + self.curve**2 + (1 - self.curve) ** 2)
        found = fit.curve()
        at = np.rint(np.array(LEVELS) / 255 * 256).astype(int)
        # a standard deviation of `tiles` samples is known to 1 / sqrt(2 tiles)
        ratio = found.sigma[at][1:-1] / expected[1:-1]
        np.testing.assert_allclose(ratio, 1, rtol=4 / np.sqrt(2 * tiles))
        np.testing.assert_allclose(ratio.mean(), 1, rtol=0.1)
        np.testing.assert_array_equal(found.sigma[[0, -1]], 0)

    def test_unknown_and_unlit_pixels_do_not_count(
        self, direct: np.ndarray, level: np.ndarray
    ) -> None:
        light = _light(direct, self.curve, level)
        light[0, 0, 1] = np.nan
        direct[1, 1] = 0.0
        direct[2, 2, 0] = np.nan
        fit = ProjectorResponseFit(direct, MIX)
        fit.add(light, level)
        expected = fit.curve().levels[:, None] ** np.array([2.2, 2.3, 2.0])
        np.testing.assert_allclose(fit.curve().values, expected, atol=0.001)

    def test_too_few_samples(self, direct: np.ndarray, level: np.ndarray) -> None:
        fit = ProjectorResponseFit(direct, MIX)
        level[level == 5] = -1
        fit.add(_light(direct, self.curve, level), level)
        with pytest.raises(NotEnoughData, match="the rarest of 17 levels has 0 samples in 0 tiles"):
            fit.curve()

    def test_a_fall_within_the_error_of_scattered_light_is_no_fall(
        self, direct: np.ndarray, level: np.ndarray
    ) -> None:
        bent = self.curve.copy()
        bent[0] = bent[1] + 5e-4
        fit = ProjectorResponseFit(direct, MIX)
        fit.add(_light(direct, bent, level), level)
        assert (np.diff(fit.curve().values, axis=0) >= 0).all()

    def test_a_curve_that_falls_is_refused(self, direct: np.ndarray, level: np.ndarray) -> None:
        bent = self.curve.copy()
        bent[12] = bent[10]  # below its neighbour at 11
        fit = ProjectorResponseFit(direct, MIX)
        fit.add(_light(direct, bent, level), level)
        with pytest.raises(OutOfModelRange, match=rf"above drive {LEVELS[11]}/255"):
            fit.curve()
