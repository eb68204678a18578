"""Notes of a repair: those that are new keep it out of use, and those of before do not."""

from types import SimpleNamespace
from typing import Any

import pytest

from procam.workflows.recalibrate.worse import new_notes

WALKED = "projector {}: someone moved before the screen; gains are off by {}% in {} photographs"
BRIGHTER = "projector south: its stripes are {} brighter beside their edges, +-{:.1g} px"


def new(note: str, *before: str) -> bool:
    old: Any = SimpleNamespace(provenance={"notes": before})
    return new_notes(old, [note]) == [note]


@pytest.mark.parametrize("names", [("p1", "p2"), ("1", "2"), ("hall-1", "hall-2")])
def test_a_note_on_another_projector_is_not_that_of_this_one(names: tuple[str, str]) -> None:
    first, second = names
    assert new(WALKED.format(second, 48, 9), WALKED.format(first, 47, 9))
    assert not new(WALKED.format(first, 48, 11), WALKED.format(first, 47, 9))


def test_a_note_with_a_much_larger_share_is_new() -> None:
    assert new(WALKED.format("south", 48, 9), WALKED.format("south", 1, 9))
    assert not new(WALKED.format("south", 1, 9), WALKED.format("south", 48, 9))
    assert not new(WALKED.format("south", 1.4, 9), WALKED.format("south", 0.3, 9))


def test_digits_that_differ_are_not_new() -> None:
    assert not new(BRIGHTER.format("3%", 1e-5), BRIGHTER.format("2.5%", 0.3))
    assert new("camera zenith: another sentence", BRIGHTER.format("3%", 1))


@pytest.mark.parametrize(
    ("note", "known", "larger"),
    [
        ("the camera moved by {} px", "0.06", "9.87"),
        ("projector 1: its black is {} times as bright as it was", "1.2", "30"),
        ("projector 1: its black is {} times as bright as it was", "0.9", "0.03"),
        ("projector 1: its black is {} times as bright as it was", "1.3", "0.7"),
        ("camera a: rows are off by {}", "+3%", "-3%"),
        ("projector 1: {} photographs differ", "2", "40"),
        ("projector 1: one pixel is off by {} arcmin", "1.5e-2", "1.5e2"),
    ],
)
def test_a_note_with_a_larger_number_of_any_unit_is_new(note: str, known: str, larger: str) -> None:
    assert new(note.format(larger), note.format(known))
    assert not new(note.format(known), note.format(known))


def test_a_number_of_another_unit_is_another_note() -> None:
    assert new("light rose by 3 times", "light rose by 3% times")
