"""A session: plan, patterns and captures of one visit, stored so that nothing is ever lost.

SESSION/venue.toml  plan.json  patterns/PROJECTOR/SHOT.png
SESSION/captures/CAMERA/SHOT@EXPOSURE.tif + index.jsonl
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError
from procam.files import atomic
from procam.files.images.images import read_image, write_image
from procam.model.frame import CameraSettings, Frame, PixelFormat
from procam.model.plan import Plan, Shot

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Session:
    """A session on disk."""

    directory: Path

    def write_plan(self, plan: Plan, patterns: dict[str, NDArray[np.uint8]]) -> None:
        """Store pattern pictures by path, then the plan that names them."""
        for path, pixels in patterns.items():
            write_image(self.directory / path, pixels)
        document = {"schema": SCHEMA, "shots": [asdict(shot) for shot in plan.shots]}
        atomic.write_text(self.directory / "plan.json", json.dumps(document, indent=1))

    def read_plan(self) -> Plan:
        """The plan; an error if the session has none."""
        path = self.directory / "plan.json"
        if not path.is_file():
            raise FileFormatError(
                f"{path}: got no such file, expected a session folder such as "
                "VENUE/sessions/0001; run `procam capture VENUE` first"
            )
        document = _parse(path, path.read_text("utf-8"))
        if document.get("schema") != SCHEMA:
            raise FileFormatError(
                f"{path}: got schema {document.get('schema')!r}, expected {SCHEMA}; "
                "it was written by another version of procam"
            )
        shots = document.get("shots")
        if not isinstance(shots, list):
            raise FileFormatError(f"{path}: got no list of shots, expected one; restore the file")
        return Plan(tuple(_shot(path, entry) for entry in shots))

    def pattern(self, shot: Shot) -> NDArray[np.float32]:
        """The drive (H, W, 3) 0..1 that a shot shows."""
        pixels = np.asarray(read_image(self.directory / shot.pattern), np.float32) / 255
        return np.broadcast_to(pixels, (*pixels.shape[:2], 3))

    def stored(self, camera: str) -> dict[tuple[str, float], dict[str, Any]]:
        """Index entries of the frames that are safely on disk, by (shot, exposure)."""
        path = self._index(camera)
        entries = [_parse(path, line) for line in atomic.read_lines(path)]
        for number, entry in enumerate(entries, start=1):
            if missing := {"shot", "exposure_s", "file", "sha256"} - set(entry):
                raise FileFormatError(
                    f"{path}: line {number}: got no {', '.join(sorted(missing))}, expected a "
                    "capture's entry; restore the file or remove the line and capture again"
                )
        there = (e for e in entries if (path.parent / e["file"]).is_file())
        return {(e["shot"], e["exposure_s"]): e for e in there}

    def store(self, camera: str, shot: Shot, exposure_s: float, frame: Frame) -> None:
        """Put a frame on disk, then name it in the index: what is named is there."""
        name = f"{shot.id}@{exposure_s:g}.tif"
        path = self.directory / "captures" / camera / name
        write_image(path, frame.counts)
        entry = {
            "shot": shot.id,
            "file": name,
            "exposure_s": exposure_s,
            "gain": frame.settings.gain,
            "pixel_format": frame.settings.pixel_format,
            "started_s": frame.started_s,
            "ended_s": frame.ended_s,
            "sha256": hashlib.sha256(np.ascontiguousarray(frame.counts).data).hexdigest(),
        }
        atomic.append_line(self._index(camera), json.dumps(entry))

    def load(self, camera: str, shot: Shot, exposure_s: float, size: tuple[int, int]) -> Frame:
        """A stored frame, checked: present, whole, of the camera's size, and not swapped."""
        entry = self.stored(camera).get((shot.id, exposure_s))
        folder = self.directory / "captures" / camera
        if entry is None:
            raise FileFormatError(
                f"{folder}: got no capture of shot {shot.id} at {exposure_s:g} s, expected one; "
                "run `procam capture` on this venue again: it takes only what is missing"
            )
        path = folder / str(entry["file"])
        pixels = read_image(path)
        counts = np.asarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels)
        self._check(path, counts, entry, size)
        pixel_format: PixelFormat = "mono" if counts.ndim == 2 else "rgb"
        settings = CameraSettings(exposure_s, pixel_format, entry["gain"])
        return Frame(counts.astype(np.uint16), settings, entry["started_s"], entry["ended_s"])

    def _check(
        self,
        path: Path,
        counts: NDArray[np.generic],
        entry: dict[str, Any],
        size: tuple[int, int],
    ) -> None:
        height, width = counts.shape[:2]
        if (width, height) != tuple(size):
            raise FileFormatError(
                f"{path}: got {width}x{height} px, expected {size[0]}x{size[1]} as venue.toml "
                "says; capture it again or correct the camera's size"
            )
        if hashlib.sha256(np.ascontiguousarray(counts).data).hexdigest() != entry["sha256"]:
            raise FileFormatError(
                f"{path}: got other pixels than were captured for shot {entry['shot']} (swapped "
                "or edited file), expected the stored ones; restore it or delete the file and its "
                "line in index.jsonl and capture again"
            )

    def _index(self, camera: str) -> Path:
        return self.directory / "captures" / camera / "index.jsonl"


def _shot(path: Path, entry: dict[str, Any]) -> Shot:
    try:
        exposures: tuple[float, ...] = tuple(entry.pop("exposures_s"))
        return Shot(exposures_s=exposures, **entry)
    except (AttributeError, KeyError, TypeError) as error:
        raise FileFormatError(
            f"{path}: got a shot that does not fit ({error}), expected id, projector, pattern, "
            "purpose, exposures_s"
        ) from error


def _parse(path: Path, text: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{path}: got damaged JSON ({error}); restore the file") from error
    if not isinstance(document, dict):
        raise FileFormatError(f"{path}: got a {type(document).__name__}, expected an object")
    return document
