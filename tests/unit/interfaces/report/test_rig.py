"""Venue states in the report."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from procam.files.calibration import save_calibration
from procam.files.versions import next_directory
from procam.interfaces.report import hand, rig, write_report
from procam.interfaces.report.blocks import Table
from procam.interfaces.report.data import read_material
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.model.venue_state import VenueState
from simulators.scene import SceneSize
from simulators.template import walls_text


def _with_states(calibration: Calibration) -> Calibration:
    lamps = np.broadcast_to(np.float32([0.004, 0.003, 0.002]), (96, 96, 3)).copy()
    m = Measured(np.array([0.34, 0.37, 0.45]), np.full(3, 0.005))
    states = {
        "full": VenueState("full", m, np.full(3, 1.12), lamps),
        "school": VenueState("school", m, np.full(3, 1.12)),
    }
    return replace(calibration, states=states)


def _saved(folder: Path, calibrations: Sequence[Calibration]) -> Path:
    for calibration in calibrations:
        save_calibration(calibration, next_directory(folder))
    return folder


def _tables(folder: Path) -> list[Table]:
    return [b for b in rig.feedback(read_material(folder)) if isinstance(b, Table)]


def test_each_state_has_its_row(tmp_path: Path, calibration: Calibration) -> None:
    table = _tables(_saved(tmp_path, [_with_states(calibration)]))[-1]
    assert table.head == [
        "Venue state",
        "Feedback m, red",
        "Feedback m, green",
        "Feedback m, blue",
        "The room's own light",
    ]
    first, full, school = table.rows
    assert first[:2] == ["as calibrated", "0.3000 (0.2961 to 0.3039)"]
    assert full[:2] == ["full", "0.3400 (0.3302 to 0.3498)"]
    thin = "\N{NARROW NO-BREAK SPACE}"
    assert full[-1] == f"0.4{thin}% / 0.3{thin}% / 0.2{thin}%"
    assert school[-1] == "none"


def test_without_states_there_is_no_such_table(tmp_path: Path, calibration: Calibration) -> None:
    tables = _tables(_saved(tmp_path, [calibration]))
    assert not any("Venue state" in table.head for table in tables)


def test_masks_of_a_room_are_listed(tmp_path: Path, calibration: Calibration) -> None:
    entry = {"of": "box", "corners": 4, "share": 0.25}
    provenance = replace(calibration.provenance, by_hand={"masks": [entry]})
    material = read_material(_saved(tmp_path, [replace(calibration, provenance=provenance)]))
    (table,) = [b for b in hand.by_hand(material) if isinstance(b, Table)]
    thin = "\N{NARROW NO-BREAK SPACE}"
    assert table.rows == [["Box", "polygon of 4 points", f"25{thin}% of the canvas", "is not used"]]


def test_a_room_without_a_calibration_is_called_a_room(tmp_path: Path) -> None:
    size = SceneSize(1, (64, 40), 1, (60, 60), rays=64)
    (tmp_path / "venue.toml").write_text(walls_text("box", size), "utf-8")
    material = read_material(tmp_path)
    assert material.word == "room" and not material.is_dome
    page = write_report(tmp_path).read_text("utf-8")
    assert "the dome" not in page.partition("<style>")[0] and "bounces round the room" in page
