"""Calibrations of a venue by cameras that stood elsewhere, from photographs that the other has not used.

Two calibrations by one seat share its errors: of the lens, where it looks, and what it cannot see. Poses
are read from calibration.json, and the photographs' hashes only of those that stood elsewhere, so that a
long history costs little.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Array
from procam.errors import FileFormatError
from procam.files import calibration_entries as entries
from procam.files.session import Session
from procam.files.versions import list_calibrations
from procam.maths.geometry.pose import Pose, align_rotation, rotation_vector

# seats are further apart, and a camera's place is known ten times better
ELSEWHERE = 0.05  # of the radius


@dataclass(frozen=True, slots=True)
class OtherSeat:
    """A calibration by cameras that stood elsewhere than those of another one.

    Attributes
    ----------
    directory : its folder. camera, here : its main camera, and that of the other one.
    distance_m : between these two [m]. share : the same over the radius [-].
    turn_deg : angle by which the one camera was turned against the other [deg].
    """

    directory: Path
    camera: str
    here: str
    distance_m: float
    share: float
    turn_deg: float


@dataclass(frozen=True, slots=True)
class _Origin:
    """Where a calibration comes from."""

    directory: Path
    session: str
    recalibrated: bool
    radius_m: float
    main: str
    cameras: dict[str, Pose]
    projectors: dict[str, tuple[tuple[int, int], Pose]]


def other_seats(venue_dir: Path, used: Path) -> Iterator[OtherSeat]:
    """Calibrations of the same projectors from other seats and other photographs, newest first."""
    here = _origin(used)
    if here is None:
        return
    for directory in reversed(list_calibrations(venue_dir)):
        there = _origin(directory)
        if there is None or _panels(here) != _panels(there):
            continue
        seat = _other_seat(here, there)
        if seat and _is_independent(venue_dir, here, there):
            yield seat


def _is_independent(venue_dir: Path, a: _Origin, b: _Origin) -> bool:
    """Whether two calibrations have no photograph in common."""
    of_a, of_b = _photographs(venue_dir, a), _photographs(venue_dir, b)
    if of_a and of_b:
        return not of_a & of_b
    linked = a.recalibrated or b.recalibrated  # its session has photographs of another one
    return a.session != b.session and not linked


def _panels(origin: _Origin) -> dict[str, tuple[int, int]]:
    return {name: size for name, (size, _) in origin.projectors.items()}


def _other_seat(here: _Origin, there: _Origin) -> OtherSeat | None:
    """The seat of `there`; None if a camera of it stood where one of `here` did."""
    turn = _turn(here, there)
    a, b = _places(here), _places(there) @ turn.T
    if np.linalg.norm(a[:, None] - b, axis=-1).min() <= ELSEWHERE:
        return None
    old, new = (each.cameras[each.main] for each in (here, there))
    places = old.origin / here.radius_m, turn @ new.origin / there.radius_m
    share = float(np.linalg.norm(places[0] - places[1]))
    angle = float(np.linalg.norm(rotation_vector(new.rotation @ turn.T @ old.rotation.T)))
    distance_m, turned_deg = share * here.radius_m, float(np.degrees(angle))
    return OtherSeat(there.directory, there.main, here.main, distance_m, share, turned_deg)


def _places(origin: _Origin) -> Array:
    """Positions (K, 3) of the cameras over the radius [-]."""
    return np.stack([pose.origin for pose in origin.cameras.values()]) / origin.radius_m


def _turn(here: _Origin, there: _Origin) -> Array:
    """The rotation (3, 3) from the frame of `there` to that of `here`, by how projectors are placed."""
    return align_rotation(*(_directions(each, list(here.projectors)) for each in (there, here)))


def _directions(origin: _Origin, names: list[str]) -> Array:
    """Places of projectors over the radius, and their three axes: (4 K, 3)."""
    poses = [origin.projectors[name][1] for name in names]
    return np.vstack([np.vstack([p.origin / origin.radius_m, p.rotation]) for p in poses])


def _origin(directory: Path) -> _Origin | None:
    """What a calibration.json says; None if it is damaged or does not record its main camera."""
    try:
        document = json.loads((directory / "calibration.json").read_bytes())
        return _of_document(directory, document)
    except (*entries.DAMAGES, OSError):
        return None


def _of_document(directory: Path, document: dict[str, Any]) -> _Origin:
    source, cameras = document["provenance"], document["cameras"]
    main = entries.main_camera(document)
    if not (main and document["projectors"]):
        raise ValueError("no main camera, or no projectors")
    session = str(source.get("session", ""))
    return _Origin(
        directory,
        entries.safe_name(session) if session else "",
        bool(source.get("recalibrated")),
        entries.screen(document["screen"]).shape.radius_m,
        main,
        {name: entries.pose(e["camera_from_dome"]) for name, e in cameras.items()},
        {
            name: (entries.size_of(e), entries.pose(e["projector_from_dome"]))
            for name, e in document["projectors"].items()
        },
    )


def _photographs(venue_dir: Path, origin: _Origin) -> set[str]:
    """Hashes of what its cameras photographed, without the dark, which may look alike; none if not known."""
    if not origin.session:
        return set()
    folder = Session(venue_dir / "sessions" / origin.session)
    try:
        dark = {shot.id for shot in folder.read_plan().shots if not shot.projector}
        taken = [frame for camera in origin.cameras for frame in folder.taken(camera)]
    except (FileFormatError, OSError):
        return set()
    return {frame.sha256 for frame in taken if frame.shot not in dark}
