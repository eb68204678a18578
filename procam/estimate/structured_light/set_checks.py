"""Finds which photograph shows which plane of a code, and what is wrong with the set.

`OrderConsistency` scores any order of the photographs by the share of pixel triples that decode to a
straight line. Each kind of fault is then a comparison of orders: the set with one photograph left out,
with a gap in each possible place, or with two photographs exchanged. An order replaces the given one
only if it scores clearly better, so that a set without faults is not changed.
"""

from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import combinations
from math import prod

import numpy as np

from procam.arrays import AnyArray
from procam.errors import InputError
from procam.estimate.structured_light.codes import AXES, Axis, Code
from procam.estimate.structured_light.consistency import Order, OrderConsistency
from procam.estimate.structured_light.exposures import exposure_notes, relative_exposures, scaled
from procam.estimate.structured_light.gaps import (
    count_fits,
    missing_as_cause,
    missing_notes,
    skipped_numbers,
    spread,
)
from procam.estimate.structured_light.level_checks import (
    ProbedSet,
    check_levels,
    drop_dark,
    levels_pass,
    order_levels,
)

POOR = 0.5  # share of straight triples below which exchanges between the axes are tried too
EXCHANGE_GAIN = 1.15  # an exchange must score better by this factor
NEIGHBOUR_GAIN = 1.02  # of neighbours: more likely, and of little effect in a coarse pair
STALE_GAIN = 1.04  # by leaving a stale photograph out; a good one gives 1.01 at most
WORSE = 0.9  # of the better axis: below, something is wrong, whatever is left out
SLACK = 0.02  # of the triples, added to scores so that ratios of small ones mean little
HOPELESS, UNCERTAIN = 0.02, 0.25  # share of straight triples; defocus costs stripes much of it
NEARLY = 0.97  # of the best score: an order with as much cannot be excluded


@dataclass
class SetReport:
    """The order found for a set of photographs.

    Attributes
    ----------
    order : per plane of the code, the index of its photograph; None where there is none.
    notes : faults that were corrected or left out, one line each, with the photographs' names.
    gains : per photograph, its exposure over that of white, if it differs.
    refused : what checks found that would refuse the set, if they were not overruled.
    levels : whether white and black are sound; else the brightest and darkest of all replace them.
    """

    order: Order
    notes: list[str] = field(default_factory=list)
    gains: dict[int, float] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)
    levels: bool = True


def examine(
    code: Code,
    sequence: Sequence[int],
    probes: Sequence[AnyArray],
    names: Sequence[str],
    *,
    anyway: bool = False,
) -> SetReport:
    """Match photographs with the planes of `code`.

    Parameters
    ----------
    sequence : planes in the order in which they should have been photographed.
    probes : samples (n, 3) of each photograph, in the order of the photographs.
    names : of the photographs, for notes and messages.
    anyway : whether checks of what the photographs show are overruled.

    Raises
    ------
    InputError : too many or too few photographs, no usable white or black, or another code.
    """
    photos = ProbedSet(probes, names)
    inspector = _Inspector(code, photos, anyway)
    order = inspector.matched(sequence)
    inspector.notes += order_levels(photos, order)
    gains = inspector.scale(order)
    with inspector.overruled():
        inspector.notes += check_levels(inspector.photos, order)
    levels = levels_pass(inspector.photos, order) or inspector.without_levels(order)
    inspector.notes += drop_dark(code, inspector.photos, order)
    inspector.drop_stale(order)
    inspector.exchange(order)
    with inspector.overruled():
        inspector.judge(order)
    return SetReport(order, inspector.notes, gains, inspector.refused, levels)


class _Inspector:
    def __init__(self, code: Code, photos: ProbedSet, anyway: bool) -> None:
        self.code, self.photos, self.names = code, photos, photos.names
        self.notes: list[str] = []
        self.refused: list[str] = []
        self._anyway = anyway
        self._score = OrderConsistency(code, photos.probes)

    @contextmanager
    def overruled(self) -> Iterator[None]:
        """Keep a refusal as a text, if the set is to be decoded anyway."""
        try:
            yield
        except InputError as error:
            if not self._anyway:
                raise InputError(f"{error}{missing_as_cause(self.notes)}") from error
            self.refused.append(str(error))

    def scale(self, order: Order) -> dict[int, float]:
        """Bring all samples to the exposure of white, unless the set is worse then; gives the factors."""
        white, black = order[0], order[1]
        assert white is not None and black is not None
        gains = relative_exposures(self.code, self.photos, order)
        changed = {photo: float(gains[photo]) for photo in np.flatnonzero(gains != 1).tolist()}
        probes = list(self.photos.probes)
        for photo, gain in changed.items():
            probes[photo] = scaled(probes[photo], probes[black], gain)
        after, score = self.photos.shown(probes), OrderConsistency(self.code, probes)
        # fine stripes pass their contrast limit less often once scaled, so levels that fail weigh more
        least = NEARLY if levels_pass(self.photos, order) else WORSE
        worse = score.of(order) + SLACK < least * (self._score.of(order) + SLACK)
        if not changed or worse or not levels_pass(after, order):
            return {}
        self.notes += exposure_notes(gains, self.names, white)
        self.photos, self._score = after, score
        return changed

    def without_levels(self, order: Order) -> bool:
        """Replace white and black by the brightest and darkest samples of all; False."""
        probes = list(self.photos.probes)
        for plane, extreme in enumerate((np.max, np.min)):
            if (photo := order[plane]) is not None:
                probes[photo] = extreme(self.photos.probes, axis=0)
        self.photos, self._score = self.photos.shown(probes), OrderConsistency(self.code, probes)
        self.notes.append(
            "white and black are replaced by the brightest and darkest of all pictures"
        )
        return False

    def matched(self, sequence: Sequence[int]) -> Order:
        """Photographs by plane; a few may be missing, or one too many."""
        count = len(self.photos.probes)
        everything: Order = list(range(count))
        if count == len(sequence) + 1:
            return self._without_double(sequence, everything)
        if count_fits(len(sequence), self.names) and count < len(sequence):
            return self._with_gaps(sequence, everything)
        if count != len(sequence):
            raise InputError(
                f"pictures: the code {self.code.name} on {self.code.size[0]}x{self.code.size[1]} px "
                f"has {len(sequence)}, and {count} were given; check code and size"
            )
        return self._ordered(sequence, everything)

    def drop_stale(self, order: Order) -> None:
        """Remove photographs that repeat the one before and make the order inconsistent."""
        for plane, photo in enumerate(order):
            axis = self.code.planes[plane].axis
            if axis == "" or photo is None or not self.photos.repeats(photo):
                continue
            without = [None if i == plane else p for i, p in enumerate(order)]
            gain = self._gain(without, order, {axis})
            others = max(self._score.along(order, name) for name in AXES)
            worse = self._score.along(order, axis) < max(POOR, WORSE * others)
            if gain > STALE_GAIN or (gain < 1 and worse):
                order[plane] = None
                before = self.names[photo - 1]
                self.notes.append(
                    f"{self.names[photo]}: stale, it shows what {before} shows; left out"
                )

    def exchange(self, order: Order) -> None:
        """Exchange the two photographs whose exchange scores best, if it does so clearly."""
        best, gain, swapped = None, 1.0, (0, 0)
        for first, second in self._candidates(order):
            tried = list(order)
            tried[first], tried[second] = order[second], order[first]
            axes = {a for i in (first, second) if (a := self.code.planes[i].axis)}
            ratio = self._gain(tried, order, axes)
            if ratio > max(gain, _required_gain(first, second)):
                best, gain, swapped = tried, ratio, (first, second)
        if best is None:
            return
        names = sorted(self.names[p] for i in swapped if (p := order[i]) is not None)
        order[:] = best
        self.notes.append(f"{' and '.join(names)}: in each other's place (wrong order); exchanged")

    def judge(self, order: Order) -> None:
        """Check that the set shows this code at all."""
        score = {axis: self._score.along(order, axis) for axis in AXES}
        worst = min(score, key=lambda axis: score[axis])
        width, height = self.code.size
        what = (
            f"{score[worst]:.0%} of the lit pixels agree with the code {self.code.name} of a "
            f"{width}x{height} projector along {worst}; check code and size, and that no more than two "
            "pictures are in a wrong place"
        )
        # waves of a wrong shift still decode, to a wrong place; stripes out of focus decode or do not
        waves = any(self.code.planes[i].kind == "sine" for i in self.code.planes_of(worst))
        if score[worst] < (UNCERTAIN if waves else HOPELESS):
            raise InputError(f"pictures: only {what}")
        if score[worst] < UNCERTAIN:
            self.notes.append(f"only {what}")

    def _candidates(self, order: Order) -> list[tuple[int, int]]:
        """Pairs of planes that may be exchanged."""
        shown = {
            axis: [i for i in self.code.planes_of(axis) if order[i] is not None] for axis in AXES
        }
        pairs = [
            pair
            for axis in AXES
            for pair in combinations(shown[axis], 2)
            if self._may_gain(order, axis, *pair)
        ]
        pairs += [(i, j) for i in shown["x"][-1:] for j in shown["y"][:1]]
        if all(self._score.along(order, axis) < POOR for axis in AXES):
            pairs += [(i, j) for i in shown["x"] for j in shown["y"]]
        return pairs

    def _may_gain(self, order: Order, axis: Axis, first: int, second: int) -> bool:
        """Whether an exchange along an axis could gain enough, if it scored 1."""
        now = self._score.along(order, axis)
        return (1 + SLACK) > _required_gain(first, second) * (now + SLACK)

    def _gain(self, tried: Order, order: Order, axes: Set[Axis]) -> float:
        """By which factor an order scores better than another, over the axes that differ.

        The product over the axes, or the smaller one if an axis loses.
        """
        ratios = [
            (self._score.along(tried, axis) + SLACK) / (self._score.along(order, axis) + SLACK)
            for axis in axes
        ]
        return prod(ratios) if min(ratios) > NEARLY else min(ratios)

    def _ordered(self, sequence: Sequence[int], shown: Sequence[int | None]) -> Order:
        order: Order = [None] * len(self.code.planes)
        for plane, photo in zip(sequence, shown, strict=True):
            order[plane] = photo
        return order

    def _without_double(self, sequence: Sequence[int], shown: Order) -> Order:
        """Leave out one photograph too many: of the repeated ones, that whose absence scores best."""
        doubles = [i for i in range(1, len(shown)) if self.photos.repeats(i)]
        if not doubles:
            raise InputError(
                f"pictures: there are {len(shown)}, one more than the code has, and none repeats the "
                "one before; take the one out that does not belong"
            )
        orders = {i: self._ordered(sequence, shown[:i] + shown[i + 1 :]) for i in doubles}
        double = max(doubles, key=lambda i: self._score.of(orders[i]))
        self.notes.append(
            f"{self.names[double]}: doubled, it shows what {self.names[double - 1]} shows; left out"
        )
        return orders[double]

    def _with_gaps(self, sequence: Sequence[int], shown: Order) -> Order:
        """Leave the planes of missing photographs empty.

        One is looked for at every place, and its absence that scores best is taken; where several score
        alike, as for the first and last of equal steps, the numbers in the names decide. Several are where
        the numbers skip.
        """
        missing = len(sequence) - len(shown)
        named = skipped_numbers(self.names, missing)
        single: list[tuple[int, ...]] = [(gap,) for gap in range(len(sequence))]
        tried = single if missing == 1 else [named or ()]
        orders = [self._ordered(sequence, spread(shown, gaps)) for gaps in tried]
        scores = np.array([self._score.of(order) for order in orders])
        likely = [tried[i] for i in np.flatnonzero(scores >= NEARLY * scores.max())]
        if len(likely) > 1 and named not in likely:
            each = " or ".join(str(self.code.planes[sequence[gap]]) for (gap,) in likely)
            with self.overruled():
                raise InputError(
                    f"pictures: one is missing, {each}, and the others fit either way; number the "
                    "files as the pictures are, so that the gap shows, or photograph it again"
                )
        gaps = named if named in likely and named is not None else likely[0]
        planes = [self.code.planes[sequence[gap]] for gap in gaps]
        self.notes += missing_notes(self.names, gaps, planes)
        return orders[tried.index(gaps)]


def _required_gain(first: int, second: int) -> float:
    """Factor by which the exchange of two planes must score better to be accepted."""
    return NEIGHBOUR_GAIN if second == first + 1 else EXCHANGE_GAIN
