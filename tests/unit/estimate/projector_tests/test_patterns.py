"""The test patterns: their flux, numbers and colours."""

import numpy as np
import pytest

from procam.estimate.projector_tests.patterns import (
    COUNT,
    STRIPE_PX,
    PatchLayout,
)

LAYOUT = PatchLayout((128, 80))


class TestPatterns:
    @pytest.mark.parametrize("size", [(128, 80), (1280, 800), (1920, 1200)])
    def test_half_of_the_patches_make_five_per_cent(self, size: tuple[int, int]) -> None:
        layout = PatchLayout(size)
        first, second = layout.pair()
        assert first.mean() == second.mean() == pytest.approx(0.05, rel=0.06)
        assert not (first * second).any()

    def test_rings_are_black(self) -> None:
        white = LAYOUT.picture(np.ones(COUNT), 1.0)[..., 0]
        side, ring = LAYOUT.side_px, LAYOUT.ring_px
        assert (white == 0).sum() == COUNT * ((side + 2 * ring) ** 2 - side**2)

    def test_colours_add_up_to_the_pair_at_equal_load(self) -> None:
        first, second = LAYOUT.pair()
        colours = LAYOUT.colours()
        assert np.array_equal(sum(colours), first + 2 * second)
        assert [c.mean() for c in colours] == pytest.approx([first.mean()] * 3)

    @pytest.mark.parametrize(("slant", "along"), [(1, (1, -1)), (-1, (1, 1))])
    def test_stripes_are_diagonal(self, slant: int, along: tuple[int, int]) -> None:
        stripes = LAYOUT.stripes(slant, 0.2, 0.8)[..., 0]
        assert stripes[:78, :126].mean() == pytest.approx(0.5)
        assert np.array_equal(stripes[6:-6, 6:-6], np.roll(stripes, along, (0, 1))[6:-6, 6:-6])
        assert np.array_equal(stripes[:, STRIPE_PX:], stripes[:, :-STRIPE_PX])
