"""Entry point of the simulated backend: makes devices of its table of venue.toml."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from procam.devices.protocols import BackendRig, Projector
from procam.errors import InputError
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.drawn_rooms import draw_room
from simulators.drifts import Drift, drifted
from simulators.faults import apply_faults
from simulators.presets import PRESETS, Preset, PresetName
from simulators.projector_state import ProjectorState
from simulators.scene import DomeScene, SceneSize
from simulators.serial_port import EmulatedEscVp21
from simulators.server import NAME as SERVER
from simulators.server import MediaServer, Relay, SimulatedServer
from simulators.walled_room import WalledSurface
from simulators.walls import walls_of

Size = tuple[int, int]


class Walls(BaseModel):
    """[simulated.walls]: a room of walls as it is built, which venue.toml may not know exactly.

    `lengths` [m] and arc [degrees] are those of `walls.walls_of`; `lit` walls have the preset's paint.
    """

    model_config = ConfigDict(extra="forbid")
    kind: Literal["box", "cylinder", "L"]
    lengths: dict[str, float]
    lit: list[str]
    others: dict[str, float] = Field(default_factory=dict)
    other_albedo: float = Field(default=0.2, ge=0, le=0.95)
    patch_m: float = Field(default=0.25, gt=0)

    def surface(self, preset: Preset) -> WalledSurface:
        """The walls under a preset's paint."""
        walls = walls_of(self.kind, self.lengths)
        others = {w.name: self.others.get(w.name, self.other_albedo) for w in walls}
        return WalledSurface(preset, tuple(walls), frozenset(self.lit), others, self.patch_m)


class Settings(BaseModel):
    """[simulated] in venue.toml: which dome, how many devices, and the seed of its noise."""

    model_config = ConfigDict(extra="forbid")
    preset: PresetName = "standard"
    seed: int = Field(default=1, ge=0)
    projectors: int = Field(default=2, ge=1, le=6)
    projector_size: Size = (1280, 800)
    cameras: int = Field(default=1, ge=1, le=4)
    camera_size: Size = (1600, 1600)
    camera_kind: Literal["fisheye", "pinhole"] = "fisheye"
    rays: int = Field(default=2048, ge=64)
    server: bool = False  # the projectors are behind a media server
    server_size: int = Field(default=1024, ge=64, le=8192)
    server_fov_deg: float = Field(default=180, ge=20, le=250)  # of its masters
    server_rotation_deg: float = Field(default=0, ge=-360, le=360)  # azimuth of their bottom edge
    room: int | None = Field(
        default=None, ge=0
    )  # drawn at random by this number, in place of the preset
    walls: Walls | None = None  # in place of the dome
    # simulators.presets.Overrides
    albedo: float | None = Field(default=None, ge=0, le=0.95)
    snr: float | None = Field(default=None, gt=0, le=1000)  # 12 bits carry no more
    defocus_px: float | None = Field(default=None, ge=0, le=20)
    gamma_left: float | None = Field(default=None, ge=0.1, le=10)
    features: dict[str, dict[str, float]] = Field(default_factory=dict)  # by projector
    drifts: tuple[Drift, ...] = ()  # changes since the venue was calibrated
    session: int = Field(default=0, ge=0)  # another one has other noise


def read_settings(settings: Mapping[str, Any], venue_dir: Path) -> Settings:
    """A [simulated] table, checked."""
    try:
        return Settings.model_validate(settings)
    except ValidationError as error:
        lines = [
            f"{venue_dir / 'venue.toml'}: simulated.{'.'.join(map(str, e['loc']))} is "
            f"{e['input']!r}; {_reason(e['msg'])}"
            for e in error.errors()
        ]
        raise InputError("\n".join(lines)) from error


def _reason(message: str) -> str:
    return message.replace("Input should", "it must").removeprefix("Value error, ")


def build_scene(settings: Mapping[str, Any], venue_dir: Path) -> DomeScene:
    """The scene of a [simulated] table."""
    s = read_settings(settings, venue_dir)
    size = SceneSize(
        s.projectors, s.projector_size, s.cameras, s.camera_size, s.camera_kind, s.rays
    )
    drawn = PRESETS[s.preset] if s.room is None else draw_room(s.room, s.camera_size).preset
    preset = drawn.altered(
        albedo=s.albedo, snr=s.snr, defocus_px=s.defocus_px, gamma_left=s.gamma_left
    )
    preset = preset.with_features(s.features)
    surface = s.walls.surface(preset) if s.walls else None
    scene = DomeScene(preset, size, s.seed, surface=surface)
    return drifted(scene, s.drifts, s.session) if s.drifts or s.session else scene


def build_server(
    scene: DomeScene, settings: Mapping[str, Any], venue_dir: Path
) -> MediaServer | None:
    """The media server before the projectors of a scene, if the table has one."""
    s = read_settings(settings, venue_dir)
    if not s.server:
        return None
    return MediaServer(
        scene, s.server_size, np.radians(s.server_fov_deg), np.radians(s.server_rotation_deg)
    )


def open_rig(settings: Mapping[str, Any], venue_dir: Path) -> BackendRig:
    """Open the simulated venue: one scene, its cameras and projectors, a serial port for each.

    A media server has one input and one serial port for all projectors.
    """
    scene = build_scene(settings, venue_dir)
    server = build_server(scene, settings, venue_dir)
    projectors: dict[str, Projector] = {}
    if server:
        states: dict[str, ProjectorState] = {SERVER: Relay(scene)}
        projectors[SERVER] = SimulatedServer(scene, server)
    else:
        states = scene.states
        projectors |= {name: SimulatedProjector(scene, name) for name in scene.lights}
    wires = {name: EmulatedEscVp21(state) for name, state in states.items()}
    rig = BackendRig(
        {name: SimulatedCamera(scene, name) for name in scene.cameras},
        projectors,
        scene.clock,
        {name: wire.port for name, wire in wires.items()},
        tuple(wire.close for wire in wires.values()),
    )
    return apply_faults(rig, wires, scene.preset.faults)
