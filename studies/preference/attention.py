"""Signs that an observer did not look, or that answers are missing. No observer is left out for them."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from scipy.stats import binomtest

from studies.preference.answers import Answer
from studies.preference.plan import Plan

ONE_SIDED, UNLIKELY = 0.8, 0.01  # share of choices of one side, and p-value of it by chance
HASTY_MS = 500.0  # median; to see both pictures takes longer
FEWEST_REPEATED = 4  # comparisons with an own earlier answer, below which chance says nothing


def attention_notes(plan: Plan, answers: Sequence[Answer]) -> Iterator[str]:
    """A line for each sign, by observer."""
    for observer in dict.fromkeys(answer.observer for answer in answers):
        own = [answer for answer in answers if answer.observer == observer]
        for words in (*_side(own), *_haste(own), *_caught(plan, own), *_repeated(own)):
            yield f"observer {observer}: {words}"
        if len(own) < plan.trials:
            yield f"observer {observer}: {len(own)} of {plan.trials} answers; the others are missing"


def catch_trials(plan: Plan, answers: Sequence[Answer]) -> tuple[list[Answer], int]:
    """Failed catch trials, and how many were answered."""
    caught = [answer for answer in answers if answer.question.catch]
    expected = plan.catch[0] if plan.catch else ""
    return [a for a in caught if plan.pictures[a.chosen].method != expected], len(caught)


def _side(own: Sequence[Answer]) -> Iterator[str]:
    """The same side in most choices, and more often than by chance."""
    first = sum(answer.chosen == answer.first for answer in own)
    for side, count in (("first", first), ("second", len(own) - first)):
        often = count >= ONE_SIDED * len(own)
        if often and binomtest(count, len(own)).pvalue < UNLIKELY:
            yield f"chose the picture shown {side} in {count} of {len(own)} trials"


def _haste(own: Sequence[Answer]) -> Iterator[str]:
    median = float(np.median([answer.time_ms for answer in own]))
    if median < HASTY_MS:
        yield f"chose within {median:.0f} ms (median), too soon to compare"


def _caught(plan: Plan, own: Sequence[Answer]) -> Iterator[str]:
    failed, trials = catch_trials(plan, own)
    if failed and plan.catch:
        expected, other = plan.catch
        yield f"preferred {other} to {expected} in {len(failed)} of {trials} catch trials"


def _repeated(own: Sequence[Answer]) -> Iterator[str]:
    """Answers to the same question that agree no more often than those of a coin, in half of all pairs."""
    chosen = dict[tuple[str, ...], list[str]]()
    for answer in own:
        chosen.setdefault(answer.question.pictures, []).append(answer.chosen)
    agrees = [a == b for each in chosen.values() for a, b in combinations(each, 2)]
    if len(agrees) >= FEWEST_REPEATED and sum(agrees) <= len(agrees) / 2:
        yield (
            f"gave the same answer again in {sum(agrees)} of {len(agrees)} repeats, no more than a coin "
            "would (nor would someone without a preference)"
        )
