"""Stripes decoded to columns, also when planes are lost or light is scattered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.estimate.structured_light.codes import Plane
from procam.estimate.structured_light.limits import DecodeLimits
from procam.estimate.structured_light.stripes import WIDEST_LOSS, StripeDecoder, column_table
from procam.maths.codes.gray import encode_gray

LENGTH, ROWS = 40, 6


def gray(length: int) -> np.ndarray:
    return encode_gray(np.arange(length))


def planes(codewords: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Pattern (rows, columns) 0 or 1, inverse and bit."""
    shown = []
    for bit in range((len(codewords) - 1).bit_length()):
        line = np.tile(((codewords >> bit) & 1).astype(np.float32), (ROWS, 1))
        shown.append((line, 1 - line, bit))
    return shown


@pytest.mark.parametrize("inverse", [False, True])
def test_a_missing_partner_is_what_white_and_black_leave(inverse: bool) -> None:
    """Before a black that is nearly half of white."""
    words = gray(LENGTH)
    white, black = (np.full((ROWS, LENGTH), level, np.float32) for level in (1.0, 0.4))
    decoder = StripeDecoder(words, white, black, DecodeLimits(0.0, 0.05, lit_share=0.0))
    for pattern, other, bit in planes(words):
        shown = other if inverse else pattern
        decoder.add(Plane("binary", "x", bit, inverse), 0.4 + 0.6 * shown)
    np.testing.assert_array_equal(decoder.result().x, np.tile(np.arange(LENGTH), (ROWS, 1)))


class TestColumnTable:
    @given(length=st.integers(2, 120), data=st.data())
    def test_lost_planes_by_brute_force(self, length: int, data: st.DataObject) -> None:
        words = gray(length)
        bits = (length - 1).bit_length()
        folded = data.draw(st.sets(st.integers(0, bits - 1), min_size=max(0, bits - 3)))
        column, sigma = column_table(words, folded)
        mask = sum(1 << b for b in folded)
        for word in range(2**bits):
            same = np.flatnonzero((words & mask) == word)  # lost planes leave their bits at 0
            together = len(same) > 0 and same[-1] - same[0] + 1 == len(same)
            if together and len(same) <= WIDEST_LOSS:
                assert column[word] == same.mean()
                assert sigma[word] == pytest.approx(len(same) / np.sqrt(12))
            else:
                assert np.isnan(column[word]) and np.isnan(sigma[word])


class TestDecoder:
    light = np.linspace(60, 200, LENGTH * ROWS).reshape(ROWS, LENGTH).astype(np.float32)
    words = gray(LENGTH)

    def _decoder(self, contrast: float = 4.0) -> StripeDecoder:
        white = self.light + 10
        limits = DecodeLimits(0.0, contrast)
        return StripeDecoder(self.words, white, np.full_like(white, 10), limits)

    def _add(self, decoder: StripeDecoder, lost: tuple[int, ...] = ()) -> list[bool]:
        resolved = []
        for pattern, inverse, bit in planes(self.words):
            shown = [10 + self.light * p for p in (pattern, inverse)]
            if bit in lost:
                shown = [10 + 0.5 * self.light] * 2
            resolved.append(decoder.add_pair(*shown, bit))
        return resolved

    @pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
    def test_every_column_comes_back(self, dtype: type) -> None:
        light = self.light.astype(dtype)
        limits = DecodeLimits(0.0, 4.0)
        decoder = StripeDecoder(self.words, light + dtype(10), np.full_like(light, 10), limits)
        for pattern, inverse, bit in planes(self.words):
            for plane, picture in (
                (Plane("binary", "x", bit), pattern),
                (Plane("binary", "x", bit, inverse=True), inverse),
            ):
                decoder.add(plane, dtype(10) + light * picture.astype(dtype))
        found = decoder.result()
        np.testing.assert_array_equal(found.x, np.tile(np.arange(LENGTH), (ROWS, 1)))
        np.testing.assert_allclose(found.sigma, 1 / np.sqrt(12))
        np.testing.assert_allclose(found.direct, light, rtol=1e-5)
        assert (found.waves, found.lost) == (None, ())

    def test_a_plane_that_no_pixel_resolves_is_left_out(self) -> None:
        decoder = self._decoder()
        assert self._add(decoder, lost=(0,)) == [False, *[True] * 5]
        found = decoder.result()
        np.testing.assert_array_equal(found.x[0], np.arange(LENGTH) // 2 * 2 + 0.5)
        np.testing.assert_allclose(found.sigma, 2 / np.sqrt(12))
        assert decoder.certain().all()  # the other bits still are

    def test_a_plane_some_resolve_is_kept_and_the_rest_are_uncertain(self) -> None:
        decoder = self._decoder()
        for pattern, inverse, bit in planes(self.words):
            shown = [10 + self.light * p for p in (pattern, inverse)]
            if bit == 1:  # blurred away on the left
                for picture in shown:
                    picture[:, :20] = 10 + 0.5 * self.light[:, :20]
            assert decoder.add_pair(*shown, bit)
        known = np.isfinite(decoder.result().x)
        assert not known[:, :20].any() and known[:, 20:].all()

    def test_without_bright_pixels_no_plane_is_left_out(self) -> None:
        """Light too faint to judge a plane by is still decoded."""
        assert all(self._add(self._decoder(contrast=100.0)))


class TestFluxInterval:
    """A pair whose fluxes differ lights the dome unevenly, which can invert a faint bit."""

    direct = 30.0
    surplus = 0.6  # of the flux: pattern 0.8, inverse 0.2

    def _pair(
        self, scattered: float, bright: bool, lit_share: float = 0.1
    ) -> tuple[StripeDecoder, np.ndarray, np.ndarray]:
        """A pixel of `direct` light and `scattered` light in white, among many bright ones.

        A balanced pair comes first and shows how much of the light is direct.
        """
        shape = (20, 50)
        white = np.full(shape, 1000, np.float32)
        white[0, 0] = self.direct + scattered
        limits = DecodeLimits(0.0, 2.0, lit_share)
        decoder = StripeDecoder(np.arange(4), white, np.zeros_like(white), limits)
        half = (np.indices(shape)[1] % 2).astype(np.float32)
        first = [1000 * half, 1000 * (1 - half)]
        first[0][0, 0], first[1][0, 0] = 0.5 * scattered, self.direct + 0.5 * scattered
        decoder.add_pair(*first, 1)
        lit = np.zeros(shape, np.float32)
        lit.ravel()[: lit.size * 4 // 5] = 1
        pattern, inverse = 1000 * lit, 1000 * (1 - lit)
        for picture, on, share in ((pattern, bright, 0.8), (inverse, not bright, 0.2)):
            picture[0, 0] = self.direct * on + share * scattered
        return decoder, pattern, inverse

    @pytest.mark.parametrize("bright", [True, False])
    @pytest.mark.parametrize("scattered", [0.0, 10.0, 60.0, 150.0])
    def test_a_bit_that_is_certain_is_right(self, scattered: float, bright: bool) -> None:
        decoder, pattern, inverse = self._pair(scattered, bright)
        decoder.add_pair(pattern, inverse, 0)
        column = decoder.result().x
        if self.surplus * scattered < 0.3 * self.direct:
            assert column[0, 0] == bright
        if not bright and self.direct < self.surplus * scattered:  # it appears bright
            assert np.isnan(column[0, 0])
        assert np.isnan(column[0, 0]) or column[0, 0] == bright
        assert np.isfinite(column[5:]).all()

    def test_without_scattered_light_every_contrast_counts(self) -> None:
        decoder, pattern, inverse = self._pair(120.0, False, lit_share=0.0)
        assert decoder.add_pair(pattern, inverse, 0)
        assert decoder.certain().all()

    def test_balanced_pairs_are_certain_in_any_light(self) -> None:
        white = np.full((20, 50), 1000, np.float32)
        decoder = StripeDecoder(np.arange(4), white, np.zeros_like(white), DecodeLimits(0.0, 2.0))
        lit = (np.indices(white.shape)[1] % 2).astype(np.float32)
        decoder.add_pair(30 * lit + 485, 30 * (1 - lit) + 485, 0)
        assert decoder.certain().all()
