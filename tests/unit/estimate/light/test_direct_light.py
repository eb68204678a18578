"""Direct light by stripes, against drawn light."""

import numpy as np
import pytest

from procam.estimate.light.direct_light import (
    DirectLight,
    find_direct_light,
    stripe_contrast,
    well_inside,
)
from procam.maths.codes.gray import is_bright

SHAPE = (60, 240)
SCATTERED = 30.0


def found(direct: float, sigma: float, dark_part: float = 0.0) -> DirectLight:
    """A panel of 120 columns on the left, lit by `direct`; stripes of which more are dark than bright."""
    rng = np.random.default_rng(3)
    x = np.arange(SHAPE[1])
    panel = np.where(x < 120, direct, 0.0)
    pairs = []
    for bit in (4, 5):
        bright = is_bright(x, bit) & (x >= dark_part * 120)
        shown = [panel * on + SCATTERED * on[:120].mean() for on in (bright, ~bright)]
        pairs.append(tuple(np.tile(s, (SHAPE[0], 1)) + rng.normal(0, sigma, SHAPE) for s in shown))
    span = np.tile(panel + SCATTERED, (SHAPE[0], 1)).astype(np.float32)
    noise = np.full(SHAPE, np.sqrt(2) * sigma, np.float32)
    return find_direct_light(span, stripe_contrast(span, pairs), noise)


class TestFindDirectLight:
    @pytest.mark.parametrize("dark_part", [0.0, 0.4])
    def test_the_panel_and_not_what_scatters(self, dark_part: float) -> None:
        seen = found(100.0, 0.5, dark_part)
        assert seen.seen[:, 5:115].all() and not seen.seen[:, 125:].any()
        assert seen.absent[:, 125:].all() and not seen.absent[:, :118].any()
        assert not seen.dim.any()

    def test_where_white_is_too_dark_nothing_is_certain(self) -> None:
        dim = found(2.0, 2.0)
        assert dim.seen.mean() < 0.01 and not dim.absent[:, :115].any() and dim.dim.all()

    def test_a_pixel_lit_in_part_does_not_lie_well_inside(self) -> None:
        seen = np.zeros((40, 40), bool)
        seen[5:35, 5:35] = True
        seen[20, 20] = False
        inside = well_inside(seen)
        assert inside[11:29, 11:29].all() and inside.sum() == 18**2
