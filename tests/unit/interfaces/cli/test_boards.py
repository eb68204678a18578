"""What the places of dropped corners tell about the board."""

import numpy as np

from procam.estimate.boards.robust_fit import DroppedCorner
from procam.interfaces.cli.lens._boards import edge_note

AREA = np.array([[0.0, 0.0], [0.16, 0.11]])


def at(places: list[tuple[float, float]]) -> list[DroppedCorner]:
    return [DroppedCorner("pose", i, (0.0, 0.0), 3.0, place) for i, place in enumerate(places)]


def test_corners_of_one_edge_mean_a_curled_board() -> None:
    edge = [(0.15, 0.01 * i) for i in range(10)]
    note = edge_note(at(edge), AREA)
    assert note is not None
    assert note.startswith("all of 10 dropped corners are from one edge: the board is curled")
    mixed = edge_note(at([*edge, (0.05, 0.05), (0.08, 0.05)]), AREA)
    assert mixed is not None
    assert mixed.startswith("10 of 12 ")


def test_corners_from_all_over_or_too_few_mean_nothing(rng) -> None:
    assert edge_note([], AREA) is None
    assert edge_note(at([(0.15, 0.02), (0.15, 0.05), (0.16, 0.09)]), AREA) is None
    assert edge_note(at([tuple(p) for p in rng.uniform(0, 0.11, (30, 2))]), AREA) is None
