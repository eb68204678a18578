"""The Python interface refuses what would give a wrong result without a word."""

import numpy as np
import pytest

from procam.errors import InputError, NotEnoughData
from procam.interfaces.api import calibrate_camera, decode, generate_patterns

SIZE = (128, 80)


@pytest.mark.parametrize("code", ["micro-phase", "gray"])
@pytest.mark.parametrize("missing", [1, 3])
def test_missing_photographs_are_refused(code: str, missing: int) -> None:
    patterns = generate_patterns(SIZE, code)
    words = f"has {len(patterns)} patterns, and there are {len(patterns) - missing} photographs"
    with pytest.raises(NotEnoughData, match=words):
        decode(patterns[:-missing], SIZE, code)
    with pytest.raises(InputError, match="there are more photographs"):
        decode([*patterns, patterns[0]], SIZE, code)


def test_white_and_black_at_the_end_are_refused() -> None:
    """As `procam session plan --code gray` numbers them."""
    patterns = generate_patterns(SIZE, "gray")
    with pytest.raises(InputError, match="white, the first photograph, is darker than black"):
        decode([*patterns[2:], *patterns[:2]], SIZE, "gray")


def test_saturation_of_colour_photographs_is_seen() -> None:
    """Overexposed red and blue do not matter; saturated green is left out, as in grey photographs."""
    grey = [
        np.clip(p.astype(float) * 1.3 - 60, 0, 255).astype(np.uint8)
        for p in generate_patterns(SIZE)
    ]
    colour = [np.stack([p * 0 + 255, p, p * 0 + 255], axis=-1) for p in grey]
    alone, among = decode(grey, SIZE), decode(colour, SIZE)
    np.testing.assert_array_equal(alone.valid, among.valid)
    np.testing.assert_array_equal(alone.projector_xy, among.projector_xy)


@pytest.mark.parametrize("size", [128, (128.5, 80), "128x80", (128, 80, 3)])
def test_sizes_that_are_none_are_refused(size: object) -> None:
    with pytest.raises(InputError, match=r"size: .* is no \(width, height\) in whole pixels"):
        generate_patterns(size)


@pytest.mark.parametrize(
    "photograph", ["a.png", np.zeros((4, 4), int), np.zeros((4, 4, 2), np.uint8), np.zeros(4)]
)
def test_what_is_no_photograph_is_refused(photograph: object) -> None:
    for use in (
        lambda: decode([photograph], SIZE),
        lambda: calibrate_camera([photograph], (10, 7), 0.02),
    ):
        with pytest.raises(InputError, match=r"photograph: .*give pixels"):
            use()
