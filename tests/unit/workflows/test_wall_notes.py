"""What is said of walls that are not where they were drawn."""

from procam.estimate.geometry.walls import MovedWall
from procam.workflows.solve.geometry import _verdict_on_room, _wall_notes

FLOOR, LEFT = MovedWall("floor", -0.021, 0.002, 0.026), MovedWall("left", 0.004, 0.001, 0.0049)
UNSURE = MovedWall("right", 0.02, 0.03, 0.05)


def test_a_wall_is_named_with_its_distance() -> None:
    (note,) = _wall_notes([FLOOR, LEFT, UNSURE])
    assert (note.code, note.subject) == ("wall off", "wall floor")
    assert note.text.startswith(
        "it is 21 +- 2 mm further in than venue.toml says, and up to 26 mm at its edges."
    )
    assert note.amount > 5  # times what is just noted


def test_the_verdict_names_the_worst() -> None:
    said = _verdict_on_room(1.0, "(ratio 1.0)", [LEFT, FLOOR])
    assert "floor most (26 mm); their places were solved (ratio 1.0)" in said
    assert _verdict_on_room(1.0, "(r)", []) == "the room has the dimensions of venue.toml (r)"
    assert "do not quite fit" in _verdict_on_room(2.0, "(r)", [FLOOR])
