"""Provenance in calibration.json."""

import json
from typing import Any

import pytest

from procam.files.provenance import provenance_entry, read_provenance
from procam.model.provenance import Note, Provenance

WHOLE = Provenance(
    "0007",
    "ab" * 32,
    ("camera-a", "player"),
    "3.12.1",
    {"procam": "1.2"},
    (Note("drift", "projector south", "its light drifted by 1 %", 2.0), Note("misfit", "", "bad")),
    ("south", "north"),
    {"masks": [{"of": "dome", "corners": 4, "share": 0.1}]},
    {"readings": "meter.csv"},
)


@pytest.mark.parametrize("provenance", [WHOLE, Provenance(), Provenance("0001")])
def test_it_comes_back(provenance: Provenance) -> None:
    assert read_provenance(json.loads(json.dumps(provenance_entry(provenance)))) == provenance


def test_what_is_empty_is_not_written() -> None:
    assert provenance_entry(Provenance("0001")) == {"session": "0001"}


@pytest.mark.parametrize(
    ("line", "subject"),
    [
        ("projector south: its light: gone", "projector south"),
        ("camera zenith-2: bands", "camera zenith-2"),
        ("the dome is NOT a sphere: see projector south", ""),
    ],
)
def test_lines_of_before_notes_had_a_code(line: str, subject: str) -> None:
    (note,) = read_provenance({"notes": [line], "source": "of another program"}).notes
    assert (note.code, note.subject, str(note)) == ("", subject, line)


@pytest.mark.parametrize(
    "damaged",
    [
        [],
        {"session": 7},
        {"backends": "camera"},
        {"notes": "abc"},
        {"notes": {"code": "x"}},
        {"notes": [{"code": 3, "subject": "", "text": "", "amount": 1}]},
        {"notes": [{"code": "", "subject": "", "text": ""}]},
        {"notes": [7]},
        {"versions": 3},
    ],
)
def test_damaged_entries_raise_what_a_damaged_document_raises(damaged: Any) -> None:
    with pytest.raises((AttributeError, LookupError, TypeError, ValueError)):
        read_provenance(damaged)


def test_a_sentence_that_was_reworded_is_known_again() -> None:
    line = "1.2% of the picture of south lie beyond the dome's rim and do not count as screen"
    (note,) = read_provenance({"notes": [line]}).notes
    assert note.subject == "projector south"
    assert note.text == "1.2% of its picture lie beyond the dome's rim and do not count as screen"
