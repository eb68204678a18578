"""The probable cause of the difference between two calibrations of a rig, in words.

The common rotation is the one under which most projectors agree within their standard errors.
Projectors that then disagree either share one smooth field (a lens), moved rigidly, or changed
otherwise. Each explanation is accepted only if it removes most of the difference's variance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from procam.arrays import Array, Array32
from procam.errors import NotEnoughData
from procam.estimate.comparison.common_pixels import (
    CommonPixels,
    common_pixels,
    error_over_sigma,
    own_motion,
    rms_arcmin,
    smooth_field,
    turn_between,
)
from procam.maths.geometry.pose import rotation_vector
from procam.maths.geometry.sphere import ARCMIN
from procam.model.calibration import Calibration
from procam.model.photometry import Departure

Kind = Literal["agree", "turned", "light", "moved", "changed", "lens", "exchanged", "differ"]
AGREE = 2.0  # error over sigma: a pose has six freedoms, so that one in 1000 exceeds it by chance
LIGHT_SIGMAS = 5.0  # of feedback or albedo: six figures with sigmas that are estimates themselves
EXPLAINED = 0.9  # share of the variance that an explanation must remove
MOST_PICTURE = 0.02  # relative: a seam of half of it shows; two captures differ by a tenth of it
MOST_LEVEL = 0.03
MOST_LOST = 0.02  # of the pixels of a projector that send light
CLEARER = 0.5  # ratio of remainders: a field has more coefficients than motions have
CLOSE = np.radians(1.0)  # a mount slips by less, two projectors are mounted further apart
CLEARLY = 0.1  # share to which exchanged names must reduce the difference
MATCH_PIXELS = 200  # of each projector: enough, as other projectors are tens of degrees away


@dataclass(frozen=True, slots=True)
class Verdict:
    """The probable cause of a difference.

    Attributes
    ----------
    kind : class of the cause. text : a sentence. projectors : those concerned.
    """

    kind: Kind
    text: str
    projectors: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether the directions agree up to a rotation of the whole rig."""
        return self.kind in ("agree", "turned")


@dataclass(frozen=True, slots=True)
class PictureStep:
    """How a uniform picture by B's frames differs from that by A's, both by A's model.

    `level` : its light over A's. `rms` : of the relative difference beside that. `share_lit` : share of each
    projector's pixels that send light, by A and by B.
    """

    level: float
    rms: float
    share_lit: Mapping[str, tuple[float, float]]

    @property
    def is_same(self) -> bool:
        """Whether nobody sees the difference; white is that of the dimmest place, and so less certain."""
        return self.rms <= MOST_PICTURE and abs(self.level - 1) <= MOST_LEVEL


SAME = Verdict(
    "agree",
    "the directions are the same to the last bit; those of two captures would differ by noise",
)


def judge_difference(
    pairs: Mapping[str, CommonPixels], cameras: Sequence[str]
) -> tuple[Verdict, Array]:
    """The verdict on thinned pairs by projector, and the rotation (3, 3) of the rig from B to A.

    Projectors that moved do not enter the rotation. `cameras`: names of the cameras of A and B.
    """
    if all(np.array_equal(pair.first, pair.second) for pair in pairs.values()):
        return SAME, np.eye(3)
    turn, kept, as_is = _common_turn(pairs)
    steps = {name: pair.step(turn) for name, pair in pairs.items()}
    others = [name for name in pairs if name not in kept]
    if not others:
        return _sound(as_is, turn), turn
    if _one_smooth_field(pairs, steps):
        return _lens(steps, cameras), turn
    return _moved(pairs, steps, others), turn


def find_exchanged(first: Calibration, second: Calibration) -> dict[str, str]:
    """B's name of each of A's projectors, where the names differ; empty if the names are right.

    The rig may be rotated as well: every rotation that maps one projector to another is tried, and
    the smallest of those that explain all projectors is taken.
    """
    pairs = _all_pairs(first, second)
    names = list(first.projectors)
    turns = [np.eye(3), *(turn_between([pair]) for pair in pairs.values())]
    found = [_assigned(pairs, names, turn) for turn in turns]
    sizes = [np.linalg.norm(rotation_vector(turn)) for turn in turns]
    best = min(range(len(turns)), key=lambda i: (max(found[i][0], CLOSE), sizes[i]))
    rms, partners = found[best]
    as_named = float(np.sqrt(np.mean([_mean_square(pairs[n, n], np.eye(3)) for n in names])))
    if rms > CLEARLY * as_named:
        return {}
    return {name: names[j] for name, j in zip(names, partners, strict=True) if name != names[j]}


def exchanged(partners: Mapping[str, str]) -> Verdict:
    """The verdict on projectors with exchanged names."""
    each = ", ".join(f"A's {here} is B's {there}" for here, there in partners.items())
    return Verdict("exchanged", f"{each}: wrong projector on the wire", tuple(partners))


def judge_light(directions: Verdict, sigmas: Mapping[str, Sequence[float]]) -> Verdict:
    """The verdict on the light, if it differs and the directions agree; else `directions`.

    `sigmas`: per figure of the light, B - A over its standard error, by channel.
    """
    worst = {name: max(map(abs, each)) for name, each in sigmas.items()}
    names = [name for name, most in worst.items() if most > LIGHT_SIGMAS]
    if not names or not directions.sound:
        return directions
    each = " and ".join(f"{name} by {worst[name]:.3g} standard errors" for name in names)
    return Verdict(
        "light",
        f"the light differs, {each}: check whether the screen was painted or cleaned, a surface "
        "covered, or the camera's response, black level or glare changed. Directions: "
        f"{directions.text}",
    )


def judge_responses(verdict: Verdict, steps: Mapping[str, Departure]) -> Verdict:
    """The verdict with the projectors whose response differs, whatever else does; a cause of its own."""
    changed = {name: step for name, step in steps.items() if step.excess > 1}
    if not changed:
        return verdict
    each = ", ".join(f"projector {name}: {step.text}" for name, step in changed.items())
    text = f"responses differ, {each}: check signal range (HDMI range), gamma and picture mode"
    if verdict.sound:
        return Verdict("light", f"{text}. Directions: {verdict.text}", tuple(changed))
    return replace(verdict, text=f"{verdict.text}. Also, {text}")


def judge_picture(verdict: Verdict, step: PictureStep | None) -> Verdict:
    """The verdict if the frames make another picture though the directions agree; else `verdict`."""
    if step is None or step.is_same or not verdict.sound:
        return verdict
    lost = {n: pair for n, pair in step.share_lit.items() if pair[1] < (1 - MOST_LOST) * pair[0]}
    each = [
        f"; {n} sends light from {b:.0%} of its pixels, {a:.0%} in A" for n, (a, b) in lost.items()
    ]
    return Verdict(
        "light",
        f"the frames differ: a uniform picture by B's has {step.level:.1%} of the light of that by A's, and "
        f"is {step.rms:.1%} off beside that{''.join(each)}. "
        "If neither lamps nor settings were changed, one of them is wrong: calibrate again. Directions: "
        f"{verdict.text}",
        tuple(lost),
    )


def _common_turn(pairs: Mapping[str, CommonPixels]) -> tuple[Array, list[str], bool]:
    """The rotation under which most projectors agree, these projectors, and whether it is none.

    A majority must agree to conclude that the others moved; without any rotation, where fiducials
    fix the rig, half of them suffice. Otherwise no projector counts as agreeing.
    """
    each = [turn_between([pair]) for pair in pairs.values()]
    turns = [np.eye(3), turn_between(pairs.values()), *each]
    agreeing = [[n for n, p in pairs.items() if _ratio(p, p.step(turn)) <= AGREE] for turn in turns]
    best = max(range(len(turns)), key=lambda i: len(agreeing[i]))
    kept, as_is = agreeing[best], best == 0
    if 2 * len(kept) <= len(pairs) - as_is:
        return turns[1], [], False
    return turn_between([pairs[name] for name in kept]), kept, as_is


def _sound(as_is: bool, turn: Array) -> Verdict:
    if as_is:
        return Verdict("agree", "the calibrations agree within their error bars")
    size = ARCMIN * np.linalg.norm(rotation_vector(turn))
    return Verdict(
        "turned",
        f"a rotation of the whole rig by {size:.3g} arcmin and nothing else: fiducials or camera were "
        "set anew, or nothing fixes the rig in space",
    )


def _one_smooth_field(pairs: Mapping[str, CommonPixels], steps: Mapping[str, Array]) -> bool:
    """Whether one smooth field explains all projectors, and better than a motion of each does."""
    step, variance = _joined(pairs, steps)
    direction = np.concatenate([pair.first for pair in pairs.values()])
    remainder = error_over_sigma(step - smooth_field(direction, step, variance), variance)
    moved = np.concatenate([steps[n] - own_motion(pair, steps[n]) for n, pair in pairs.items()])
    explains = remainder**2 <= (1 - EXPLAINED) * error_over_sigma(step, variance) ** 2
    return explains and remainder < CLEARER * error_over_sigma(moved, variance)


def _lens(steps: Mapping[str, Array], cameras: Sequence[str]) -> Verdict:
    which = f"camera {cameras[0]}" if len(cameras) == 1 else f"a camera ({', '.join(cameras)})"
    where = "in all projectors alike" if len(steps) > 1 else "in the only projector"
    other = "the dome's shape" if len(steps) > 1 else "the projector's zoom or lens shift"
    return Verdict(
        "lens",
        f"the lens model of {which} may be wrong, or {other} changed: a smooth difference of "
        f"{rms_arcmin(*steps.values()):.3g} arcmin {where}",
        tuple(steps),
    )


def _moved(
    pairs: Mapping[str, CommonPixels], steps: Mapping[str, Array], names: list[str]
) -> Verdict:
    """The verdict on projectors that differ independently of each other."""
    rest = {n: _ratio(pairs[n], steps[n] - own_motion(pairs[n], steps[n])) for n in names}
    rigid = [rest[n] ** 2 <= (1 - EXPLAINED) * _ratio(pairs[n], steps[n]) ** 2 for n in names]
    each = ", ".join(f"{n} by {rms_arcmin(steps[n]):.3g}" for n in names) + " arcmin"
    if all(rigid):
        manner = "moved" if len(names) < len(pairs) or len(pairs) == 1 else "moved, each on its own"
        return Verdict("moved", f"{_called(names)} {manner}: {each}", tuple(names))
    if len(names) < len(pairs):
        return Verdict(
            "changed",
            f"{_called(names)} changed by more than a motion: {each}; check zoom, lens shift, focus "
            "and keystone",
            tuple(names),
        )
    return Verdict(
        "differ",
        f"the calibrations differ by more than their error bars: {each}; no rotation, no motion of "
        "projectors and no smooth field explains it",
        tuple(names),
    )


def _called(names: Sequence[str]) -> str:
    return f"projector{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _all_pairs(first: Calibration, second: Calibration) -> dict[tuple[str, str], CommonPixels]:
    """Each of A's projectors with each of B's that has its size and lights some of its pixels."""
    pairs = {}
    for a, here in first.projectors.items():
        for b, there in second.projectors.items():
            if here.model.size == there.model.size:
                try:
                    both = common_pixels(a, here, there, first.screen.shape.radius_m)
                except NotEnoughData:
                    continue  # they are different projectors
                pairs[a, b] = both.thinned(MATCH_PIXELS)
    return pairs


def _assigned(
    pairs: Mapping[tuple[str, str], CommonPixels], names: Sequence[str], turn: Array
) -> tuple[float, list[int]]:
    """The rms [rad] of the best assignment of B's projectors to A's under a rotation, and their indices."""
    cost = np.full((len(names), len(names)), np.pi**2)
    for (a, b), both in pairs.items():
        cost[names.index(a), names.index(b)] = _mean_square(both, turn)
    rows, columns = linear_sum_assignment(cost)
    return float(np.sqrt(cost[rows, columns].mean())), [int(j) for j in columns]


def _mean_square(pair: CommonPixels, turn: Array) -> float:
    return float(np.mean(np.sum(pair.step(turn) ** 2, axis=1)))


def _ratio(pair: CommonPixels, step: Array) -> float:
    return error_over_sigma(step, pair.variance)


def _joined(pairs: Mapping[str, CommonPixels], steps: Mapping[str, Array]) -> tuple[Array, Array32]:
    """Differences (N, 3) and variances (N,) of all projectors."""
    variance = np.concatenate([pair.variance for pair in pairs.values()])
    return np.concatenate([steps[name] for name in pairs]), variance
