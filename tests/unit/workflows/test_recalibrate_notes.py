"""Notes of a repair: those that are new keep it out of use, and those of before do not."""

from types import SimpleNamespace
from typing import Any

import pytest

from procam.model.provenance import Note, Provenance
from procam.workflows.recalibrate.worse import new_notes


def walked(projector: str, amount: float = 1.0) -> Note:
    return Note("obstruction", f"projector {projector}", f"{amount} % of it", amount)


def new(note: Note, *before: Note) -> bool:
    old: Any = SimpleNamespace(provenance=Provenance(notes=before))
    return new_notes(old, [note]) == [note]


@pytest.mark.parametrize("names", [("p1", "p2"), ("1", "2"), ("hall-1", "hall-2")])
def test_a_note_on_another_projector_is_not_that_of_this_one(names: tuple[str, str]) -> None:
    first, second = names
    assert new(walked(second), walked(first))
    assert not new(walked(first), walked(first))


def test_a_much_larger_amount_is_new() -> None:
    assert new(walked("south", 48.0), walked("south", 2.0))
    assert not new(walked("south", 2.0), walked("south", 48.0))
    assert not new(walked("south", 3.0), walked("south", 1.1))


def test_the_other_sign_is_new() -> None:
    assert new(walked("south", -2.0), walked("south", 2.0))
    assert not new(walked("south", -2.0), walked("south", -1.5))


def test_another_kind_is_new() -> None:
    assert new(Note("moved", "projector south", "the camera moved"), walked("south"))


def test_notes_of_before_they_had_a_code_are_compared_by_their_words() -> None:
    note = Note("drift", "projector 1", "its light drifted by 3%", 2.0)
    assert not new(note, Note("", "projector 1", "its light drifted by 2.5%"))
    assert new(note, Note("", "projector 1", "its light shone by 2.5%"))
    assert new(note, Note("", "projector 2", "its light drifted by 3%"))
