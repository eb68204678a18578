"""Camera pixels that do not show the pattern: found, and inpainted."""

import numpy as np
from tolerances import FLOAT32

from procam.estimate.light.inpaint import (
    BORDER_CAMERA_PX,
    fill_light,
    fill_picture,
    pixels_without_pattern,
)
from procam.estimate.light.separation import SeparatedLight
from procam.model.mask import Mask

SHAPE = (40, 60)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
SLOPE = np.stack([1 + 0.02 * X - 0.01 * Y, 2 + 0.01 * Y, 3 + 0 * X], axis=-1).astype(np.float32)
SCATTERED = np.float32(0.1)
SOLID = np.full(SHAPE, 1e-3)
HOLE = (X >= 20) & (X < 33) & (Y >= 10) & (Y < 25)


def split(lit: np.ndarray) -> SeparatedLight:
    spoilt = np.where(HOLE[..., None], 7, SLOPE) * lit[..., None]
    return SeparatedLight(
        spoilt.astype(np.float32),
        np.full_like(SLOPE, SCATTERED),
        np.tensordot(SOLID, spoilt, 2),
        lit | HOLE,
    )


class TestFill:
    def test_slopes_continue(self) -> None:
        spoilt = np.where(HOLE[..., None], np.float32(99), SLOPE)
        filled = fill_picture(spoilt, HOLE, np.ones(SHAPE, bool))
        np.testing.assert_allclose(filled, SLOPE, rtol=10 * FLOAT32)

    def test_only_known_pixels_are_used(self) -> None:
        known = X < 26
        spoilt = np.where(known[..., None] & ~HOLE[..., None], np.float32(4), np.float32(1e6))
        filled = fill_picture(spoilt, HOLE, known)
        np.testing.assert_allclose(filled[HOLE], 4, rtol=1e-5)

    def test_at_the_border_of_the_picture_and_where_nothing_is_known(self) -> None:
        corner = (X < 5) & (Y < 5)
        filled = fill_picture(np.where(corner[..., None], 0, SLOPE), corner, ~corner)
        assert (np.abs(filled - SLOPE)[corner] < 0.1).all()
        everything = np.ones(SHAPE, bool)
        assert not fill_picture(SLOPE, everything, everything).any()
        np.testing.assert_array_equal(fill_picture(SLOPE, ~everything, everything), SLOPE)


def filled(lit: np.ndarray, shown: np.ndarray = SLOPE, solid: np.ndarray = SOLID) -> SeparatedLight:
    return fill_light(split(lit), (shown + SCATTERED).astype(np.float32), HOLE, solid)


class TestLight:
    def test_equals_white_without_the_hole(self) -> None:
        light = filled(np.ones(SHAPE, bool))
        np.testing.assert_allclose(light.direct, SLOPE, rtol=10 * FLOAT32)
        inner = (slice(1, -1), slice(1, -1))  # the edge of a photograph is a border
        np.testing.assert_allclose(light.extended()[inner], SLOPE[inner], rtol=10 * FLOAT32)
        np.testing.assert_allclose(light.flux, SLOPE.sum(axis=(0, 1)) * 1e-3, rtol=FLOAT32)
        np.testing.assert_allclose(light.scattered, SCATTERED, rtol=10 * FLOAT32)
        assert light.lit.all()

    def test_scattered_light_is_scaled_to_the_inpainted_flux(self) -> None:
        shown = np.where(HOLE[..., None], 0.4 * SLOPE, SLOPE)
        light = filled(np.ones(SHAPE, bool), shown)
        flux_shown = shown.sum(axis=(0, 1)) * 1e-3
        expected = np.broadcast_to(SCATTERED / flux_shown, SLOPE.shape)
        np.testing.assert_allclose(light.scattered / light.flux, expected, rtol=10 * FLOAT32)

    def test_the_border_of_the_lit_area_is_straight(self) -> None:
        lit = X < 26
        light = filled(lit)
        wrong = (light.lit != lit) & HOLE
        assert wrong.sum() <= 0.1 * HOLE.sum()
        assert not light.direct[HOLE & ~light.lit].any()

    def test_off_the_screen_it_stays_dark(self) -> None:
        solid = np.where(X < 26, 1e-3, 0.0)
        light = filled(X < 26, solid=solid)
        np.testing.assert_array_equal(light.lit & HOLE, HOLE & (X < 26))


def test_pixels_that_see_a_mark() -> None:
    panel = Mask("p", np.zeros((20, 30), bool))
    panel.covered[5:10, 10:15] = True
    xy = np.stack([X / 2, Y / 2], axis=-1).astype(np.float32)
    xy[0, 0] = np.nan
    missing = pixels_without_pattern(panel, xy)
    assert missing[10:19, 20:29].all()
    assert not missing[: 9 - BORDER_CAMERA_PX].any()
    assert not missing[:, 30 + BORDER_CAMERA_PX :].any()
