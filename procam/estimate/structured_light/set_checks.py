"""Which photograph is which plane of a code, and what is wrong with the set."""

import re
from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import prod

import numpy as np

from procam.errors import InputError
from procam.estimate.structured_light.codes import AXES, Axis, Code
from procam.estimate.structured_light.consistency import Order, OrderConsistency, Samples
from procam.estimate.structured_light.limits import full_scale

POOR = 0.5  # share of straight triples below which also the other axis is searched
BETTER = 1.15  # an exchange must do this much better than the order as it is
NEXT_BETTER = 1.02  # of neighbours, which is more likely, and hardly shows in a coarse pair
STALE_GAIN = 1.04  # leaving a stale picture out does this much better; a good one, at most 1.01
WORSE = 0.9  # of the better axis: here something is wrong, even if no picture can be spared
SLACK = 0.02  # of the triples: against division by nothing, and gains among noise
HOPELESS, DOUBTFUL = 0.02, 0.25  # sound share of lit triples; defocus costs stripes much of it
CLEARLY = 0.97  # of the best: what does nearly as well cannot be ruled out
ALIKE = 0.04  # of white - black: two photographs of one picture differ by less
BLACK_SHARE = 0.2  # of the light a picture should have
FAINTEST_SHARE = 0.15  # of white's: what falls beside the screen may be all of less
MOST_LIT = 0.4  # of the pictures have light, whatever part of the panel is seen
CLIPPED_SHARE = 0.05
BEYOND, MOST_BEYOND = 0.3, 0.1  # of a pixel's reach, and share of the pixels


@dataclass
class SetReport:
    """What a set of photographs turned out to be.

    Attributes
    ----------
    order : per plane of the code, the photograph that shows it; None where there is none.
    notes : faults that were worked round, one line each, by the photographs' names.
    """

    order: Order
    notes: list[str] = field(default_factory=list)


def examine(
    code: Code, sequence: Sequence[int], probes: Sequence[Samples], names: Sequence[str]
) -> SetReport:
    """Match photographs with the planes of `code`.

    Parameters
    ----------
    sequence : planes in the order they should have been photographed.
    probes : samples (n, 3) of the photographs in the order they are in. names : what to call them.
    """
    inspector = _Inspector(code, probes, names)
    order = inspector.matched(sequence)
    inspector.check_levels(order)
    inspector.drop_black(order)
    inspector.drop_stale(order)
    inspector.exchange(order)
    inspector.judge(order)
    return SetReport(order, inspector.notes)


class _Inspector:
    def __init__(self, code: Code, probes: Sequence[Samples], names: Sequence[str]) -> None:
        self.code, self.names = code, names
        self.probes = [np.asarray(p, np.float32) for p in probes]
        self.top = full_scale(max(probes, key=np.mean)) if probes[0].dtype.kind == "u" else np.inf
        self.notes: list[str] = []
        stack = np.stack(self.probes[:: max(1, len(probes) // 16)])
        reach = stack.max(axis=0) - stack.min(axis=0)
        if not reach.max() > 0:
            raise InputError(
                f"pictures: got {len(probes)} that are all alike, level {stack.flat[0]:.0f}; is the "
                "lens cap off, the projector on, and the exposure neither far too short nor too long?"
            )
        self.lit = reach > 0.25 * reach.max()
        self.reach = float(reach[self.lit].mean())
        self._sound = OrderConsistency(code, self.probes)

    def matched(self, sequence: Sequence[int]) -> Order:
        """Photographs by plane, with one too many or one missing taken care of."""
        surplus = len(self.probes) - len(sequence)
        everything: Order = list(range(len(self.probes)))
        if surplus == 1:
            return self._without_double(sequence, everything)
        if surplus == -1:
            return self._with_gap(sequence, everything)
        if surplus:
            raise InputError(
                f"pictures: got {len(self.probes)}, expected {len(sequence)} for the code "
                f"{self.code.name} on {self.code.size[0]}x{self.code.size[1]} px"
            )
        return self._ordered(sequence, everything)

    def drop_stale(self, order: Order) -> None:
        """Pictures that show what the one before showed, and spoil what the set tells."""
        for plane, photograph in enumerate(order):
            axis = self.code.planes[plane].axis
            if axis == "" or photograph is None or not self._alike(photograph):
                continue
            without = [None if i == plane else p for i, p in enumerate(order)]
            gain = self._better(without, order, {axis})
            others = max(self._sound.along(order, name) for name in AXES)
            worse = self._sound.along(order, axis) < max(POOR, WORSE * others)
            if gain > STALE_GAIN or (gain < 1 and worse):
                order[plane] = None
                before = self.names[photograph - 1]
                self.notes.append(
                    f"{self.names[photograph]}: stale, it shows what {before} shows; left out"
                )

    def check_levels(self, order: Order) -> None:
        """White and black must be there and be what they say; clipped whites are told."""
        white, black = order[0], order[1]
        if white is None or black is None:
            lacking = "white" if white is None else "black"
            raise InputError(
                f"pictures: the {lacking} one is missing, and without it nothing tells lit from "
                "unlit; photograph it again"
            )
        if self.probes[white].mean() < self.probes[black].mean():
            order[0], order[1] = white, black = black, white
            self.notes.append(
                f"{self.names[black]} and {self.names[white]}: white and black in each other's "
                "place (wrong order); exchanged"
            )
        self._check_extremes(white, black)
        light = np.array([p.mean() for p in self.probes]) - self.probes[black].mean()
        between = light[light > 0.2 * light[white]]
        share = float(np.median(between) / max(light[white], 1e-9)) if between.size else 0.0
        share *= between.size > MOST_LIT * light.size
        if not 0.3 < share < 0.8:
            raise InputError(
                f"pictures: {self.names[white]} should show white and {self.names[black]} black, but "
                f"the others have {share:.0%} of the light between, expected half; is one of the two "
                "stale, or the exposure automatic?"
            )
        self._tell_clipping(order)

    def _check_extremes(self, white: int, black: int) -> None:
        """Nothing is brighter than white, or darker than black."""
        stack = np.stack(self.probes)
        low, high = stack.min(axis=0)[self.lit], stack.max(axis=0)[self.lit]
        beyond = BEYOND * (high - low)
        for photograph, what, more, past in (
            (white, "white", "brighter", high - self.probes[white][self.lit] > beyond),
            (black, "black", "darker", self.probes[black][self.lit] - low > beyond),
        ):
            if past.mean() > MOST_BEYOND:
                raise InputError(
                    f"pictures: {self.names[photograph]} should show {what}, but {past.mean():.0%} of "
                    f"the lit pixels are {more} in others; is it stale, or the exposure automatic?"
                )

    def _tell_clipping(self, order: Order) -> None:
        level = self._probe(order, 0)
        span = level - self._probe(order, 1)
        lit = span > 0.25 * span.max()
        clipped = float((level[lit] >= self.top).mean())
        if clipped > CLIPPED_SHARE:
            self.notes.append(
                f"{self.names[order[0] or 0]}: white is clipped in {clipped:.0%} of the lit pixels; "
                "expose shorter"
            )

    def drop_black(self, order: Order) -> None:
        """Pictures without light, unless the inverse has it all: the camera may see half a panel."""
        white, black = self._probe(order, 0).mean(), self._probe(order, 1).mean()
        shown = [None if p is None else float(self.probes[p].mean()) for p in order]
        for number, photograph in enumerate(order):
            plane = self.code.planes[number]
            if plane.axis == "" or photograph is None:
                continue
            expected = float(self.code.axis(plane.axis).line(plane).mean())
            light = (self.probes[photograph].mean() - black) / (white - black)
            faint = BLACK_SHARE * expected
            inverse = self._inverse_of(number)
            other = None if inverse is None else shown[inverse]
            if other is not None and light + (other - black) / (white - black) > 1 - faint:
                continue
            if expected > FAINTEST_SHARE and light < faint:
                self.notes.append(f"{self.names[photograph]}: black, expected {plane}; left out")
                order[number] = None

    def exchange(self, order: Order) -> None:
        """Two pictures in each other's place are put right."""
        shown = {
            axis: [i for i in self.code.planes_of(axis) if order[i] is not None] for axis in AXES
        }
        candidates = [
            pair
            for axis in AXES
            for pair in combinations(shown[axis], 2)
            if self._may(order, axis, *pair)
        ]
        candidates += [(i, j) for i in shown["x"][-1:] for j in shown["y"][:1]]
        if all(self._sound.along(order, axis) < POOR for axis in AXES):
            candidates += [(i, j) for i in shown["x"] for j in shown["y"]]
        best, gain, swapped = None, 1.0, (0, 0)
        for first, second in candidates:
            tried = list(order)
            tried[first], tried[second] = order[second], order[first]
            axes = {a for i in (first, second) if (a := self.code.planes[i].axis)}
            ratio = self._better(tried, order, axes)
            if ratio > max(gain, _enough(first, second)):
                best, gain, swapped = tried, ratio, (first, second)
        if best is None:
            return
        names = sorted(self.names[p] for i in swapped if (p := order[i]) is not None)
        order[:] = best
        self.notes.append(f"{' and '.join(names)}: in each other's place (wrong order); exchanged")

    def judge(self, order: Order) -> None:
        """Whether the set is one of this code at all."""
        sound = {axis: self._sound.along(order, axis) for axis in AXES}
        worst = min(sound, key=lambda axis: sound[axis])
        width, height = self.code.size
        what = (
            f"{sound[worst]:.0%} of the lit pixels agree with the code {self.code.name} of a "
            f"{width}x{height} projector along {worst}; are code and size right, and not more than two "
            "pictures in a wrong place?"
        )
        if sound[worst] < HOPELESS:
            raise InputError(f"pictures: only {what}")
        if sound[worst] < DOUBTFUL:
            self.notes.append(f"only {what}")

    def _may(self, order: Order, axis: Axis, first: int, second: int) -> bool:
        """Whether an axis has enough to gain by the exchange of two of its planes."""
        now = self._sound.along(order, axis)
        return (1 + SLACK) > _enough(first, second) * (now + SLACK)

    def _better(self, tried: Order, order: Order, axes: Set[Axis]) -> float:
        """How many times sounder an order is than another, in the axes that differ.

        All of them count, but none may lose.
        """
        ratios = [
            (self._sound.along(tried, axis) + SLACK) / (self._sound.along(order, axis) + SLACK)
            for axis in axes
        ]
        return prod(ratios) if min(ratios) > CLEARLY else min(ratios)

    def _ordered(self, sequence: Sequence[int], shown: Sequence[int | None]) -> Order:
        order: Order = [None] * len(self.code.planes)
        for plane, photograph in zip(sequence, shown, strict=True):
            order[plane] = photograph
        return order

    def _without_double(self, sequence: Sequence[int], shown: Order) -> Order:
        """One picture too many: of those like the one before, the one without which it decodes best."""
        doubles = [i for i in range(1, len(shown)) if self._alike(i)]
        if not doubles:
            raise InputError(
                f"pictures: got {len(shown)}, expected {len(sequence)}, and none doubles the one "
                "before; take the one out that does not belong"
            )
        orders = {i: self._ordered(sequence, shown[:i] + shown[i + 1 :]) for i in doubles}
        double = max(doubles, key=lambda i: self._sound.of(orders[i]))
        self.notes.append(
            f"{self.names[double]}: doubled, it shows what {self.names[double - 1]} shows; left out"
        )
        return orders[double]

    def _with_gap(self, sequence: Sequence[int], shown: Order) -> Order:
        """The place of one missing picture: where the set decodes best without it.

        Where that leaves a choice, as in equal steps without the first or the last, the numbers in
        the names decide.
        """
        orders = [
            self._ordered(sequence, [*shown[:gap], None, *shown[gap:]])
            for gap in range(len(sequence))
        ]
        scores = np.array([self._sound.of(order) for order in orders])
        likely = np.flatnonzero(scores >= CLEARLY * scores.max()).tolist()
        skipped = [gap for gap in likely if gap == _skipped(self.names)]
        if len(likely) > 1 and not skipped:
            lacking = " or ".join(str(self.code.planes[sequence[gap]]) for gap in likely)
            raise InputError(
                f"pictures: one is missing, {lacking}, and the others fit either way; number the "
                "files as the pictures are, so that the gap shows, or photograph it again"
            )
        gap = skipped[0] if skipped else likely[0]
        where = f"after {self.names[gap - 1]}" if gap else f"before {self.names[0]}"
        self.notes.append(f"missing: {self.code.planes[sequence[gap]]}, {where}; done without")
        return orders[gap]

    def _alike(self, i: int) -> bool:
        """Whether photograph i shows the same as the one before, as far as the sample tells."""
        if i == 0:
            return False
        return bool(
            np.abs(self.probes[i] - self.probes[i - 1])[self.lit].mean() < ALIKE * self.reach
        )

    def _inverse_of(self, number: int) -> int | None:
        """The plane whose bright stripes are the dark ones of plane `number`, if the code has it."""
        plane = self.code.planes[number]
        if plane.kind != "binary":
            return None
        inverse = replace(plane, inverse=not plane.inverse)
        return self.code.planes.index(inverse) if inverse in self.code.planes else None

    def _probe(self, order: Order, plane: int) -> Samples:
        photograph = order[plane]
        assert photograph is not None
        return self.probes[photograph]


def _enough(first: int, second: int) -> float:
    """How many times sounder a set must be with two planes exchanged, to believe it."""
    return NEXT_BETTER if second == first + 1 else BETTER


def _skipped(names: Sequence[str]) -> int | None:
    """Place of the one number that is left out in the last numbers of the names, if there is one."""
    found = [re.findall(r"\d+", name) for name in names]
    if not all(found):
        return None
    numbers = np.array([int(each[-1]) for each in found])
    jumps = np.flatnonzero(np.diff(numbers) == 2) + 1
    return int(jumps[0]) if len(jumps) == 1 and np.ptp(numbers) == len(names) else None
