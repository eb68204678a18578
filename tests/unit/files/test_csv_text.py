"""CSV that procam writes: no cell of it is a formula, and numbers stay numbers."""

import csv
import io
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.files.csv_text import FORMULA, csv_text
from procam.model.plan import Plan, Shot
from procam.workflows.capture import by_hand
from procam.workflows.photographs.orders import OrderRow, order_table
from procam.workflows.playout.compensate import write_report
from studies.preference.answers import without_mark

ROOT = Path(__file__).parents[3]
ESCAPED = (r"\t", r"\r", r"\n", r"\uff1d", r"\uff0b", r"\uff0d", r"\uff20")
HOSTILE = ['=cmd|" /C calc"!A0', "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\uff1d1+1"]


def cells(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text, newline="")))


@pytest.mark.parametrize("text", HOSTILE)
def test_formulas_are_marked(text: str) -> None:
    ((found,),) = cells(csv_text([[text]]))
    assert found == f"'{text}" and without_mark(found) == text


def test_no_text_begins_a_row() -> None:
    assert cells(csv_text([["x\r=1+1"], ["y\n=1+1"]])) == [["x\r=1+1"], ["y\n=1+1"]]


@pytest.mark.parametrize("number", ["-0.5", "+3", "-1e-9", "-inf", "-", -0.5, -3, 0])
def test_numbers_are_not(number: object) -> None:
    assert cells(csv_text([[number, "south"]])) == [[str(number), "south"]]


@given(st.text(st.characters(exclude_categories=["Cs"])))
def test_any_text_comes_back(text: str) -> None:
    ((found, _),) = cells(csv_text([[text, "x"]]))
    assert without_mark(found) == text or text.startswith("'")
    assert not found.startswith(FORMULA) or len(found) == 1 or re.fullmatch(r"[-+][\w.+-]+", found)


def test_reports_and_orders(tmp_path: Path) -> None:
    write_report(tmp_path / "x.csv", [{"frame": "=1+1", "clipped": -0.5}])
    assert (tmp_path / "x.csv").read_text() == "frame,clipped\n'=1+1,-0.5\n"
    text = order_table(
        "=1+1", [OrderRow(picture="-x", projectors=["@a", "b"], photographs=2, exposure_s=1)]
    )
    assert cells(text)[1][:3] == ["'=1+1", "'-x", "'@a b"]
    shot = Shot("=1", "@south", "patterns/south/0000.png", "white", (0.5,))
    assert cells(by_hand.order_table(Plan((shot,))))[1][1:3] == ["'=1", "'@south"]


def test_nothing_else_writes_csv() -> None:
    """Not by the csv module, which knows of no formulas."""
    writers = [
        str(path.relative_to(ROOT))
        for path in sorted((ROOT / "procam").rglob("*.py"))
        if re.search(r"csv\.(writer|DictWriter)", path.read_text("utf-8"))
    ]
    assert not writers


def test_the_page_of_a_preference_test_marks_the_same() -> None:
    page = (ROOT / "studies/preference/page_template.html").read_text("utf-8")
    (found,) = re.findall(r"^const formula = /\^\[(.*)\]/;$", page, re.MULTILINE)
    assert set(re.findall(r"\\u\w{4}|\\?.", found)) == {"=", "+", "\\-", "@", *ESCAPED}
