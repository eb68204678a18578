"""Show a plan and photograph it; resumable at any instant."""

import shutil
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from procam.devices.interrupts import announce
from procam.devices.rig import Rig
from procam.errors import InputError, OutOfModelRange
from procam.estimate.camera.checks import early_clipping
from procam.files import atomic
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor
from procam.model.plan import Plan, Shot
from procam.threads import Future, ThreadPool
from procam.workflows.capture.checked_camera import CheckedCamera, probe
from procam.workflows.capture.session_plan import plan_of_session
from procam.workflows.events import Event, Steps

SATURATED_SHARE = 0.002  # of the frame; above it the exposure is wrong, not a glint in the way
DISK_PATIENCE_S = 10.0  # for a disk that hangs when a run fails or is stopped


def prepare_session(venue: Venue, directory: Path) -> Session:
    """A session with its plan; an unfinished one is picked up where it stopped.

    Open the rig first: a venue.toml that no device answers to must leave nothing behind.
    """
    session = Session(directory)
    text = (venue.directory / "venue.toml").read_text("utf-8")
    if (directory / "plan.json").is_file():
        if (directory / "venue.toml").read_text("utf-8") == text:
            return session
        if any(session.stored(camera) for camera in venue.cameras):
            raise InputError(
                f"{venue.directory / 'venue.toml'}: changed since the unfinished session "
                f"{directory} was started; undo the change to resume it, or "
                "remove that folder to begin again"
            )
        shutil.rmtree(directory)  # nothing was captured with the old file
    directory.mkdir(parents=True, exist_ok=True)
    atomic.write_text(directory / "venue.toml", text)
    session.write_plan(*plan_of_session(venue))
    return session


def missing_shots(session: Session, plan: Plan, cameras: list[str]) -> list[Shot]:
    """Shots of which some camera lacks some exposure."""
    stored = {camera: session.stored(camera) for camera in cameras}
    return [
        shot
        for shot in plan.shots
        if any((shot.id, e) not in stored[c] for c in cameras for e in shot.exposures_s)
    ]


def capture(rig: Rig, venue: Venue, session: Session) -> Steps[None]:
    """Take every shot that is missing; one projector is lit at a time, the rest are shuttered."""
    plan = session.read_plan()
    todo = missing_shots(session, plan, list(rig.cameras))
    if not todo:
        yield Event("capture", len(plan.shots), len(plan.shots), "all shots are there")
        return
    rig.start()
    lit, done = "", len(plan.shots) - len(todo)
    cameras = {
        name: CheckedCamera(camera, venue.cameras[name].sensor, rig.clock)
        for name, camera in rig.cameras.items()
    }
    with _Recorder(session, rig) as recorder:
        for shot in todo:
            shows = shot.projector if shot.pattern else ""
            if shows != lit:
                _hand_over(rig, lit, shows)
                lit = shows
            _take(rig, session, recorder, shot, cameras)
            done += 1
            yield Event("capture", done, len(plan.shots), f"{shot.id} {shot.purpose}")
    _hand_over(rig, lit, "")


def _hand_over(rig: Rig, lit: str, following: str) -> None:
    if lit:
        rig.darken(lit)
    if following:
        rig.light(following)


class _Recorder:
    """Writes frames to disk while the next picture is being taken, one behind at most.

    If the block fails, the disk is waited for in the dark.
    """

    def __init__(self, session: Session, rig: Rig) -> None:
        self._session, self._rig = session, rig
        self._writer = ThreadPool(1, DISK_PATIENCE_S)
        self._pending: Future[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        with self._writer:
            if kind is None:
                self._settle()
            else:
                self._announce(self._rig.darken_all())

    def store(self, camera: str, shot: Shot, exposure_s: float, frame: Frame) -> None:
        """Hand a frame over; what went wrong with the one before it is raised here."""
        self._settle()
        write = partial(self._session.store, camera, shot, exposure_s, frame)
        self._pending = self._writer.submit(write)

    def _settle(self) -> None:
        try:
            if self._pending is not None:
                self._pending.result()
        except Exception:
            self._pending = None
            raise
        self._pending = None

    def _announce(self, lit: Collection[str]) -> None:
        """Say that the disk is waited for, if it is, and what is dark."""
        if self._pending is None or self._pending.done():
            return
        state = f"{', '.join(lit)} may still be lit" if lit else "all projectors are dark"
        announce(
            f"{state}; waiting for the disk to write the last photograph into {self._session.directory}, "
            f"{DISK_PATIENCE_S:g} s at most"
        )


def _take(
    rig: Rig,
    session: Session,
    recorder: _Recorder,
    shot: Shot,
    cameras: Mapping[str, CheckedCamera],
) -> None:
    drive = session.pattern(shot) if shot.pattern else None
    pictures = {} if drive is None else {shot.projector: drive}
    if drive is not None:
        rig.projectors[shot.projector].show(np.ascontiguousarray(drive))
    for name, camera in cameras.items():
        stored, judge = session.stored(name), partial(_check_light, shot, camera.sensor)
        for exposure_s in shot.exposures_s:
            if (shot.id, exposure_s) in stored:
                continue  # by a run that was cut short within the shot
            settings = CameraSettings(exposure_s, shot.pixel_format)
            frame = camera.photograph(f"shot {shot.id}", settings, pictures, judge)
            recorder.store(name, shot, exposure_s, frame)


def check_range(shot: Shot, frame: Frame, sensor: Sensor) -> None:
    """Refuse a photograph of white that is clipped below the camera's full scale, where it looks sound."""
    found = early_clipping(frame.counts, 2**sensor.bits - 1)
    if found is not None:
        level, share = found
        raise OutOfModelRange(
            f"shot {shot.id}: {share:.1%} of the pixels have the value {level} and none has more, though "
            f"{sensor.bits} bits allow {2**sensor.bits - 1}: the camera clips there. Expose white shorter "
            "([capture] exposure_s), and switch off what limits the camera's range"
        )


def _check_light(shot: Shot, sensor: Sensor, frame: Frame) -> None:
    """Refuse a photograph that is exposed too long, and a white that is black or clipped early."""
    light = probe(frame, sensor)
    saturated = float((light >= 2**sensor.bits - 1 - sensor.black_level).mean())
    if saturated > SATURATED_SHARE and shot.purpose != "dim":
        raise OutOfModelRange(
            f"shot {shot.id}: {saturated:.1%} of the pixels are saturated, more than "
            f"{SATURATED_SHARE:.1%}; lower [capture] exposure_s in venue.toml"
        )
    if shot.purpose != "white":
        return
    if float(np.percentile(light, 99)) < sensor.full_scale / 50:
        raise OutOfModelRange(
            f"shot {shot.id}: white of projector {shot.projector} is black in the photograph; "
            "check its lamp, shutter and input, that photographs do not come one late, and exposure_s"
        )
    check_range(shot, frame, sensor)
