"""Show a plan and photograph it; resumable at any instant."""

import shutil
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from procam.arrays import Array, Array32
from procam.devices.interrupts import announce
from procam.devices.rig import Rig
from procam.errors import DeviceError, InputError, OutOfModelRange, StaleFrame
from procam.estimate.camera.checks import early_clipping
from procam.files import atomic
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor
from procam.model.plan import Plan, Shot
from procam.threads import Future, ThreadPool
from procam.workflows.capture.session_plan import plan_of_session
from procam.workflows.events import Event

ATTEMPTS = 3
SATURATED_SHARE = 0.002  # of the frame; above it the exposure is wrong, not a glint in the way
DISK_PATIENCE_S = 10.0  # for a disk that hangs when a run fails or is stopped
PROBE_STEP = 7  # checks read every 7th pixel: enough to distinguish pictures


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


def capture(rig: Rig, venue: Venue, session: Session) -> Iterator[Event]:
    """Take every shot that is missing; one projector is lit at a time, the rest are shuttered."""
    plan = session.read_plan()
    todo = missing_shots(session, plan, list(rig.cameras))
    if not todo:
        yield Event("capture", len(plan.shots), len(plan.shots), "all shots are there")
        return
    rig.start()
    lit, done = "", len(plan.shots) - len(todo)
    checks = {name: _FrameCheck(camera.sensor) for name, camera in venue.cameras.items()}
    with _Recorder(session, rig) as recorder:
        for shot in todo:
            shows = shot.projector if shot.pattern else ""
            if shows != lit:
                _hand_over(rig, lit, shows)
                lit = shows
            _take(rig, session, recorder, shot, checks)
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
    rig: Rig, session: Session, recorder: _Recorder, shot: Shot, checks: dict[str, "_FrameCheck"]
) -> None:
    drive = session.pattern(shot) if shot.pattern else None
    if drive is not None:
        rig.projectors[shot.projector].show(np.ascontiguousarray(drive))
    for name, camera in rig.cameras.items():
        stored = session.stored(name)
        for exposure_s in shot.exposures_s:
            if (shot.id, exposure_s) in stored:
                continue  # by a run that was cut short within the shot
            in_force = camera.configure(CameraSettings(exposure_s, shot.pixel_format))
            if in_force.gain != 1:
                raise DeviceError(
                    f"camera {name}: its gain is {in_force.gain:g} and must stay 1; set it to manual"
                )
            frame = _checked(rig, camera.capture, checks[name], (shot, in_force), drive)
            recorder.store(name, shot, exposure_s, frame)


def _checked(
    rig: Rig,
    take: Callable[[], Frame],
    check: "_FrameCheck",
    asked: tuple[Shot, CameraSettings],
    drive: Array32 | None,
) -> Frame:
    """A frame that passed the checks; a stale one is taken again, after a breath."""
    for attempt in range(ATTEMPTS):
        frame = take()
        try:
            _check_settings(frame, *asked)
            check.inspect(frame, asked[0], drive)
        except StaleFrame:
            if attempt == ATTEMPTS - 1:
                raise
            rig.clock.sleep(0.5)
            continue
        check.remember(frame, drive)
        return frame
    raise AssertionError("unreachable")


def _check_settings(frame: Frame, shot: Shot, in_force: CameraSettings) -> None:
    """Refuse a photograph of another exposure than the camera set; one that was not planned is no harm."""
    if frame.settings != in_force:
        raise StaleFrame(
            f"shot {shot.id}: the camera set {_in_words(in_force)}, but its photograph says "
            f"{_in_words(frame.settings)}, {ATTEMPTS} times; set its exposure and gain to manual, or check "
            "its trigger"
        )


def _in_words(settings: CameraSettings) -> str:
    return f"{settings.exposure_s:g} s, gain {settings.gain:g}, {settings.pixel_format}"


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


class _FrameCheck:
    """Compares a frame with what it should be and with the one before it."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self.last: tuple[Array, Array32 | None, float] | None = None

    def inspect(self, frame: Frame, shot: Shot, drive: Array32 | None) -> None:
        """Raise what is wrong with `frame`."""
        probe = self._probe(frame)
        saturated = float((probe >= 2**self.sensor.bits - 1 - self.sensor.black_level).mean())
        if saturated > SATURATED_SHARE and shot.purpose != "dim":
            raise OutOfModelRange(
                f"shot {shot.id}: {saturated:.1%} of the pixels are saturated, more than "
                f"{SATURATED_SHARE:.1%}; lower [capture] exposure_s in venue.toml"
            )
        if (
            shot.purpose == "white"
            and float(np.percentile(probe, 99)) < self.sensor.full_scale / 50
        ):
            raise OutOfModelRange(
                f"shot {shot.id}: white of projector {shot.projector} is black in the photograph; "
                "check its lamp, shutter and input, that photographs do not come one late, and exposure_s"
            )
        if shot.purpose == "white":
            check_range(shot, frame, self.sensor)
        if self._is_stale(probe, frame.settings.exposure_s, drive):
            raise StaleFrame(
                f"shot {shot.id}: the camera delivered the picture before it {ATTEMPTS} times; "
                "add a delay to the player or check the camera's trigger"
            )

    def remember(self, frame: Frame, drive: Array32 | None) -> None:
        """Keep what the next frame must differ from."""
        self.last = (self._probe(frame), drive, frame.settings.exposure_s)

    def _is_stale(self, probe: Array, exposure_s: float, drive: Array32 | None) -> bool:
        """The drives differ a lot, the photographs by no more than noise."""
        if self.last is None or drive is None:
            return False
        before, shown, exposure_before = self.last
        if shown is None:
            return False
        one_panel = shown.shape == drive.shape  # else another projector, of another size
        if exposure_before != exposure_s or (
            one_panel and float(np.abs(shown - drive).mean()) < 0.05
        ):
            return False
        level = max(float(np.percentile(probe, 99)), float(np.percentile(before, 99)))
        return float(np.abs(probe - before).mean()) < 0.01 * level

    def _probe(self, frame: Frame) -> Array:
        counts = frame.counts if frame.counts.ndim == 2 else frame.counts[..., 1]
        return counts[::PROBE_STEP, ::PROBE_STEP].astype(float) - self.sensor.black_level
