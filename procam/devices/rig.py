"""All devices of a venue by name; every projector is left dark, also after an error."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np

from procam.devices.control.projector_control import open_serial_control
from procam.devices.interrupts import current_run, interruptible, uninterruptible
from procam.devices.protocols import BackendRig, Camera, Clock, Power, Projector, ProjectorControl
from procam.errors import DeviceError, InputError

FROM_BACKEND = "backend"  # a control port that the backend provides
# of a lamp at the longest; three tries to ignite it take 100 s
WARM_UP_S, WARM_UP_POLL_S = 240.0, 1.0


@dataclass
class Rig:
    """Cameras, projectors and remote controls by name.

    A context manager: at the end every projector is shuttered, or shows black where it has no
    shutter, and all connections are closed. Only the first signal interrupts it.

    Attributes
    ----------
    borrowed : projectors whose lamps were off before; they are switched off at the end.
    dark : whether the rig was left, and all projectors are confirmed to be dark.
    """

    cameras: Mapping[str, Camera]
    projectors: Mapping[str, Projector]
    controls: Mapping[str, ProjectorControl]
    clock: Clock
    closers: tuple[Callable[[], None], ...] = field(default=())
    borrowed: list[str] = field(default_factory=list)
    dark: bool = field(default=False, init=False)
    _stack: ExitStack = field(default_factory=ExitStack, init=False, repr=False)

    @uninterruptible
    def __enter__(self) -> Self:
        run = self._stack.enter_context(interruptible())
        run.unfinished.append(self._leave)
        run.rigs.append(self)
        self.dark = False
        try:
            run.raise_pending()
        except KeyboardInterrupt:
            self.__exit__()
            raise
        return self

    @uninterruptible
    def __exit__(self, *_: object) -> None:
        with self._stack:
            self._leave()

    def _leave(self) -> None:
        """Make all projectors dark and close all connections; what fails is reported at the end."""
        lit = self.darken_all()
        try:
            with ExitStack() as stack:
                stack.callback(self._release)
                self._return_lamps()
        finally:
            run = current_run()
            self.dark = not lit
            if self._leave in run.unfinished:
                run.unfinished.remove(self._leave)
            if lit:  # whatever else went wrong
                _tell_lit(lit)

    def _return_lamps(self) -> None:
        """Switch off the lamps that were off before; those that stay on are reported together."""
        on = dict[str, Exception]()
        for name in self.borrowed:
            try:
                if self.controls[name].state().power is Power.ON:
                    self.controls[name].set_power(False)
            except Exception as error:  # the others must go off all the same
                on[name] = error
        if on:
            named = ", ".join(f"{name} ({error})" for name, error in on.items())
            raise DeviceError(
                f"lamps that were off before may still be on: {named}; switch them off by hand"
            ) from next(iter(on.values()))

    def _release(self) -> None:
        """Close all connections, leaving the projectors as they are."""
        with ExitStack() as stack:
            for closer in self.closers:
                stack.callback(closer)
            for control in self.controls.values():
                stack.callback(control.close)

    def start(self) -> None:
        """Switch every projector on, wait for its lamp and make it dark; without a control it shows black."""
        for name, control in self.controls.items():
            if control.state().power is not Power.ON:
                self._show_black(name)  # a lamp that warms up refuses its shutter
                control.set_power(True)
        for name in self.projectors:
            self.darken(name)

    def light(self, name: str) -> None:
        """Open the shutter of one projector."""
        if name in self.controls:
            self.controls[name].set_shutter(False)

    def darken(self, name: str) -> None:
        """Show black, and close the shutter where there is one that works."""
        try:
            self._show_black(name)
        finally:  # a picture that cannot be shown is the more reason to close the shutter
            if name in self.controls:
                shut(self.controls[name], self.clock)

    def darken_all(self) -> dict[str, Exception]:
        """Make all projectors dark; what failed, by the projectors that may still be lit."""
        lit = dict[str, Exception]()
        for name in self.projectors:
            try:
                self.darken(name)
            except Exception as error:  # the others must be dark all the same
                lit[name] = error
        return lit

    def _show_black(self, name: str) -> None:
        width, height = self.projectors[name].size
        self.projectors[name].show(np.zeros((height, width, 3), np.float32))


def shut(control: ProjectorControl, clock: Clock) -> None:
    """Close a shutter whose lamp is on.

    A projector that is warming up refuses its shutter, so this waits until the lamp is on or fails;
    otherwise the dome would be lit a minute after the run has ended.
    """
    deadline_s = clock.now_s() + WARM_UP_S
    while (power := control.state().power) is Power.WARMING and clock.now_s() < deadline_s:
        clock.sleep(WARM_UP_POLL_S)
    if power in (Power.WARMING, Power.ON):
        control.set_shutter(True)


def known_backends() -> list[str]:
    """Names of the backends that are installed."""
    return sorted(entry_points(group="procam.backends").names)


def open_backend(name: str, settings: Mapping[str, Any], venue_dir: Path) -> BackendRig:
    """Open the devices of a backend, found by its entry point in group `procam.backends`."""
    known = entry_points(group="procam.backends")
    if name not in known.names:
        raise InputError(
            f"backend {name!r} is not installed; choose one of {', '.join(sorted(known.names))}, or "
            "install the package that provides it"
        )
    rig: BackendRig = known[name].load()(settings, venue_dir)
    return rig


def open_control(projector: str, protocol: str, port: str, backend: BackendRig) -> ProjectorControl:
    """The remote control of one projector; port "backend" is the one that the backend provides."""
    path = backend.ports.get(projector) if port == FROM_BACKEND else port
    if path is None:
        raise DeviceError(
            f"projector {projector}: its backend provides no control port; replace {FROM_BACKEND!r} by a "
            "device path such as /dev/ttyUSB0"
        )
    return open_serial_control(path, protocol, clock=backend.clock, name=projector)


def _tell_lit(lit: Mapping[str, Exception]) -> NoReturn:
    """Name the projectors that could not be made dark, and why."""
    first = next(iter(lit.values()))
    kind = type(first) if isinstance(first, DeviceError) else DeviceError
    named = ", ".join(f"{name} ({error})" for name, error in lit.items())
    raise kind(
        f"a projector may still be lit: {named}; close its shutter or switch it off by hand"
    ) from first
