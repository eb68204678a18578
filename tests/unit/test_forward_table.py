"""Marks and resolution limits in the table of the study `forward`, and the table that is stored."""

import json
from pathlib import Path

import pytest

from studies.forward_table import cell, table

STUDIES = Path(__file__).resolve().parents[2] / "studies"


@pytest.mark.parametrize(
    ("error", "resolution", "expected"),
    [
        ((0.003, 0.001), (0.001, 0.001), "0.30, 0.20"),
        ((0.008, 0.002), (0.001, 0.001), "0.80, 0.50 (miss)"),
        ((0.0, 0.0), (0.002, 0.004), "< 0.4, < 0.3"),
        ((0.0, 0.0), (0.002, 0.009), "< 0.9, < 0.55 (open)"),
        # a miss is shown even where another picture's resolution is coarser still
        ((0.008, 0.0), (0.001, 0.01), "0.80, < 0.55 (miss)"),
    ],
    ids=["met", "missed", "below-resolution", "open", "missed-beside-open"],
)
def test_a_cell(error: tuple[float, ...], resolution: tuple[float, ...], expected: str) -> None:
    errors, limits = (dict(zip("ab", v, strict=True)) for v in (error, resolution))
    assert cell(errors, limits, 0.005) == expected
    unjudged = cell(errors, limits)
    assert "(" not in unjudged


def markdown(document: dict) -> str:
    return "\n".join(table(document))


class TestStored:
    DOCUMENT = json.loads((STUDIES / "forward.json").read_text())

    def test_it_is_the_table_of_its_numbers(self) -> None:
        assert (STUDIES / "forward.md").read_text().startswith(markdown(self.DOCUMENT))

    def test_no_figure_is_printed_as_nothing(self) -> None:
        assert " 0.00" not in markdown(self.DOCUMENT).replace("tilt 0 deg", "")

    def test_misses_are_counted(self) -> None:
        """The closed form's error on bare domes set to 1 %, well above its goal of 0.5."""
        document = json.loads(json.dumps(self.DOCUMENT))
        before = markdown(document).count("(miss)")
        assert f"{before} of " in markdown(document)
        for row in (r for r in document["rows"] if r["kind"] == "bare"):
            row["error"]["closed form, all that reflects"]["white"] = 0.01
        bare = sum(r["kind"] == "bare" for r in document["rows"])
        assert f"{before + bare} of " in markdown(document)
        assert markdown(document).count("(miss)") == before + bare
