"""Checks of the brightness of a set of photographs: white, black, and patterns without light."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from procam.arrays import AnyArray
from procam.errors import InputError
from procam.estimate.structured_light.codes import Code
from procam.estimate.structured_light.consistency import Order
from procam.estimate.structured_light.limits import full_scale

LIT_SHARE = 0.25  # of the largest range of a pixel over the set: pixels with more are lit
SAME_SHARE = 0.04  # of a pixel's range: two photographs of one pattern differ by less
DARK_SHARE = 0.2  # of the light that a pattern should have: with less it counts as black
MIN_LIGHT = 0.15  # of white's: a pattern with less may have none where the camera looks
BETWEEN_LIGHT = 0.2  # of white's, above which a pattern counts in the median
MOST_LIT = 0.4  # of the patterns have light, whatever part of the panel is seen
# Median light of the patterns, of white's: half, and more or less where part of the panel is seen.
MEDIAN_LIGHT = (0.3, 0.8)
CLIPPED_SHARE = 0.05
BEYOND, MAX_BEYOND = 0.3, 0.1  # of a pixel's range, and share of the lit pixels


class ProbedSet:
    """Samples (n, 3) of every photograph of a set, in the order of the photographs.

    `lit` (n, 3) marks samples that change over the set, `range` is their mean range.
    """

    def __init__(self, probes: Sequence[AnyArray], names: Sequence[str]) -> None:
        self.names = names
        self.probes = [np.asarray(p, np.float32) for p in probes]
        whole = probes[0].dtype.kind == "u"
        self.top = full_scale(max(probes, key=np.mean)) if whole else np.inf
        stack = np.stack(self.probes[:: max(1, len(probes) // 16)])
        reach = stack.max(axis=0) - stack.min(axis=0)
        if not reach.max() > 0:
            raise InputError(
                f"pictures: all {len(probes)} are alike, level {stack.flat[0]:.0f}; check that the lens "
                "cap is off, the projector on, and the exposure neither far too short nor too long"
            )
        self.lit = reach > LIT_SHARE * reach.max()
        self.range = float(reach[self.lit].mean())

    def shown(self, probes: Sequence[AnyArray]) -> "ProbedSet":
        """The set with other samples of the same pixels."""
        other = copy(self)
        other.probes = list(probes)
        return other

    def repeats(self, i: int) -> bool:
        """Whether photograph i shows the same pattern as the one before."""
        if i == 0:
            return False
        change = np.abs(self.probes[i] - self.probes[i - 1])[self.lit].mean()
        return bool(change < SAME_SHARE * self.range)


def order_levels(photos: ProbedSet, order: Order) -> list[str]:
    """Exchange white and black in `order` if needed; gives notes.

    Raises
    ------
    InputError : one of the two is missing.
    """
    white, black = order[0], order[1]
    if white is None or black is None:
        missing = "white" if white is None else "black"
        raise InputError(
            f"pictures: the {missing} one is missing, and without it lit pixels cannot be identified; "
            "photograph it again"
        )
    if photos.probes[white].mean() >= photos.probes[black].mean():
        return []
    order[0], order[1] = black, white
    return [
        f"{photos.names[white]} and {photos.names[black]}: white and black in each other's place "
        "(wrong order); exchanged"
    ]


def check_levels(photos: ProbedSet, order: Order) -> list[str]:
    """Check white and black; gives notes.

    Raises
    ------
    InputError : one of the two does not show what it should.
    """
    white, black = order[0], order[1]
    assert white is not None and black is not None
    _check_extremes(photos, white, black)
    _check_median(photos, white, black)
    return _clipping(photos, white, black)


def levels_pass(photos: ProbedSet, order: Order) -> bool:
    """Whether white and black show what they should."""
    try:
        check_levels(photos, order)
    except InputError:
        return False
    return True


def drop_dark(code: Code, photos: ProbedSet, order: Order) -> list[str]:
    """Remove photographs without light from `order`; gives notes.

    A pattern whose inverse has all the light is kept: the camera may see only half of the panel.
    """
    light = [np.nan if p is None else float(photos.probes[p].mean()) for p in order]
    share = (np.array(light) - light[1]) / (light[0] - light[1])  # of white's
    notes = []
    for index, photo in enumerate(order):
        plane = code.planes[index]
        if plane.axis == "" or photo is None:
            continue
        expected = float(code.axis(plane.axis).line(plane).mean())
        pair = replace(plane, inverse=not plane.inverse)
        inverse = share[code.planes.index(pair)] if pair in code.planes else np.nan
        if plane.kind == "binary" and pair not in code.planes:
            continue  # alone it may be black where the camera looks
        complete = share[index] + inverse > 1 - DARK_SHARE * expected
        if not complete and expected > MIN_LIGHT and share[index] < DARK_SHARE * expected:
            notes.append(f"{photos.names[photo]}: black, expected {plane}; left out")
            order[index] = None
    return notes


def _check_extremes(photos: ProbedSet, white: int, black: int) -> None:
    """Check that nothing is brighter than white or darker than black."""
    stack = np.stack(photos.probes)
    low, high = stack.min(axis=0)[photos.lit], stack.max(axis=0)[photos.lit]
    beyond = BEYOND * (high - low)
    for photo, what, more, past in (
        (white, "white", "brighter", high - photos.probes[white][photos.lit] > beyond),
        (black, "black", "darker", photos.probes[black][photos.lit] - low > beyond),
    ):
        if past.mean() > MAX_BEYOND:
            raise InputError(
                f"pictures: {photos.names[photo]} should show {what}, but {past.mean():.0%} of the lit "
                f"pixels are {more} in others; check that it is not stale and the exposure is manual"
            )


def _check_median(photos: ProbedSet, white: int, black: int) -> None:
    """Check that the patterns have about half of the light between black and white."""
    light = np.array([p.mean() for p in photos.probes]) - photos.probes[black].mean()
    between = light[light > BETWEEN_LIGHT * light[white]]
    share = float(np.median(between) / max(light[white], 1e-9)) if between.size else 0.0
    share *= between.size > MOST_LIT * light.size
    if not MEDIAN_LIGHT[0] < share < MEDIAN_LIGHT[1]:
        raise InputError(
            f"pictures: {photos.names[white]} should show white and {photos.names[black]} black, but "
            f"the others have {share:.0%} of the light between instead of half; check that neither is "
            "stale and the exposure is manual"
        )


def _clipping(photos: ProbedSet, white: int, black: int) -> list[str]:
    span = photos.probes[white] - photos.probes[black]
    lit = span > LIT_SHARE * span.max()
    clipped = float((photos.probes[white][lit] >= photos.top).mean())
    if clipped <= CLIPPED_SHARE:
        return []
    return [
        f"{photos.names[white]}: white is clipped in {clipped:.0%} of the lit pixels; expose shorter"
    ]
