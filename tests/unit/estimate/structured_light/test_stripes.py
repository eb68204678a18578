"""Stripe pictures folded into codewords, and codewords looked up when planes are lost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.estimate.structured_light.codes import AxisCode
from procam.estimate.structured_light.stripes import WIDEST_LOSS, StripeFolder, column_table
from procam.maths.codes.gray import bit_count, long_run_codewords, plain_codewords, xor_codewords

LENGTH, ROWS = 40, 6
CODES = {
    "gray": plain_codewords,
    "gray-wide": long_run_codewords,
    "xor-02": lambda length: xor_codewords(length, 0),
    "xor-04": lambda length: xor_codewords(length, 1),
}


def planes(codewords: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Pattern (rows, columns) 0 or 1, inverse and bit."""
    shown = []
    for bit in range(bit_count(len(codewords))):
        line = np.tile(((codewords >> bit) & 1).astype(np.float32), (ROWS, 1))
        shown.append((line, 1 - line, bit))
    return shown


class TestColumnTable:
    @pytest.mark.parametrize("name", CODES)
    @given(length=st.integers(2, 300))
    def test_all_planes_tell_every_column(self, name: str, length: int) -> None:
        words = CODES[name](length)
        bits = bit_count(length)
        column, sigma = column_table(words, bits, set(range(bits)))
        assert column.shape == sigma.shape == (2**bits,)
        np.testing.assert_array_equal(column[words], np.arange(length))
        np.testing.assert_allclose(sigma[words], 1 / np.sqrt(12))
        others = np.setdiff1d(np.arange(2**bits), words)
        assert np.isnan(column[others]).all() and np.isnan(sigma[others]).all()

    @pytest.mark.parametrize("name", CODES)
    @given(length=st.integers(2, 120), data=st.data())
    def test_lost_planes_by_brute_force(self, name: str, length: int, data: st.DataObject) -> None:
        words = CODES[name](length)
        bits = bit_count(length)
        folded = data.draw(st.sets(st.integers(0, bits - 1), min_size=max(0, bits - 3)))
        column, sigma = column_table(words, bits, folded)
        mask = sum(1 << b for b in folded)
        for word in range(2**bits):
            same = np.flatnonzero((words & mask) == word)  # lost planes leave their bits at 0
            together = len(same) > 0 and same[-1] - same[0] + 1 == len(same)
            if together and len(same) <= WIDEST_LOSS:
                assert column[word] == same.mean()
                assert sigma[word] == pytest.approx(len(same) / np.sqrt(12))
            else:
                assert np.isnan(column[word]) and np.isnan(sigma[word])

    def test_fine_planes_of_the_gray_code_widen_the_place(self) -> None:
        words = plain_codewords(1024)
        column, sigma = column_table(words, 10, set(range(2, 10)))
        known = words & ~3
        np.testing.assert_array_equal(column[known], np.arange(1024) // 4 * 4 + 1.5)
        np.testing.assert_allclose(sigma[known], 4 / np.sqrt(12))

    def test_a_lost_coarse_plane_leaves_nothing(self) -> None:
        words = plain_codewords(1024)
        column, _ = column_table(words, 10, set(range(9)))
        # but for the two columns on either side of the middle, whose other bits are alike
        assert np.isfinite(column[words & 0x1FF]).sum() == 2


class TestFolder:
    light = np.linspace(60, 200, LENGTH * ROWS).reshape(ROWS, LENGTH).astype(np.float32)

    def _folder(self, spill: float = 0.0, contrast: float = 4.0) -> StripeFolder:
        white = self.light + 10 + np.float32(spill)
        return StripeFolder(white, np.full_like(white, 10), contrast)

    def _add(
        self,
        folder: StripeFolder,
        words: np.ndarray,
        lost: tuple[int, ...] = (),
        spill: float = 0.0,
    ) -> list[bool]:
        told = []
        for pattern, inverse, bit in planes(words):
            shown = [10 + self.light * p + np.float32(spill * p.mean()) for p in (pattern, inverse)]
            if bit in lost:
                shown = [10 + 0.5 * self.light] * 2
            told.append(folder.add(*shown, bit))
        return told

    @pytest.mark.parametrize("name", CODES)
    def test_every_column_comes_back(self, name: str) -> None:
        words = CODES[name](LENGTH)
        folder = self._folder()
        assert all(self._add(folder, words))
        column, sigma = folder.columns(AxisCode(LENGTH, codewords=words))
        np.testing.assert_array_equal(column, np.tile(np.arange(LENGTH), (ROWS, 1)))
        np.testing.assert_allclose(sigma, 1 / np.sqrt(12))
        assert folder.certain().all()
        np.testing.assert_allclose(folder.most(), self.light, rtol=1e-5)

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_whole_numbers(self, dtype: type) -> None:
        words = plain_codewords(LENGTH)
        light = self.light.astype(dtype)
        folder = StripeFolder(light + dtype(10), np.full_like(light, 10), 4.0)
        for pattern, inverse, bit in planes(words):
            folder.add(*(dtype(10) + light * p.astype(dtype) for p in (pattern, inverse)), bit)
        column, _ = folder.columns(AxisCode(LENGTH, codewords=words))
        np.testing.assert_array_equal(column, np.tile(np.arange(LENGTH), (ROWS, 1)))
        np.testing.assert_array_equal(folder.most(), light)

    def test_a_plane_that_nobody_resolves_is_left_out(self) -> None:
        words = plain_codewords(LENGTH)
        folder = self._folder()
        assert self._add(folder, words, lost=(0,)) == [False, *[True] * 5]
        column, sigma = folder.columns(AxisCode(LENGTH, codewords=words))
        np.testing.assert_array_equal(column[0], np.arange(LENGTH) // 2 * 2 + 0.5)
        np.testing.assert_allclose(sigma, 2 / np.sqrt(12))
        assert folder.certain().all()  # the others still are

    def test_a_plane_some_resolve_is_kept_and_the_rest_are_uncertain(self) -> None:
        words = plain_codewords(LENGTH)
        folder = self._folder()
        for pattern, inverse, bit in planes(words):
            shown = [10 + self.light * p for p in (pattern, inverse)]
            if bit == 1:  # blurred away on the left
                for picture in shown:
                    picture[:, :20] = 10 + 0.5 * self.light[:, :20]
            assert folder.add(*shown, bit)
        certain = folder.certain()
        assert not certain[:, :20].any() and certain[:, 20:].all()

    def test_nothing_bright_is_no_reason_to_leave_planes_out(self) -> None:
        """Light too faint to judge a plane by is still decoded."""
        folder = self._folder(contrast=100.0)
        assert all(self._add(folder, plain_codewords(LENGTH)))

    @pytest.mark.parametrize("count", [1, 2, 3, 6])
    def test_any_number_of_pairs_may_have_come(self, count: int) -> None:
        words = plain_codewords(LENGTH)
        folder = self._folder()
        for pattern, inverse, bit in planes(words)[::-1][:count]:
            folder.add(10 + self.light * pattern, 10 + self.light * inverse, bit)
        column, _ = folder.columns(AxisCode(LENGTH, codewords=words))
        expected, _ = column_table(words, 6, set(range(6 - count, 6)))
        known = words & sum(1 << b for b in range(6 - count, 6))
        np.testing.assert_array_equal(column[0], expected[known])
        assert folder.certain().all()


class TestFluxInterval:
    """A pair whose fluxes differ lights the dome unevenly, which can turn a faint bit round."""

    direct = 30.0
    surplus = 0.6  # of the flux: pattern 0.8, inverse 0.2

    def _pair(self, scattered: float, bright: bool) -> tuple[StripeFolder, np.ndarray, np.ndarray]:
        """A pixel of `direct` light and `scattered` light in white, among many bright ones.

        A balanced pair has told already how much of it is direct.
        """
        shape = (20, 50)
        white = np.full(shape, 1000, np.float32)
        white[0, 0] = self.direct + scattered
        folder = StripeFolder(white, np.zeros_like(white), 2.0)
        half = (np.indices(shape)[1] % 2).astype(np.float32)
        first = [1000 * half, 1000 * (1 - half)]
        first[0][0, 0], first[1][0, 0] = 0.5 * scattered, self.direct + 0.5 * scattered
        folder.add(*first, 1)
        lit = np.zeros(shape, np.float32)
        lit.ravel()[: lit.size * 4 // 5] = 1
        pattern, inverse = 1000 * lit, 1000 * (1 - lit)
        for picture, on, share in ((pattern, bright, 0.8), (inverse, not bright, 0.2)):
            picture[0, 0] = self.direct * on + share * scattered
        return folder, pattern, inverse

    @pytest.mark.parametrize("bright", [True, False])
    @pytest.mark.parametrize("scattered", [0.0, 10.0, 30.0, 60.0, 120.0, 150.0])
    def test_a_bit_that_is_certain_is_right(self, scattered: float, bright: bool) -> None:
        folder, pattern, inverse = self._pair(scattered, bright)
        folder.add(pattern, inverse, 0)
        column, _ = folder.columns(AxisCode(4, codewords=np.arange(4)))
        if folder.certain()[0, 0]:
            assert column[0, 0] == bright
        if self.surplus * scattered < 0.3 * self.direct:
            assert folder.certain()[0, 0]
        if not bright and self.direct < self.surplus * scattered:
            assert column[0, 0] == 1  # it looks bright, and only the rule knows better
            assert not folder.certain()[0, 0]
        assert folder.certain()[5:].all()

    def test_without_scattering_every_contrast_counts(self) -> None:
        folder, pattern, inverse = self._pair(120.0, False)
        plain = StripeFolder(folder._white, folder._black, 2.0, scattering=False)
        assert plain.add(pattern, inverse, 0)
        assert plain.certain().all()

    def test_balanced_pairs_are_certain_in_any_light(self) -> None:
        white = np.full((20, 50), 1000, np.float32)
        folder = StripeFolder(white, np.zeros_like(white), 2.0)
        lit = (np.indices(white.shape)[1] % 2).astype(np.float32)
        folder.add(30 * lit + 485, 30 * (1 - lit) + 485, 0)
        assert folder.certain().all()
