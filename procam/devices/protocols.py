"""What procam asks of a camera, a projector, its remote control and a clock.

Small blocking protocols: a projector and a camera taking turns need neither asyncio nor threads.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
    """What a projector really shows: the drive after its own quantisation, and since when."""

    drive: NDArray[np.float32]
    at_s: float


@dataclass(frozen=True, slots=True)
class ControlState:
    """State read over a projector's remote control.

    Attributes
    ----------
    power : power state.
    shuttered : True when the picture is dark (shutter or A/V mute); None when it cannot be asked now.
    source : active input in the projector's own words; None when it cannot be asked now.
    lamp_hours : hours on the light source; None when it cannot be asked now.
    errors : what the projector complains of, in words; empty when it is well.
    """

    power: Power
    shuttered: bool | None = None
    source: str | None = None
    lamp_hours: int | None = None
    errors: tuple[str, ...] = ()


class Clock(Protocol):
    """Real time, or a scene's own free time."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start [s]."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Let `duration_s` pass [s]."""
        ...


class Camera(Protocol):
    """A camera on a tripod."""

    name: str
    size: tuple[int, int]

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Ask for settings; returns the ones really set."""
        ...

    def capture(self) -> Frame:
        """Take one picture with the settings in force."""
        ...


class Projector(Protocol):
    """The picture input of a projector."""

    name: str
    size: tuple[int, int]

    def show(self, drive: NDArray[np.float32]) -> Shown:
        """Show `drive`, (H, W, 3) in 0..1; returns once it is on the screen."""
        ...


class ProjectorControl(Protocol):
    """The remote control of a projector."""

    def state(self) -> ControlState:
        """Ask for everything that can be asked in this power state."""
        ...

    def set_power(self, on: bool) -> None:
        """Switch on (returns when the picture is up) or to standby."""
        ...

    def set_shutter(self, closed: bool) -> None:
        """Make the picture dark or let it out; returns when the projector has confirmed it."""
        ...

    def set_input(self, source: str) -> None:
        """Select an input by the projector's own word for it."""
        ...

    def close(self) -> None:
        """Let go of the wire."""
        ...


@dataclass(frozen=True, slots=True)
class BackendRig:
    """What a backend's `open_rig(settings, venue_dir)` returns.

    Attributes
    ----------
    cameras, projectors : devices by name.
    clock : the time they live in.
    ports : serial device path by projector name, for remote controls on the backend's own wires.
    closers : called in order when the rig is let go.
    """

    cameras: Mapping[str, Camera]
    projectors: Mapping[str, Projector]
    clock: Clock
    ports: Mapping[str, str] = field(default_factory=dict)
    closers: tuple[Callable[[], None], ...] = ()
