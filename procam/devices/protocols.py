"""The interfaces of a camera, a projector, its remote control and a clock.

The calls block: a projector and a camera that take turns need neither asyncio nor threads.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from procam.arrays import Array32
from procam.model.frame import CameraSettings, Frame


class Power(StrEnum):
    """Power states that a projector reports."""

    STANDBY = "standby"
    WARMING = "warming"
    ON = "on"
    COOLING = "cooling"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Shown:
    """The drive that a projector shows, after its quantisation, and the time since when [s]."""

    drive: Array32
    at_s: float


@dataclass(frozen=True, slots=True)
class ControlState:
    """State read over a projector's remote control.

    Attributes
    ----------
    power : power state.
    shuttered : True when the picture is dark (shutter or A/V mute); None if unknown in this state.
    source : code of the active input; None if unknown in this state.
    lamp_hours : hours on the light source; None if unknown in this state.
    errors : faults that the projector reports, in words.
    """

    power: Power
    shuttered: bool | None = None
    source: str | None = None
    lamp_hours: int | None = None
    errors: tuple[str, ...] = ()


class Clock(Protocol):
    """Real time, or the simulated time of a scene."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start [s]."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` [s]."""
        ...


class SystemClock:
    """The time of real devices; backends use it, so that devices of several work together."""

    def now_s(self) -> float:
        """Seconds since the computer was started [s]."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` [s]."""
        time.sleep(duration_s)


class Camera(Protocol):
    """A camera on a tripod."""

    name: str
    size: tuple[int, int]

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Request settings; returns those that are in force."""
        ...

    def capture(self) -> Frame:
        """Take one picture with the settings in force."""
        ...


class Projector(Protocol):
    """The picture input of a projector."""

    name: str
    size: tuple[int, int]

    def show(self, drive: Array32) -> Shown:
        """Show `drive`, (H, W, 3) in 0..1; returns once it is on the screen."""
        ...


class ProjectorControl(Protocol):
    """The remote control of a projector."""

    def state(self) -> ControlState:
        """Read everything that can be read in this power state."""
        ...

    def set_power(self, on: bool) -> None:
        """Switch on (returns when the picture is up) or to standby."""
        ...

    def set_shutter(self, closed: bool) -> None:
        """Close or open the shutter; returns when the projector has confirmed it."""
        ...

    def set_input(self, source: str) -> None:
        """Select an input by the projector's code for it."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


@dataclass(frozen=True, slots=True)
class BackendRig:
    """What a backend's `open_rig(settings, venue_dir)` returns.

    Attributes
    ----------
    cameras, projectors : devices by name.
    clock : the time of these devices.
    ports : serial device path by projector name, for remote controls on the backend's own ports.
    closers : called in order when the rig is closed.
    """

    cameras: Mapping[str, Camera]
    projectors: Mapping[str, Projector]
    clock: Clock
    ports: Mapping[str, str] = field(default_factory=dict)
    closers: tuple[Callable[[], None], ...] = ()
