"""A capture session on disk: its plan, patterns and captured frames.

SESSION/venue.toml  plan.json  patterns/PROJECTOR/SHOT.png
SESSION/captures/CAMERA/SHOT@EXPOSURE.tif + index.jsonl

A frame is written first and its line in index.jsonl second, each flushed to disk, so every frame that
the index names is complete, also after a kill or a power cut. A `Session` reads each index once and
then keeps it in memory. Before each use it compares the file's size and time with those it has read,
and reads the index again if another process has changed it.
"""

import hashlib
import json
import os
import shutil
import threading
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array32
from procam.errors import FileFormatError
from procam.files import atomic
from procam.files.images.pixels import read_image, write_image
from procam.files.output_log import file_state
from procam.files.session_tables import StoredFrame, parse_entry, parse_plan, plan_text
from procam.files.system import refuse_link
from procam.model.frame import CameraSettings, Frame, PixelFormat
from procam.model.plan import Plan, Shot

Slot = tuple[str, float]  # shot and exposure [s]
AS_MADE = "plan-as-made.json"  # before photographs by hand changed its exposures
PRUNED = (
    "{session}: its photographs were deleted, by `procam venue prune` or by hand, and can be neither "
    "solved nor compared with; restore them from a backup, or calibrate again"
)
OTHERS_FROM = "others-from.txt"  # names the session whose photographs a recalibration has as links


@dataclass(slots=True)
class _Index:
    """An index.jsonl as it was last read or written: entries by slot, and the file's state."""

    entries: dict[Slot, StoredFrame] = field(default_factory=dict)
    state: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Session:
    """A session on disk."""

    directory: Path
    _indexes: dict[str, _Index] = field(default_factory=dict, init=False, repr=False, compare=False)
    _lock: Any = field(default_factory=threading.Lock, init=False, repr=False, compare=False)

    def write_plan(self, plan: Plan, patterns: dict[str, NDArray[np.uint8]]) -> None:
        """Store pattern pictures by path, then the plan that names them."""
        for path, pixels in patterns.items():
            write_image(self.directory / path, pixels)
        atomic.write_text(self.directory / "plan.json", plan_text(plan))

    def read_plan(self) -> Plan:
        """The plan; an error if the session has none."""
        path = self.directory / "plan.json"
        if not path.is_file():
            raise FileFormatError(
                f"{path}: no such file; a session folder such as VENUE/sessions/0001 is needed, of `procam "
                "session capture` or `procam session plan`. Photographs of refine and "
                "state go to these with --photos"
            )
        return parse_plan(path, path.read_bytes())

    def pattern(self, shot: Shot) -> Array32:
        """The drive (H, W, 3) 0..1 that a shot shows."""
        pixels = np.asarray(read_image(self.directory / shot.pattern), np.float32) / 255
        return np.broadcast_to(pixels, (*pixels.shape[:2], 3))

    def stored(self, camera: str) -> dict[Slot, StoredFrame]:
        """Index entries of the frames that are on disk, by (shot, exposure)."""
        folder = self._folder(camera)
        with self._lock:
            entries = dict(self._index(camera).entries)
        return {slot: e for slot, e in entries.items() if (folder / e.file).is_file()}

    def taken(self, camera: str) -> list[StoredFrame]:
        """Index entries of all frames, also of those that were deleted since."""
        with self._lock:
            return list(self._index(camera).entries.values())

    @property
    def is_pruned(self) -> bool:
        """Whether photographs were taken and all of them deleted since, as `procam venue prune` does."""
        cameras = [path.name for path in (self.directory / "captures").glob("*")]
        taken = any(self.taken(camera) for camera in cameras)
        return taken and not any(self.stored(camera) for camera in cameras)

    @property
    def is_of_recalibration(self) -> bool:
        """Whether it has photographs of an earlier session, as links; then nothing is captured into it."""
        return (self.directory / OTHERS_FROM).is_file()

    def bits(self, camera: str) -> int | None:
        """Depth of the counts that a camera's encoded photographs were decoded to [bit]; else None."""
        return next((entry.bits for entry in self.stored(camera).values()), None)

    def store(
        self, camera: str, shot: Shot, exposure_s: float, frame: Frame, bits: int | None = None
    ) -> None:
        """Write a frame to disk, then its entry in the index; `bits` as `StoredFrame` has it."""
        name = f"{shot.id}@{exposure_s:g}.tif"
        path = self._folder(camera) / name
        write_image(path, frame.counts)
        entry = StoredFrame(
            shot=shot.id,
            file=name,
            exposure_s=exposure_s,
            in_force_s=frame.settings.exposure_s,
            gain=frame.settings.gain,
            pixel_format=frame.settings.pixel_format,
            started_s=frame.started_s,
            ended_s=frame.ended_s,
            sha256=digest(frame.counts),
            bits=bits,
        )
        with self._lock:
            index, log = self._index(camera), path.with_name("index.jsonl")
            atomic.append_line(log, json.dumps(entry.model_dump()))
            index.entries[shot.id, exposure_s] = entry
            index.state = file_state(log)

    def load(self, camera: str, shot: Shot, exposure_s: float, size: tuple[int, int]) -> Frame:
        """A stored frame, checked against its entry and the camera's size."""
        with self._lock:
            entry = self._index(camera).entries.get((shot.id, exposure_s))
        folder = self._folder(camera)
        if entry is None or not (folder / entry.file).is_file():
            if self.is_pruned:
                raise FileFormatError(PRUNED.format(session=self.directory))
            raise FileFormatError(
                f"{folder}: shot {shot.id} at {exposure_s:g} s was not captured; run `procam session "
                "capture` on this venue again, which takes only what is missing"
            )
        path = folder / entry.file
        pixels = read_image(path)
        counts = np.asarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels)
        _check(path, counts, entry, size)
        pixel_format: PixelFormat = "mono" if counts.ndim == 2 else "rgb"
        settings = CameraSettings(entry.in_force_s or exposure_s, pixel_format, entry.gain)
        return Frame(counts.astype(np.uint16, copy=False), settings, entry.started_s, entry.ended_s)

    def without(self, directory: Path, projectors: Collection[str]) -> "Session":
        """The same session in another folder, without photographs of some projectors; the rest are links.

        The room may be another by the time these are photographed again, so each has a dark of its own.

        Raises
        ------
        InputError
            The folder exists.
        """
        plan = _with_own_dark(self.read_plan(), projectors)
        left_out = {shot.id for shot in plan.shots if shot.projector in projectors}
        with atomic.replacing_directory(directory) as folder:
            copy = Session(folder)
            (folder / OTHERS_FROM).write_text(f"{self.directory.name}\n", encoding="utf-8")
            for path in sorted(self.directory.rglob("*")):
                where = path.relative_to(self.directory)
                if path.is_file() and where.parts[0] in ("patterns", "venue.toml"):
                    _link(path, folder / where)
            copy.write_plan(plan, {})
            for camera in sorted(p.name for p in (self.directory / "captures").glob("*")):
                for entry in self.stored(camera).values():
                    if entry.shot not in left_out:
                        copy.add_link(camera, self._folder(camera) / entry.file, entry)
        return Session(directory)

    def add_link(self, camera: str, frame: Path, entry: StoredFrame) -> None:
        """Add a frame of another session, as a link, and its entry."""
        target = self._folder(camera) / entry.file
        _link(frame, target)
        atomic.append_line(target.with_name("index.jsonl"), json.dumps(entry.model_dump()))

    def keep_plan(self) -> None:
        """Keep the plan as it is now, unless one is kept already."""
        if not (self.directory / AS_MADE).is_file():
            text = (self.directory / "plan.json").read_text("utf-8")
            atomic.write_text(self.directory / AS_MADE, text)

    def restore_plan(self) -> None:
        """The plan is again as it was kept, if it was."""
        if (self.directory / AS_MADE).is_file():
            text = (self.directory / AS_MADE).read_text("utf-8")
            atomic.write_text(self.directory / "plan.json", text)

    def set_aside(self, camera: str) -> Path:
        """Move all frames of a camera out of the session, into a folder of their own in it."""
        source, number = self._folder(camera), 1
        while (target := self.directory / "undone" / f"{camera}-{number}").exists():
            number += 1
        target.parent.mkdir(exist_ok=True)
        source.rename(target)
        return target

    def _folder(self, camera: str) -> Path:
        return self.directory / "captures" / camera

    def _index(self, camera: str) -> _Index:
        """The index of a camera's frames, as it is on disk now; hold the lock."""
        path = self._folder(camera) / "index.jsonl"
        state = file_state(path) if path.exists() else []
        if camera not in self._indexes or self._indexes[camera].state != state:
            self._indexes[camera] = _Index(_read_index(path), state)
        return self._indexes[camera]


def _with_own_dark(plan: Plan, projectors: Collection[str]) -> Plan:
    """The plan with a dark before the first picture of each of some projectors."""
    (shared,) = plan.of("", "dark")
    shots, lacking = list[Shot](), {n for n in projectors if not plan.of(n, "dark")}
    for shot in plan.shots:
        if shot.projector in lacking:
            lacking.remove(shot.projector)
            shots.append(replace(shared, id=f"{shot.projector}-dark", projector=shot.projector))
        shots.append(shot)
    return Plan(tuple(shots))


def _link(source: Path, target: Path) -> None:
    """A hard link, or a copy where the disk has none."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:
        refuse_link(target)
        shutil.copyfile(source, target)


def _read_index(path: Path) -> dict[Slot, StoredFrame]:
    lines = enumerate(atomic.read_lines(path), start=1)
    entries = [parse_entry(path, number, line) for number, line in lines]
    return {(e.shot, e.exposure_s): e for e in entries}


def _check(
    path: Path, counts: NDArray[np.generic], entry: StoredFrame, size: tuple[int, int]
) -> None:
    height, width = counts.shape[:2]
    if (width, height) != tuple(size):
        raise FileFormatError(
            f"{path} has {width}x{height} px, but venue.toml gives the camera {size[0]}x{size[1]}; "
            "capture it again or correct the camera's size"
        )
    if digest(counts) != entry.sha256:
        raise FileFormatError(
            f"{path} differs from the frame captured for shot {entry.shot} (swapped or edited "
            "file); restore it, or delete the file and its line in index.jsonl and capture again"
        )


def digest(counts: NDArray[np.generic]) -> str:
    """The sha256 of a photograph's counts, as `StoredFrame` has it."""
    return hashlib.sha256(np.ascontiguousarray(counts).data).hexdigest()
