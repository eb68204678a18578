"""Devices without hardware, for tests of what makes them dark."""

import numpy as np

from procam.devices.protocols import ControlState, Power, Shown
from procam.errors import DeviceTimeout, WrongState

SIZE = 8, 6


def nothing() -> None:
    """What happens meanwhile, until a test has other plans."""


class Projector:
    """`meanwhile` happens while it is given light."""

    def __init__(self, name: str = "p", *, lit: bool = False) -> None:
        self.name, self.size = name, SIZE
        self.lit, self.times_lit, self.meanwhile = lit, 0, nothing

    def show(self, drive: np.ndarray) -> Shown:
        assert drive.shape == (*SIZE[::-1], 3)
        if drive.any():
            self.times_lit += 1
            self.meanwhile()
        self.lit = bool(drive.any())
        return Shown(drive, 0.0)


class Control:
    """Logs its orders; `meanwhile` happens in those that may light."""

    def __init__(
        self, name: str = "p", power: Power = Power.ON, log: list[str] | None = None
    ) -> None:
        self.name, self.power, self.log = name, power, [] if log is None else log
        self.open, self.broken, self.meanwhile = False, False, nothing

    def state(self) -> ControlState:
        if self.broken:
            raise DeviceTimeout("nobody home")
        return ControlState(self.power)

    def set_power(self, on: bool) -> None:
        self.meanwhile()
        self.power = Power.ON if on else Power.STANDBY
        self.open = self.open or on
        self.log.append(f"{self.name} power {on}")

    def set_shutter(self, closed: bool) -> None:
        if self.power is not Power.ON:
            raise WrongState("switch it on first")
        if not closed:
            self.meanwhile()
        self.open = not closed
        self.log.append(f"{self.name} shutter {closed}")

    def set_input(self, source: str) -> None:
        self.meanwhile()
        self.log.append(f"{self.name} input {source}")

    def close(self) -> None:
        self.log.append(f"{self.name} close")


class Clock:
    """Time that goes by in no time; `due` is called each time."""

    def __init__(self) -> None:
        self.t_s, self.due = 0.0, nothing

    def now_s(self) -> float:
        return self.t_s

    def sleep(self, duration_s: float) -> None:
        self.t_s += duration_s
        self.due()
