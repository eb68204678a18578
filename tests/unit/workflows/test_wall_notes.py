"""What is said of walls that are not where they were drawn."""

from procam.estimate.geometry.walls import MovedWall
from procam.workflows.solve.geometry import _verdict_on_room, _wall_notes

FLOOR, LEFT = (
    MovedWall("floor", -0.021, 0.002, 0.026, 0.003),
    MovedWall("left", 0.004, 0.001, 0.0049, 0.001),
)
UNSURE = MovedWall("right", 0.02, 0.03, 0.05, 0.04)
TILTED = MovedWall("front", 0.001, 0.001, 0.03, 0.004)


def test_a_wall_is_named_with_its_distance() -> None:
    (note,) = _wall_notes([FLOOR, LEFT, UNSURE])
    assert (note.code, note.subject) == ("wall off", "floor")
    assert note.text.startswith("it is 21 +- 2 mm nearer to the middle of the room than venue.toml")
    assert "and up to 26 mm at its edges." in note.text
    assert note.amount > 5  # times what is just noted


def test_a_tilt_is_not_called_a_distance() -> None:
    (note,) = _wall_notes([TILTED])
    assert note.text.startswith("it is tilted or shifted by up to 30 mm")


def test_the_verdict_names_the_worst() -> None:
    said = _verdict_on_room(1.0, "(ratio 1.0)", [LEFT, FLOOR])
    assert "floor most (26 mm); their places were solved (ratio 1.0)" in said
    assert _verdict_on_room(1.0, "(r)", []) == "walls are where venue.toml has them (r)"
    assert "do not quite fit" in _verdict_on_room(2.0, "(r)", [FLOOR])
