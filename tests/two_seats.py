"""Calibrations of a venue by cameras at chosen places, and the photographs that they came from."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from procam.files.calibration import save_calibration
from procam.files.session import Session
from procam.files.versions import next_directory
from procam.maths.geometry.pose import Pose, rotation_matrix
from procam.model.calibration import Calibration
from procam.model.plan import Plan, Shot

HERE, THERE = (0.1, 0.2, -0.5), (2.1, 0.2, -0.5)  # places of a camera, 2 m apart [m]
DARK, WHITE = "dark", "south-white"
Place = tuple[float, float, float]


def seen_from(calibration: Calibration, place: Place, turn_deg: float = 0.0) -> Calibration:
    """The calibration, its camera at a place and turned about its axis."""
    camera = calibration.cameras["zenith"]
    assert camera.camera_from_dome is not None
    turn = rotation_matrix([0, 0, np.radians(turn_deg)])
    rotation = turn @ camera.camera_from_dome.rotation
    pose = Pose(rotation, -rotation @ np.array(place))
    return replace(calibration, cameras={"zenith": replace(camera, camera_from_dome=pose)})


def keep(venue: Path, calibration: Calibration, session: str, **provenance: object) -> Path:
    """Add a calibration of a session to a venue; returns its folder."""
    directory = next_directory(venue)
    source = replace(calibration.provenance, session=session, **provenance)  # type: ignore[arg-type]
    save_calibration(replace(calibration, provenance=source), directory)
    return directory


def photograph(
    venue: Path, session: str, hashes: Mapping[str, str], cameras: Sequence[str] = ("zenith",)
) -> None:
    """Record photographs of a session by shot, whose files were deleted since."""
    folder = venue / "sessions" / session
    shots = [Shot(DARK, "", "", "dark", (1.0,)), Shot(WHITE, "south", "p.png", "white", (1.0,))]
    Session(folder).write_plan(Plan(tuple(shots)), {})
    for camera in cameras:
        entries = [
            {
                "shot": shot,
                "file": f"{shot}@1.tif",
                "exposure_s": 1.0,
                "gain": 1.0,
                "pixel_format": "rgb",
                "started_s": 0.0,
                "ended_s": 1.0,
                "sha256": digest,
            }
            for shot, digest in hashes.items()
        ]
        path = folder / "captures" / camera / "index.jsonl"
        path.parent.mkdir(parents=True)
        path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
