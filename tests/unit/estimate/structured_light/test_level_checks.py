"""Brightness of white, black and the patterns, on ideal photographs of a Gray code."""

from dataclasses import replace

import numpy as np
import pytest

from procam.errors import InputError
from procam.estimate.structured_light.codes import generate, make_code
from procam.estimate.structured_light.level_checks import (
    ProbedSet,
    check_levels,
    drop_dark,
    order_levels,
)

CODE = make_code("gray", (64, 48))


def photographs(scale: float = 1.0) -> list[np.ndarray]:
    """The panel seen 1:1 in 12 bits, clipped at 4095."""
    return [
        np.minimum(100 + scale * 12 * p[..., 0].astype(int), 4095).astype(np.uint16)
        for p in generate(CODE)
    ]


def probed(photos: list[np.ndarray]) -> ProbedSet:
    return ProbedSet(photos, [f"img_{i}" for i in range(len(photos))])


def order() -> list[int | None]:
    return list(range(len(CODE.planes)))


def test_a_sound_set_has_no_notes() -> None:
    photos, planes = probed(photographs()), order()
    assert check_levels(photos, planes) + drop_dark(CODE, photos, planes) == []
    assert planes == order()


def test_white_and_black_are_exchanged() -> None:
    shown = photographs()
    shown[:2] = shown[1::-1]
    planes = order()
    (note,) = order_levels(probed(shown), planes)
    assert planes[:2] == [1, 0] and "img_0 and img_1: white and black" in note


def test_clipped_white_is_noted() -> None:
    (note,) = check_levels(probed(photographs(2.0)), order())
    assert note == "img_0: white is clipped in 100% of the lit pixels; expose shorter"


@pytest.mark.parametrize(
    ("plane", "factor", "message"),
    [(5, 2.0, "img_0 should show white, but .* brighter"), (0, 2.5, "of the light between")],
)
def test_another_exposure_is_refused(plane: int, factor: float, message: str) -> None:
    shown = photographs(0.5)
    shown[plane] = (factor * shown[plane]).astype(np.uint16)
    with pytest.raises(InputError, match=message):
        check_levels(probed(shown), order())


def test_a_set_that_never_changes_is_refused() -> None:
    with pytest.raises(InputError, match="all 3 are alike, level 7"):
        probed([np.full((9, 9), 7, np.uint8)] * 3)


def test_a_repeated_photograph() -> None:
    shown = photographs()
    shown[6] = shown[5]
    photos = probed(shown)
    assert [photos.repeats(i) for i in (0, 5, 6, 7)] == [False, False, True, False]
    assert replace(CODE.planes[4], inverse=True) == CODE.planes[5]


def test_a_photograph_that_differs_in_places_is_no_repeat() -> None:
    """A tenth of the columns, as neighbouring steps of a wave at their least."""
    shown = photographs()
    shown[6] = shown[5].copy()
    columns = slice(None, None, 10)
    shown[6][:, columns] = shown[4][:, columns]
    assert not probed(shown).repeats(6)
