"""Analyses the answers of a preference test: what they show, and what they cannot show."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from procam.arrays import Array
from studies.preference.answers import Answer
from studies.preference.attention import attention_notes, catch_trials
from studies.preference.plan import Pair, Plan
from studies.preference.statistics import Preference, holm, observers_needed, preference

SHARES = (0.55, 0.60, 0.75)  # whose observers needed are stated beside those of the share found
FEW = 5  # observers, below which the t-test rests on its assumption alone


@dataclass(frozen=True, slots=True)
class Compared:
    """What was answered about a pair of methods, or about it on one content.

    `found` is the preference for the first of the pair.
    """

    pair: Pair
    choices: int
    found: Preference


@dataclass(frozen=True, slots=True)
class PairResult:
    """A pair of methods.

    Attributes
    ----------
    all : on all content. p_together : its p-value corrected for the number of pairs (Holm).
    contents : by content, which is description: its p-values are not corrected.
    needed_for_found : observers for 80 % probability to find, at 5 %, the share that was found.
    needed : the same for other shares, by share.
    """

    all: Compared
    p_together: float
    contents: Mapping[str, Compared]
    needed_for_found: int | None
    needed: Mapping[float, int | None]


@dataclass(frozen=True, slots=True)
class Analysis:
    """What was found.

    Attributes
    ----------
    observers : how many people. choices : of theirs, without catch trials.
    pairs : of methods that somebody compared. caught, catch_trials : how many failed, and how many were
        answered. notes : about observers and about the test, for people.
    """

    observers: int
    choices: int
    pairs: list[PairResult]
    caught: int
    catch_trials: int
    notes: list[str]


def analyse(plan: Plan, answers: Sequence[Answer]) -> Analysis:
    """Analyse the answers to a plan."""
    asked = [answer for answer in answers if not answer.question.catch]
    compared = [found for pair in plan.pairs if (found := _compared(plan, pair, asked))]
    together = holm([found.found.p_value for found in compared])
    pairs = [
        PairResult(
            found,
            p_together,
            {
                content.name: on_content
                for content in plan.contents
                if (on_content := _compared(plan, found.pair, _of_content(asked, content.name)))
            },
            observers_needed(found.found.share, found.found.sigma),
            {share: observers_needed(share, found.found.sigma) for share in SHARES},
        )
        for found, p_together in zip(compared, together, strict=True)
    ]
    people = list(dict.fromkeys(answer.observer for answer in answers))
    failed, trials = catch_trials(plan, answers)
    notes = [*attention_notes(plan, answers), *_notes(plan, pairs, len(people))]
    return Analysis(len(people), len(asked), pairs, len(failed), trials, notes)


def _of_content(answers: Sequence[Answer], name: str) -> list[Answer]:
    return [answer for answer in answers if answer.question.content == name]


def _compared(plan: Plan, pair: Pair, answers: Sequence[Answer]) -> Compared | None:
    """The comparison of a pair; None without answers."""
    own = [answer for answer in answers if plan.pair_of(answer.question) == pair]
    if not own:
        return None
    return Compared(pair, len(own), preference(_shares(plan, pair[0], own)))


def _shares(plan: Plan, method: str, answers: Sequence[Answer]) -> Array:
    """Share (N,) of each observer's own choices that preferred a method."""
    chose = dict[str, list[bool]]()
    for answer in answers:
        preferred = plan.pictures[answer.chosen].method == method
        chose.setdefault(answer.observer, []).append(preferred)
    return np.array([np.mean(each) for each in chose.values()])


def _notes(plan: Plan, pairs: Sequence[PairResult], observers: int) -> Iterator[str]:
    """About the test, not about one observer."""
    if observers < FEW:
        people = "1 observer" if observers == 1 else f"{observers} observers"
        yield f"{people}: too few to conclude anything about other people; ask more"
    seen = {result.all.pair for result in pairs}
    for first, second in plan.pairs:
        if (first, second) not in seen:
            yield f"{first} against {second}: nobody has answered"
    if len(plan.contents) == 1:
        yield "one content: what holds for it need not hold for other pictures"


def as_document(analysis: Analysis) -> dict[str, Any]:
    """The analysis as JSON; null where there is no number."""
    return {
        "observers": analysis.observers,
        "choices": analysis.choices,
        "pairs": [_pair_document(result) for result in analysis.pairs],
        "catch_trials": {"answered": analysis.catch_trials, "failed": analysis.caught},
        "notes": analysis.notes,
    }


def _pair_document(result: PairResult) -> dict[str, Any]:
    return {
        **_compared_document(result.all),
        "p_value_together": _plain(result.p_together),
        "contents": {name: _compared_document(c) for name, c in result.contents.items()},
        "observers_needed": {
            "found": result.needed_for_found,
            **{f"{share:.2f}": count for share, count in result.needed.items()},
        },
    }


def _compared_document(compared: Compared) -> dict[str, Any]:
    found, (first, second) = compared.found, compared.pair
    values = {
        "share": found.share,
        "share_low": found.low,
        "share_high": found.high,
        "sigma": found.sigma,
        "p_value": found.p_value,
        "sign_test_p_value": found.sign_p,
        "jod": found.jod,
        "jod_low": found.jod_low,
        "jod_high": found.jod_high,
    }
    return {
        "first": first,
        "second": second,
        "observers": found.observers,
        "choices": compared.choices,
        "prefer_first": found.first,
        "prefer_second": found.second,
        **{name: _plain(value) for name, value in values.items()},
    }


def _plain(value: float) -> float | None:
    """JSON has neither NaN nor infinity."""
    return value if np.isfinite(value) else None
