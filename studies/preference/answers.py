"""Reads what people answered: the CSV files that the page of a preference test offers at its end."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from procam.errors import FileFormatError, InputError
from procam.files.csv_text import FORMULA, MARK
from studies.preference.plan import Plan, Question

COLUMNS = (
    "plan",
    "observer",
    "trial",
    "content",
    "first",
    "second",
    "chosen",
    "chosen_first",
    "milliseconds",
    "switches",
)
TRUE = ("1", "true")
AGAIN = "take the file as the page has written it"
Row = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Answer:
    """One choice.

    Attributes
    ----------
    observer : who. question : what was asked. chosen : file of the picture that was preferred.
    first : file of the picture that was shown first. time_ms : from the first picture to the choice.
    """

    observer: str
    question: Question
    chosen: str
    first: str
    time_ms: float


def read_answers(plan: Plan, paths: Sequence[Path]) -> list[Answer]:
    """The answers of files, and of the CSV files in folders.

    Raises
    ------
    FileFormatError
        A file that is missing, no table, of another plan, or names pictures that were not asked about.
    InputError
        One observer in two files, or no answers at all.
    """
    answers, where = list[Answer](), dict[str, Path]()
    for path in _files(paths):
        found = list(_answers(plan, path))
        if not found:
            raise InputError(f"{path}: no answers in it; take the file as the page has written it")
        for name in {answer.observer: None for answer in found}:
            observer = name.casefold()  # as the page takes names
            if observer in where:
                raise InputError(
                    f"observer {name!r} is in {where[observer]} and in {path}; remove one of the "
                    "files, or give one of the two people another name in it"
                )
            where[observer] = path
        answers += found
    if not answers:
        names = ", ".join(map(str, paths))
        raise InputError(
            f"{names}: no answers; give the answers-*.csv that the page offers at its end"
        )
    return answers


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if path.is_dir():
            yield from sorted(p for p in path.iterdir() if p.suffix.lower() == ".csv")
        elif path.is_file():
            yield path
        else:
            raise FileFormatError(
                f"{path}: no such file; give the answers-*.csv that the page offers at its end, or a "
                "folder of them"
            )


def _answers(plan: Plan, path: Path) -> Iterator[Answer]:
    """The answers of a file; refuses more of them to a question than the plan asks."""
    counts, trials = dict[tuple[str, tuple[str, ...]], int](), set[tuple[str, str]]()
    for where, row in _rows(path):
        answer = _answer(plan, where, row)
        trial = answer.observer, row["trial"]
        if trial in trials:
            raise FileFormatError(
                f"{where}: observer {answer.observer!r} has answered trial {row['trial']} already; are two "
                f"people's answers in one file? Give each a name of their own, or {AGAIN}"
            )
        trials.add(trial)
        asked = answer.observer, answer.question.pictures
        counts[asked] = counts.get(asked, 0) + 1
        if counts[asked] > answer.question.times:
            raise FileFormatError(
                f"{where}: answer {counts[asked]} of observer {answer.observer!r} to a question that the "
                f"plan asks {answer.question.times} times; {AGAIN}"
            )
        yield answer


def _answer(plan: Plan, where: str, row: Row) -> Answer:
    if row["plan"] != plan.id:
        raise FileFormatError(
            f"{where}: these are answers to plan {row['plan']!r}, but OUT holds plan {plan.id!r}; give the "
            "OUT whose page was shown"
        )
    if not row["observer"]:
        raise FileFormatError(f"{where}: the observer has no name; write one in that cell")
    first, second, chosen = (row[name] for name in ("first", "second", "chosen"))
    for file in (first, second, chosen):
        if file not in plan.pictures:
            raise FileFormatError(f"{where}: picture {file!r} is not one of the plan's; {AGAIN}")
    if chosen not in (first, second):
        raise FileFormatError(
            f"{where}: the chosen picture {chosen} is neither of the two shown, {first} and {second}; "
            f"{AGAIN}"
        )
    if (chosen == first) != (row["chosen_first"].lower() in TRUE):
        raise FileFormatError(
            f"{where}: chosen_first is {row['chosen_first']!r}, but the chosen picture was shown "
            f"{'first' if chosen == first else 'second'}; {AGAIN}"
        )
    asked = [q for q in plan.questions if set(q.pictures) == {first, second}]
    if not asked:
        raise FileFormatError(
            f"{where}: the plan does not ask for {first} against {second}; {AGAIN}"
        )
    return Answer(row["observer"], asked[0], chosen, first, _milliseconds(where, row))


def _milliseconds(where: str, row: Row) -> float:
    text = row["milliseconds"]
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise FileFormatError(
            f"{where}: milliseconds is {text!r}; it must be a number from 0 on; {AGAIN}"
        )
    return value


def _rows(path: Path) -> Iterator[tuple[str, Row]]:
    """FILE:LINE and cells by column of the lines that are not empty."""
    try:
        lines = path.read_text("utf-8-sig").splitlines()
        # some spreadsheets write semicolons where commas are decimal
        comma = ";" if lines and lines[0].count(";") > lines[0].count(",") else ","
        rows = csv.reader(lines, delimiter=comma)
        table = [[without_mark(cell.strip()) for cell in cells] for cells in rows]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(
            f"{path} is no table ({error}); save it as CSV in UTF-8, or {AGAIN}"
        ) from error
    header = table[0] if table else []
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise FileFormatError(
            f"{path}: the column {', '.join(missing)} is missing; the first line must be "
            f"{','.join(COLUMNS)}"
        )
    for number, cells in enumerate(table[1:], 2):
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise FileFormatError(
                f"{path}:{number}: the line has {len(cells)} cells, and the first line {len(header)}; "
                f"{AGAIN}"
            )
        yield f"{path}:{number}", dict(zip(header, cells, strict=True))


def without_mark(cell: str) -> str:
    """A cell as it was before `csv_text` wrote it.

    >>> without_mark("'=1+1"), without_mark("'s-Gravenhage")
    ('=1+1', "'s-Gravenhage")
    """
    return cell[1:] if cell[:1] == MARK and cell[1:2] in FORMULA else cell
