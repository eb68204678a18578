"""Runs with nobody there: only in their time, only if an interlock says that nobody is in the dome.

Projectors are dangerous to look into, so a scheduler may light them only where venue.toml says when, and
names a command that knows whether the dome is empty. It is asked before the first lamp is lit, and again
every half minute.
"""

import shlex
import subprocess
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import datetime, time
from time import monotonic

from procam.devices.protocols import Power
from procam.errors import DeviceError, InputError, ProcamError
from procam.files.venue.load import Venue
from procam.files.venue.tables import UnattendedTable
from procam.workflows.events import Event
from procam.workflows.venue_rig import open_rig

ANSWER_S = 60.0  # for the interlock, and for the notification
INTERLOCK_EVERY_S = 30.0
SHOWN = 200  # letters of what a command printed


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
        self._switched_on: list[str] = []

    def begin(self) -> None:
        """Check the time, the interlock and the lamps.

        Raises
        ------
        InputError
            It is not the time, somebody may be in the dome, or lamps are off that may not be switched on.
        """
        self._check_time()
        self._check_interlock()
        off = self._lamps_off()
        if off and not self._table.power_on:
            raise InputError(
                f"{self._path}: {', '.join(off)} are off, and unattended.power_on does not allow to switch "
                "lamps on; switch them on, or set power_on = true"
            )
        self._switched_on = off

    def watch(self, events: Iterator[Event]) -> Iterator[Event]:
        """The events of a workflow, which is stopped when its time is over or somebody comes in."""
        asked_s = monotonic()
        for event in events:
            self._check_time()
            if monotonic() - asked_s > INTERLOCK_EVERY_S:
                self._check_interlock()
                asked_s = monotonic()
            yield event

    def end(self) -> None:
        """Switch off the lamps that were off before."""
        if not self._switched_on:
            return
        with open_rig(self._venue) as rig:
            for name in self._switched_on:
                if rig.controls[name].state().power is Power.ON:
                    rig.controls[name].set_power(False)

    def notify(self, text: str) -> None:
        """Run the command for messages, if there is one; if it fails, that is an error."""
        if not self._table.notify:
            return
        message = f"procam {self._command} {self._venue.directory.resolve().name}: {text}"
        code, printed = _run([*shlex.split(self._table.notify), message])
        if code:
            raise InputError(
                f"{self._path}: unattended.notify ended with {code}{printed}; the message was: {message}"
            )

    def _check_time(self) -> None:
        table = self._table
        if not _inside(table, datetime.now().time()):
            raise InputError(
                f"{self._path}: [unattended] allows to light projectors from {table.begin} to {table.end} "
                "only; all are dark. Run it then"
            )

    def _check_interlock(self) -> None:
        code, printed = _run(shlex.split(self._table.interlock))
        if code:
            raise InputError(
                f"{self._path}: unattended.interlock ended with {code}{printed}: somebody may be in the "
                "dome; all projectors are dark"
            )

    def _lamps_off(self) -> list[str]:
        with open_rig(self._venue) as rig:
            controls = rig.controls.items()
            return [name for name, control in controls if control.state().power is not Power.ON]


class Attended:
    """Somebody is there: nothing is checked, and nobody needs a message."""

    def watch(self, events: Iterator[Event]) -> Iterator[Event]:
        """The events as they are."""
        return events

    def notify(self, text: str) -> None:
        """Nothing to do."""


def leave_for(
    venue: Venue, command: str, nobody_there: bool
) -> AbstractContextManager[Unattended | Attended]:
    """Leave to light the projectors of a venue for a block, with somebody there or not."""
    return _unattended(venue, command) if nobody_there else nullcontext(Attended())


@contextmanager
def _unattended(venue: Venue, command: str) -> Iterator[Unattended]:
    """The same with nobody there; errors of the block are sent as messages too."""
    leave = Unattended(venue, command)
    try:
        leave.begin()
        try:
            yield leave
        finally:
            leave.end()
    except (ProcamError, OSError) as error:
        leave.notify(f"failed: {error}")
        raise


def _inside(table: UnattendedTable, now: time) -> bool:
    """Whether a local time is within the window, which may go over midnight."""
    begin, end = time.fromisoformat(table.begin), time.fromisoformat(table.end)
    return begin <= now < end if begin <= end else now >= begin or now < end


def _run(command: list[str]) -> tuple[int, str]:
    """Exit code of a command, and what it printed, for a message."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=ANSWER_S,
            check=False,
        )
    except (OSError, ValueError) as error:
        raise InputError(f"{shlex.join(command)}: {error}; correct it in [unattended]") from error
    except subprocess.TimeoutExpired as error:
        raise DeviceError(
            f"{shlex.join(command)} did not end within {ANSWER_S:g} s; nothing more was done"
        ) from error
    printed = (done.stdout + done.stderr).strip()[:SHOWN]
    return done.returncode, f" ({printed})" if printed else ""
