"""The study of rooms at a fraction of its size: rooms that nobody designed for, seeded."""

from pathlib import Path

import pytest

from simulators import truth
from simulators.drawn_rooms import draw_room
from simulators.scene import SceneSize
from studies import rooms

SMALL = SceneSize(projector_size=(240, 150), camera_size=(360, 360), rays=256, map_size=256)


ROOM = 1  # one projector, a lens with a prior, a deck 0.35 radii below the rim


def test_a_drawn_room_is_within_its_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(truth, "MASTER", 256)
    row = rooms.calibrate_room(ROOM, tmp_path, SMALL)
    assert "refused" not in row, row
    value, sigma, true = row["albedo"]
    assert abs(value - true) < 2.5 * sigma and sigma < 0.06 * true
    value, sigma, true = row["floor"]
    assert abs(value - true) < 2.5 * sigma
    assert row["m"][0] == pytest.approx(row["m"][2], rel=0.02)
    for name in ("relative_arcmin", "absolute_arcmin"):
        assert row[name][0] < 2.5 * row[name][1]
    assert row["relative_arcmin"][0] < row["absolute_arcmin"][0]
    assert len(list(rooms.table([row]))) == 8


def test_owners_state_what_venue_toml_can_hold() -> None:
    for known in (draw_room(n, (60, 60)).known for n in rooms.ROOMS):
        assert 70 < known.half_angle_deg <= 90
        assert 0 <= known.floor[0] < 1 and 0 <= known.glare[0] < 0.03
