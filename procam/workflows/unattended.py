"""Runs with nobody there: only in their time, only if an interlock says that nobody is in the dome.

Projectors are dangerous to look into, so a scheduler may light them only where venue.toml says when, and
names a command that knows whether the dome is empty. It is asked before the first lamp is lit, and then
twice a second by a watchdog. The rig is opened once, outside the workflow, and belongs to the run.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from datetime import datetime, time
from functools import partial
from signal import SIGINT, Signals

from procam.devices.guard import Guard
from procam.devices.interrupts import Run, current_run
from procam.devices.protocols import Power
from procam.devices.rig import Rig
from procam.errors import DeviceError, InputError, ProcamError
from procam.files.venue.commands import command_words
from procam.files.venue.load import Venue
from procam.files.venue.tables import UnattendedTable
from procam.workflows.events import Result, Steps
from procam.workflows.programs import run_program
from procam.workflows.venue_rig import open_rig, rig_owner
from procam.workflows.watchdog import LATE_S, Stopped, Watchdog, ask, print_line, state_in_words

NOTIFY_S = 10.0
SOMEBODY = "somebody may be in the dome"
DARK = "; all projectors are dark"


class Unattended:
    """Leave to light the projectors of a venue, and whom to notify."""

    def __init__(self, venue: Venue, command: str) -> None:
        table, self._path = venue.table.unattended, venue.directory / "venue.toml"
        if table is None:
            raise InputError(
                f"{self._path}: --unattended needs [unattended] with interlock, a command that ends with 0 "
                'if nobody is in the dome, and begin and end, such as "03:00" and "05:30"'
            )
        self._venue, self._table, self._command = venue, table, command
        self._late = (
            f"{self._path}: unattended.interlock gave no answer within {LATE_S:g} s: {SOMEBODY}"
        )
        self._guard: Guard | None = None
        self._message, self._sent = "", False

    def rig(self) -> Rig:
        """The rig of the run."""
        assert self._guard is not None
        return self._guard.rig

    def watch(self, steps: Steps[Result]) -> Steps[Result]:
        """The events of a workflow, which ends when its light was taken, and its result."""
        assert self._guard is not None
        with closing(steps):  # also where it is between two events
            while True:
                try:
                    event = next(steps)
                except StopIteration as end:
                    return end.value
                finally:
                    self._guard.check()
                yield event

    def notify(self, text: str) -> None:
        """Have a message sent at the end, if the run ends well."""
        self._message = text

    @contextmanager
    def light(self) -> Iterator[None]:
        """Check the time, the interlock and the lamps; the rig of the block, which is left dark.

        Raises
        ------
        InputError
            It is not the time, somebody may be in the dome, or lamps are off that may not be switched on.
        """
        ask(self._check, self._late)
        with Guard(open_rig(self._venue)) as self._guard:
            watchdog = Watchdog(self._guard, self._check, self._late, self._give_up)
            with watchdog, self._guard.rig as rig:
                self._borrow_lamps(rig)
                yield

    def failure(self, error: BaseException, run: Run) -> BaseException:
        """Send what ended the run, after its rig was left; returns what to raise for it."""
        why = self._guard.closed if self._guard else None
        if why is None or isinstance(why, Stopped):
            raised = error if run.stopped_by is None or not self._is_dark else KeyboardInterrupt()
        elif self._is_dark:
            raised = type(why)(f"{why}{DARK}")
        else:  # an error of the rig names the projectors
            named = str(error) if isinstance(error, DeviceError) else "a projector may still be lit"
            raised = DeviceError(f"{why}; {named}")
        self.send(f"failed: {self._described(raised, run)}")
        return raised

    def finish(self, run: Run) -> None:
        """Send that the run was stopped, if nothing was sent: a signal came between two of its steps."""
        self.send(f"failed: {self._described(KeyboardInterrupt(), run)}")

    def succeed(self) -> None:
        """Send the message of a run that ended well."""
        self.send(self._message)

    def send(self, text: str) -> None:
        """Run the command for messages, if there is one, once; what it does wrong is printed."""
        if not self._table.notify or self._sent:
            return
        self._sent = True
        message = f"procam {self._command} {self._venue.directory.resolve().name}: {text}"
        try:
            code, printed = run_program([*command_words(self._table.notify), message], NOTIFY_S)
            problem = f"did not end within {NOTIFY_S:g} s" if code is None else f"ended with {code}"
        except (OSError, ValueError, RuntimeError) as error:
            code, printed, problem = None, "", f"cannot be run: {error}"
        if code != 0:
            print_line(
                f"note: {self._path}: unattended.notify {problem}{printed}; the message was: {message}"
            )

    @property
    def _is_dark(self) -> bool:
        """Whether the rig was left, and all projectors are confirmed to be dark."""
        return self._guard is not None and self._guard.rig.dark

    def _described(self, error: BaseException, run: Run) -> str:
        text = str(error) or type(error).__name__
        if isinstance(error, KeyboardInterrupt):
            text = f"stopped by {Signals(run.stopped_by or SIGINT).name}"
        return text if DARK in text or not self._is_dark else f"{text}{DARK}"

    def _check(self) -> None:
        """Raise unless it is the time, and the interlock says that nobody is there."""
        table = self._table
        if not _inside(table, datetime.now().time()):
            raise InputError(
                f"{self._path}: [unattended] allows to light projectors from {table.begin} to {table.end} "
                "only. Run it then"
            )
        try:
            code, printed = run_program(command_words(table.interlock), LATE_S)
        except (OSError, ValueError) as error:
            raise InputError(
                f"{self._path}: unattended.interlock cannot be run ({error}); correct it"
            ) from error
        if code is None:
            raise DeviceError(self._late)
        if code:
            raise InputError(
                f"{self._path}: unattended.interlock ended with {code}{printed}: {SOMEBODY}"
            )

    def _borrow_lamps(self, rig: Rig) -> None:
        """Note the lamps that are off, which the rig switches off again; refuse if they must stay off."""
        controls = rig.controls.items()
        off = [name for name, control in controls if control.state().power is not Power.ON]
        if off and not self._table.power_on:
            raise InputError(
                f"{self._path}: {', '.join(off)} are off, and unattended.power_on does not allow to switch "
                "lamps on; switch them on, or set power_on = true"
            )
        rig.borrowed = off

    def _give_up(self, why: ProcamError, lit: dict[str, str]) -> None:
        """End the process, whose light is gone, but which a device or a disk keeps from ending."""
        text = f"{why}; {state_in_words(lit)}. A device or a disk does not answer: the process is ended"
        try:
            self.send(f"failed: {text}")
            print_line(text)
        finally:
            os._exit(1 if isinstance(why, DeviceError) else 2)


class Attended:
    """Somebody is there: nothing is checked, and nobody needs a message. `rig` opens the rig."""

    def __init__(self, rig: Callable[[], Rig]) -> None:
        self.rig = rig

    def watch(self, steps: Steps[Result]) -> Steps[Result]:
        """The workflow as it is."""
        return steps

    def notify(self, text: str) -> None:
        """Nothing to do."""


def leave_for(
    venue: Venue, command: str, nobody_there: bool
) -> AbstractContextManager[Unattended | Attended]:
    """Leave to light the projectors of a venue for a block, with somebody there or not.

    The rig is that of the block, at whose end it is left dark.
    """
    return _unattended(venue, command) if nobody_there else _attended(venue)


@contextmanager
def _attended(venue: Venue) -> Iterator[Attended]:
    with rig_owner(venue) as rig:
        yield Attended(rig)


@contextmanager
def _unattended(venue: Venue, command: str) -> Iterator[Unattended]:
    """The same with nobody there; whatever ends the block is sent as a message, when all is dark."""
    leave, run = Unattended(venue, command), current_run()
    finish = partial(leave.finish, run)
    run.unfinished.append(finish)
    try:
        with leave.light():
            yield leave
    except BaseException as error:
        raise leave.failure(error, run) from error
    else:
        leave.succeed()
    finally:
        run.unfinished.remove(finish)


def _inside(table: UnattendedTable, now: time) -> bool:
    """Whether a local time is within the window, which may go over midnight."""
    begin, end = time.fromisoformat(table.begin), time.fromisoformat(table.end)
    return begin <= now < end if begin <= end else now >= begin or now < end
