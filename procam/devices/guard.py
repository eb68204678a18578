"""A rig whose light can be taken away at any moment by another thread, while a call to a device hangs.

`Guard.close` is for good: from then on whatever would light a projector raises instead, and a call that
was already on its way is followed by black and a closed shutter. Black and shutters go through as ever.
"""

import _thread
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from queue import Empty
from typing import Self

import numpy as np

from procam.arrays import Array32
from procam.devices.protocols import Camera, Clock, ControlState, Projector, ProjectorControl, Shown
from procam.devices.rig import Rig, shut
from procam.errors import DeviceError, ProcamError
from procam.model.frame import CameraSettings, Frame
from procam.threads import Future, ThreadPool

TURN_S = 0.3  # that black waits for a picture that is just being shown by another thread
POLL_S = 0.02


class Gate:
    """Whether projectors may be lit: open, until it is closed for good."""

    def __init__(self) -> None:
        self.closed: ProcamError | None = None

    def check(self) -> None:
        """Raise why projectors may not be lit, if so."""
        if self.closed is not None:
            raise type(self.closed)(str(self.closed))


class _GuardedCamera:
    """A camera whose photographs count only if no light was taken away meanwhile."""

    def __init__(self, camera: Camera, gate: Gate) -> None:
        self.name, self.size = camera.name, camera.size
        self._camera, self._gate = camera, gate

    def configure(self, settings: CameraSettings) -> CameraSettings:
        self._gate.check()
        return self._camera.configure(settings)

    def capture(self) -> Frame:
        self._gate.check()
        frame = self._camera.capture()
        self._gate.check()
        return frame


class _GuardedProjector:
    """A picture input; black waits at most TURN_S for its turn."""

    def __init__(self, projector: Projector, gate: Gate) -> None:
        self.name, self.size = projector.name, projector.size
        self._projector, self._gate, self._turn = projector, gate, _thread.allocate_lock()

    def show(self, drive: Array32) -> Shown:
        if not np.any(drive):
            return self._show_black(drive)
        try:
            with self._turn:
                self._gate.check()
                return self._projector.show(drive)
        finally:
            if self._gate.closed is not None:  # before or while it was shown
                self._show_black(np.zeros_like(drive))
                self._gate.check()

    def _show_black(self, black: Array32) -> Shown:
        turn = self._turn.acquire(timeout=TURN_S)
        try:
            return self._projector.show(black)
        finally:
            if turn:
                self._turn.release()


@dataclass(frozen=True)
class _GuardedControl:
    """A remote control; its own exchanges take turns already.

    `on_its_way` has an entry for each call that may still light the projector.
    """

    control: ProjectorControl
    gate: Gate
    clock: Clock
    on_its_way: list[None] = field(default_factory=list)

    def state(self) -> ControlState:
        return self.control.state()

    def set_power(self, on: bool) -> None:
        self._set(partial(self.control.set_power, on), lit=on)

    def set_shutter(self, closed: bool) -> None:
        self._set(partial(self.control.set_shutter, closed), lit=not closed)

    def set_input(self, source: str) -> None:
        self._set(partial(self.control.set_input, source), lit=True)

    def close(self) -> None:
        self.control.close()

    def _set(self, call: Callable[[], None], lit: bool) -> None:
        if not lit:
            call()
            return
        self.on_its_way.append(None)
        try:
            self._light(call)
        finally:
            self.on_its_way.pop()

    def _light(self, call: Callable[[], None]) -> None:
        self.gate.check()
        try:
            call()
        finally:
            if self.gate.closed is not None:
                shut(self.control, self.clock)
                self.gate.check()


class Guard:
    """Makes a rig dark from any thread; `rig` is the rig to use from now on.

    A context manager, whose end is after that of the rig. All that darkness needs is there from the
    beginning: threads, and black pictures.
    """

    def __init__(self, rig: Rig) -> None:
        self._gate = gate = Gate()
        controls = {n: _GuardedControl(each, gate, rig.clock) for n, each in rig.controls.items()}
        self.rig = Rig(
            {name: _GuardedCamera(camera, gate) for name, camera in rig.cameras.items()},
            {name: _GuardedProjector(each, gate) for name, each in rig.projectors.items()},
            controls,
            rig.clock,
            rig.closers,
        )
        black = {
            n: np.zeros((p.size[1], p.size[0], 3), np.float32) for n, p in rig.projectors.items()
        }
        self._tasks: list[tuple[str, Callable[[], object]]] = [
            *((n, partial(p.show, black[n])) for n, p in self.rig.projectors.items()),
            *((n, partial(self._shut, c)) for n, c in controls.items()),
        ]
        self._futures = dict[int, Future[object]]()  # of tasks that have not ended, by index
        self._threads = ThreadPool(len(self._tasks), TURN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.__exit__(*error)

    @property
    def closed(self) -> ProcamError | None:
        """Why projectors may not be lit any more."""
        return self._gate.closed

    def check(self) -> None:
        """Raise why projectors may not be lit any more, if so."""
        self._gate.check()

    def close(self, why: ProcamError, patience_s: float) -> dict[str, str]:
        """Make all projectors dark, for good, all at once.

        Returns those that may still be lit after `patience_s` [s], and why. What did not answer by
        then goes on.
        """
        self._gate.closed = self._gate.closed or why
        deadline_s, lit = time.monotonic() + patience_s, dict[str, str]()
        for index, (_, task) in enumerate(self._tasks):
            if index not in self._futures:
                self._futures[index] = self._threads.submit(task)
        for index, (name, _) in enumerate(self._tasks):
            try:
                self._futures[index].result(max(0.0, deadline_s - time.monotonic()))
            except Empty:
                lit[name] = f"no answer within {patience_s:g} s"
                continue
            except BaseException as error:  # also a driver's SystemExit, which would end a watchdog
                lit[name] = str(error) or type(error).__name__
            del self._futures[index]
        return lit

    def _shut(self, control: _GuardedControl) -> None:
        try:
            control.set_shutter(True)  # at once; what else there is to know takes longer
        except DeviceError:
            shut(control, self.rig.clock)
        if control.on_its_way:  # a lamp that is off may have been switched on
            while control.on_its_way:
                time.sleep(POLL_S)
            shut(control, self.rig.clock)
