"""A simulated venue small enough to capture and solve in less than a second."""

import io
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

import procam.devices.control.projector_control as controls
import simulators.backend
from procam.devices.protocols import BackendRig
from procam.files.session import Session
from procam.files.venue.load import Venue, load_venue
from procam.generators import result_of
from procam.interfaces.cli.main import app, main
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig
from simulators import transport
from simulators.devices import SimulatedCamera
from simulators.presets import Preset, PresetName
from simulators.scene import DomeScene, SceneSize
from simulators.serial_port import EmulatedEscVp21
from simulators.surface import Surface
from simulators.template import venue_text
from simulators.transport import Room

CAMERA = "zenith"
TINY = SceneSize(
    projectors=1, projector_size=(128, 80), camera_size=(200, 200), rays=64, map_size=128
)
TINY_PAIR = replace(TINY, projectors=2)
QUIET_S = 0.01  # silence after which nothing more comes from a pseudo terminal
WRITTEN_AT = re.compile(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d")
HEADER = 4096
HISTORY = "history.sqlite", "history.sqlite-wal", "history.sqlite-shm"

_trace = Room.trace


@cache
def _traced(preset: Preset, rays: int, _patches: tuple[int, int]) -> Room:
    return _trace(Surface.build(preset), rays)


def _patches() -> tuple[int, int]:
    """The present numbers of patches; tests may reduce them."""
    return transport.DOME_RINGS, transport.DOME_SECTORS


@contextmanager
def quick_simulator() -> Iterator[None]:
    """Trace each preset's room once per process, and do not wait as long as for a real cable.

    Rooms are never changed, so venues can share one.
    """
    table = controls.SERIAL_TABLES["escvp21"]
    quick = replace(table, timings=replace(table.timings, quiet_s=QUIET_S))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            Room, "trace", lambda surface, rays: _traced(surface.preset, rays, _patches())
        )
        patch.setattr(controls, "SERIAL_TABLES", {**controls.SERIAL_TABLES, "escvp21": quick})
        yield


def make_venue(directory: Path, preset: PresetName = "standard", size: SceneSize = TINY) -> Venue:
    """Write and load DIRECTORY/venue.toml."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "venue.toml").write_text(venue_text(preset, size), "utf-8")
    return load_venue(directory)


def take_session(venue: Venue) -> Session:
    """Capture VENUE/sessions/0001, or what is missing of it."""
    session = prepare_session(venue, venue.directory / "sessions" / "0001")
    with open_rig(venue) as rig:
        for _ in capture(rig, venue, session):
            pass
    return session


def solved(venue: Venue, session: Session) -> Path:
    """Calibrate; returns the new calibration's folder."""
    return result_of(solve(venue, session)).directory


def calibrated(directory: Path, size: SceneSize = TINY) -> Venue:
    """A venue that was captured and calibrated once."""
    venue = make_venue(directory, size=size)
    solved(venue, take_session(venue))
    return venue


def drift(venue_dir: Path, *drifts: str) -> None:
    """Change the simulated dome, by tables of `drifts` in venue.toml."""
    with (venue_dir / "venue.toml").open("a") as file:
        file.write(f"session = 1\ndrifts = [{', '.join(drifts)}]\n")


def contents(directory: Path) -> dict[str, bytes]:
    """Every file under a folder by relative path, without times of picture headers and the history."""
    files = (p for p in sorted(directory.rglob("*")) if p.is_file() and p.name not in HISTORY)
    return {str(p.relative_to(directory)): _timeless(p.read_bytes()) for p in files}


def _timeless(content: bytes) -> bytes:
    return WRITTEN_AT.sub(b"", content[:HEADER]) + content[HEADER:]


@dataclass(frozen=True)
class Ran:
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line of an error; with --json the same as a document."""
        lines = self.err.splitlines()
        assert len(lines) == 1 and lines[0].startswith("procam: "), self
        if self.out:
            document = {"error": lines[0].removeprefix("procam: "), "exit_code": self.code}
            assert json.loads(self.out) == document
        return lines[0]


def procam(*arguments: object, command: Callable[[], object] = app) -> Ran:
    """Run `procam ARGUMENTS`, or another `command` of this kind, in this process."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["procam", *map(str, arguments)])
        try:
            main(command)
        except SystemExit as stop:
            code = int(stop.code or 0)
    return Ran(code, out.getvalue(), err.getvalue())


def refused(*arguments: object) -> str:
    """Run `procam ARGUMENTS`, which refuses its input; the one line that says why."""
    ran = procam(*arguments)
    assert ran.code == 2, ran
    return ran.complaint


def warped(*arguments: object) -> Ran:
    """Run `procam compensate ARGUMENTS`, to frames of projectors of what is direct light already."""
    return procam("compensate", *arguments, "--to", "projectors", "--method", "none")


@dataclass
class Stage:
    """The scene, cameras and wires of the venue that was opened last."""

    scene: DomeScene
    wires: Mapping[str, EmulatedEscVp21]
    backend: BackendRig

    def lit(self) -> list[str]:
        """Projectors whose light reaches the dome now."""
        return [n for n, state in self.scene.states.items() if state.light_factor() > 0]


def watch_stage(
    monkeypatch: pytest.MonkeyPatch, alter: Callable[[Stage], BackendRig] = lambda s: s.backend
) -> list[Stage]:
    """Stages of the venues that are opened from now on; `alter` may replace their devices."""
    stages: list[Stage] = []
    faults = simulators.backend.apply_faults
    scenes: list[DomeScene] = []
    build = simulators.backend.build_scene

    def building(*where: object) -> DomeScene:
        scenes.append(build(*where))  # type: ignore[arg-type]
        return scenes[-1]

    def faulty(rig: BackendRig, wires: dict[str, EmulatedEscVp21], names: tuple[str, ...]):
        stages.append(Stage(scenes[-1], wires, faults(rig, wires, names)))
        return alter(stages[-1])

    monkeypatch.setattr(simulators.backend, "build_scene", building)
    monkeypatch.setattr(simulators.backend, "apply_faults", faulty)
    return stages


def replace_camera(rig: BackendRig, wrap: Callable[[SimulatedCamera], object]) -> BackendRig:
    """The rig with every camera wrapped in another."""
    return replace(rig, cameras={n: wrap(c) for n, c in rig.cameras.items()})  # type: ignore[arg-type, misc]


def one_thread() -> None:
    """Use no pool threads in this process, because it will be forked."""
    import cv2
    import OpenImageIO as oiio

    cv2.setNumThreads(1)
    oiio.attribute("threads", 1)
    assert os.environ.get("OPENBLAS_NUM_THREADS") == "1"
