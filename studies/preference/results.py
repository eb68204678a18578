"""Prints what people answered on the page that `ask` has written."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from studies.preference.analysis import (
    Compared,
    PairResult,
    analyse,
    as_document,
)
from studies.preference.answers import read_answers
from studies.preference.plan import read_plan
from studies.preference.statistics import Preference

SIGNIFICANT, LEAST = 0.05, 0.001  # p-values: of a finding, and below which none is printed


def answers(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder that `ask` wrote.")],
    csv: Annotated[
        list[Path], typer.Argument(metavar="CSV...", help="Answers; or folders of them.")
    ],
    *,
    json: Json = False,
) -> None:
    """Analyse what people answered: which method they prefer, how sure that is.

    People are the sample, not their choices: intervals and p-values are over observers.
    """
    output = Output(json)
    plan = read_plan(out)
    analysis = analyse(plan, read_answers(plan, csv))
    tested = sum(math.isfinite(result.p_together) for result in analysis.pairs)
    for result in analysis.pairs:
        for line in _lines(result, tested):
            output.say(line)
    if analysis.catch_trials:
        output.say(f"catch trials: {analysis.caught} of {analysis.catch_trials} failed")
    for note in analysis.notes:
        output.say(f"note: {note}")
    output.finish({"out": str(out), "plan": plan.id, **as_document(analysis)})


def _lines(result: PairResult, tested: int) -> Iterator[str]:
    """A pair of methods in words; the method that was preferred more often comes first."""
    found, (ours, other) = result.all.found, result.all.pair
    turned = found.share < 0.5
    if turned:
        found, ours, other = found.reversed, other, ours
    people = _count(found.observers, "observer")
    yield f"{people}, {_count(result.all.choices, 'choice')}: {_finding(found, ours, other, result, tested)}"
    alike = found.observers - found.first - found.second
    yield (
        f"  {found.first} observers prefer {ours}, {found.second} {other}, {alike} neither: sign test "
        f"{_p(found.sign_p)}"
    )
    if math.isfinite(found.p_value):
        yield f"  distance {_jod(found.jod)} ({_jod(found.jod_low)} .. {_jod(found.jod_high)}) JOD"
    yield from _power_line(result, found.share)
    yield from _table(result, ours, turned)


def _finding(found: Preference, ours: str, other: str, result: PairResult, tested: int) -> str:
    """What was found, and no more than that."""
    share = _percent(found.share)
    if not math.isfinite(found.p_value):
        why = (
            "one person is no sample of others"
            if found.observers == 1
            else "observers do not differ, so there is no spread to judge by"
        )
        return f"{ours} chosen over {other} in {share}; no interval, because {why}"
    interval, p_value = f"(95 %: {_interval(found)} %)", _p(found.p_value)
    if tested > 1:
        p_value += f", {_p(result.p_together)} with all {tested} pairs counted"
    if result.p_together < SIGNIFICANT:
        return f"{ours} preferred over {other} in {share} {interval}, {p_value}"
    return f"no preference found between {ours} and {other}: {ours} chosen in {share} {interval}, {p_value}"


def _power_line(result: PairResult, share: float) -> Iterator[str]:
    wanted = [(share, result.needed_for_found), *result.needed.items()]
    if any(count for _, count in wanted):
        counts = ", ".join(
            f"{count or 'no number'} at {_percent(value)}" for value, count in wanted
        )
        yield f"  observers for an 80 % chance to find it, if they differ as these do: {counts}"


def _table(result: PairResult, ours: str, turned: bool) -> Iterator[str]:
    """By content, for the same method as the line above."""
    width = max(map(len, ("content", *result.contents)))
    yield f"  {'content':{width}}  observers  choices  {ours:>13}  {'95 %':>10}  p"
    for name, compared in result.contents.items():
        yield f"  {name:{width}}  {_row(compared, turned)}"


def _row(compared: Compared, turned: bool) -> str:
    found = compared.found.reversed if turned else compared.found
    known = math.isfinite(found.p_value)
    interval, p_value = (_interval(found), _small(found.p_value)) if known else ("-", "-")
    share = _percent(found.share)
    return f"{found.observers:9}  {compared.choices:7}  {share:>13}  {interval:>10}  {p_value}"


def _interval(found: Preference) -> str:
    return f"{100 * found.low:.0f}..{100 * found.high:.0f}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _p(value: float) -> str:
    """A p-value with its relation, as papers write it."""
    return f"p {_small(value)}" if value < LEAST else f"p = {_small(value)}"


def _small(value: float) -> str:
    return "< 0.001" if value < LEAST else f"{value:.2g}"


def _jod(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "beyond measure"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
