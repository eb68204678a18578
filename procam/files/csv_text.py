"""Tables as CSV that spreadsheets open as text and numbers: no cell becomes a formula.

A spreadsheet evaluates a cell that begins with "=", "+", "-" or "@", and a formula can send the table
away or start a program. Names of pictures, projectors and people come from others.
"""

from collections.abc import Iterable

FORMULA = (*"=+-@\t\r\n", *"\uff1d\uff0b\uff0d\uff20")  # the last are wide ones
SPECIAL = '",\r\n'
MARK = "'"  # before text that would be a formula; spreadsheets do the same


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV, a line each; text that a spreadsheet would take for a formula gets a `MARK`.

    >>> print(csv_text([["-0.5", -0.5, "=1+1", None, "a,b"]]), end="")
    -0.5,-0.5,'=1+1,,"a,b"
    """
    return "".join(",".join(map(_cell, row)) + "\n" for row in rows)


def _cell(value: object) -> str:
    """A cell, in quotation marks if it has a character of CSV; a bare carriage return begins a row."""
    text = "" if value is None else str(value)
    if isinstance(value, str) and _is_formula(text):
        text = f"{MARK}{text}"
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in SPECIAL) else text


def _is_formula(text: str) -> bool:
    """Numbers are none, and neither is a sign alone."""
    if len(text) == 1 or not text.startswith(FORMULA):
        return False
    try:
        float(text)
    except ValueError:
        return True
    return text != text.strip()
