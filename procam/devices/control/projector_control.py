"""Remote control of projectors over a serial port: one engine for the tables of all makes.

The engine sends a command, matches the reply with the patterns of the table, and tries again after a lost
or garbled reply. Before each retry it synchronises: it sends a command without effect and waits for
silence, so that a late reply is not taken for the next one. A value that was set is read back. Several
threads may use a control: their exchanges take turns. The file is longer than 300 lines because these
steps share the state of one connection.
"""

import _thread
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from procam.devices.control.escvp21 import ESC_VP21
from procam.devices.control.serial_link import GarbledReply, SerialLink
from procam.devices.control.serial_table import Query, SerialTable
from procam.devices.protocols import Clock, ControlState, Power
from procam.errors import DeviceError, DeviceTimeout, InputError, NotConnected, WrongState

TRY_AGAIN = (DeviceTimeout, GarbledReply, NotConnected)
SERIAL_TABLES: Mapping[str, SerialTable] = {"escvp21": ESC_VP21}


def open_serial_control(
    port: str, protocol: str, *, clock: Clock, name: str
) -> "SerialProjectorControl":
    """Open the remote control of the projector on a serial port.

    Parameters
    ----------
    port : device path.
    protocol : key of `SERIAL_TABLES`.
    clock : the time of the projector.
    name : the projector's name, for messages.

    Raises
    ------
    InputError
        `protocol` is not in the table.
    NotConnected
        The port cannot be opened.
    """
    if protocol not in SERIAL_TABLES:
        raise InputError(
            f"projector {name}: serial protocol {protocol!r} is not known; choose one of "
            f"{', '.join(SERIAL_TABLES)}"
        )
    table = SERIAL_TABLES[protocol]
    try:
        link = SerialLink(port, baud_rate=table.baud_rate)
    except NotConnected as error:
        raise NotConnected(f"projector {name}: {error}") from error
    return SerialProjectorControl(link, table, clock=clock, name=name)


class SerialProjectorControl:
    """A projector on a serial port; implements `ProjectorControl`.

    Commands and queries are sent again after a lost or garbled reply and after the cable was unplugged,
    but not after a refusal. A value that was set is read back; if it cannot be, that is an error.

    Parameters
    ----------
    link : the open port; closed together with this object.
    table : the make's protocol.
    clock : the time in which it waits for lamps and shutters.
    name : the projector's name, for messages.
    """

    def __init__(self, link: SerialLink, table: SerialTable, *, clock: Clock, name: str) -> None:
        self.name = name
        self._link = link
        self._table = table
        self._clock = clock
        self._turn = _thread.allocate_lock()
        # a part of an earlier program's command may still be on the wire
        self._synchronised = False

    def state(self) -> ControlState:
        """Read everything that can be read in this power state."""
        power = self._power()
        shutter = self._query(self._table.shutter, power)
        hours = self._query(self._table.hours, power)
        return ControlState(
            power=power,
            shuttered=None if shutter is None else self._table.shutter_codes[shutter],
            source=self._query(self._table.source, power),
            lamp_hours=None if hours is None else max(int(lamp) for lamp in hours.split()),
            errors=self._errors(power),
        )

    def set_power(self, on: bool) -> None:
        """Switch on and wait for the picture, or switch off and wait until the lamp is off.

        Waits for the states that the projector requires: a cool-down before it starts again, a finished
        warm-up before it can be switched off. Cooling counts as off.

        Raises
        ------
        WrongState
            Switching on a projector that reports a fault, or the command was refused.
        DeviceTimeout
            The change was not seen within the table's `power_change_s`.
        """
        table = self._table
        off = {Power.STANDBY, Power.COOLING, Power.ERROR}
        wanted, ready = ({Power.ON}, Power.STANDBY) if on else (off, Power.ON)
        deadline_s = self._clock.now_s() + table.timings.power_change_s
        power: Power | None = self._power()
        while power not in wanted:
            if power is Power.ERROR:
                raise WrongState(self._fault())
            if power is ready:
                self._order_power(table.power_on if on else table.power_off)
            if self._clock.now_s() >= deadline_s:
                raise DeviceTimeout(self._never_changed(on, power))
            self._clock.sleep(table.timings.power_poll_s)
            power = self._power_in_transit()

    def set_shutter(self, closed: bool) -> None:
        """Close or open the shutter; returns when the projector has confirmed it.

        Raises
        ------
        DeviceError
            Anything that leaves the shutter unconfirmed: `WrongState` when the projector is not on,
            refuses, or reads back the other state; `DeviceTimeout`, `NotConnected` otherwise.
        """
        what = f"shutter {'closed' if closed else 'open'}"
        codes = self._table.shutter_codes
        with self._confirmed_or_error(what):
            self._require_on()
            self._order(self._table.shutter_commands[closed])
            self._confirm(self._table.shutter, {code for code in codes if codes[code] is closed})

    def set_input(self, source: str) -> None:
        """Select an input by the projector's code for it, and read it back.

        Raises
        ------
        InputError
            `source` is not a source code.
        DeviceError
            Anything that leaves the input unconfirmed, as for `set_shutter`.
        """
        table = self._table
        if not table.source_code.fullmatch(source):
            known = ", ".join(f"{code} ({text})" for code, text in table.source_names.items())
            raise InputError(
                f"{self._who()}: input {source!r} is not a source code; use one such as {known}"
            )
        before, after = table.source_command
        with self._confirmed_or_error(f"input {source}"):
            self._require_on()
            self._order(before + source.encode() + after, timeout_s=table.timings.source_reply_s)
            self._confirm(table.source, {source} | table.source_groups.get(source, frozenset()))

    def close(self) -> None:
        """Close the port."""
        self._link.close()

    def _power(self) -> Power:
        """The power state now."""
        code = self._ask(self._table.power)
        if code not in self._table.power_codes:
            raise DeviceError(
                f"{self._who()}: power code {code} is not one of {', '.join(self._table.power_codes)}; "
                "check the model's list of codes"
            )
        return self._table.power_codes[code]

    def _power_in_transit(self) -> Power | None:
        """Power state of a projector that may be too busy to answer; None then."""
        try:
            return self._power()
        except (DeviceTimeout, GarbledReply, WrongState):
            return None

    def _order_power(self, command: bytes) -> None:
        """Send a power command; the power state shows later whether it worked.

        Some models reply only when the lamp is on, so a missing reply is not an error here.
        """
        try:
            self._attempt(command, self._table.done, self._table.timings.reply_s)
        except TRY_AGAIN:
            pass

    def _require_on(self) -> None:
        """Raise an error unless the projector is on."""
        power = self._power()
        if power is not Power.ON:
            raise WrongState(f"{self._who()} is in power state {power}; switch it on first")

    def _errors(self, power: Power) -> tuple[str, ...]:
        """Faults in words; a fault state without a reason counts as one."""
        texts = self._table.error_texts
        codes = (self._query(self._table.errors, power) or "").split()
        named = tuple(texts.get(code, f"error code {code}") for code in codes)
        errors = tuple(text for text in named if text)
        return errors or (("fault without a stated reason",) if power is Power.ERROR else ())

    def _query(self, query: Query, power: Power) -> str | None:
        """Value of a query; None when the projector does not answer it in this power state."""
        if power not in query.answered_when:
            return None
        try:
            return self._ask(query)
        except WrongState:
            return None

    def _confirm(self, query: Query, accepted: set[str]) -> None:
        """Read a value back until it is one of `accepted`."""
        timings = self._table.timings
        deadline_s = self._clock.now_s() + timings.confirm_s
        while (answer := self._ask(query)) not in accepted:
            if self._clock.now_s() >= deadline_s:
                raise WrongState(
                    f"{self._who()}: {_shown(query.command)} still answers {answer} after "
                    f"{timings.confirm_s:g} s instead of {' or '.join(sorted(accepted))}; check the "
                    "projector, and switch it off if the picture must be dark"
                )
            self._clock.sleep(timings.confirm_poll_s)

    @contextmanager
    def _confirmed_or_error(self, what: str) -> Iterator[None]:
        """Add to every error what is not confirmed."""
        try:
            yield
        except DeviceError as error:
            raise type(error)(f"{what} is not confirmed: {error}") from error

    def _ask(self, query: Query) -> str:
        """Send a query; returns the value in its reply."""
        match = self._send(query.command, query.reply, self._table.timings.reply_s)
        return match["value"].decode("ascii")

    def _order(self, command: bytes, timeout_s: float | None = None) -> None:
        """Send a command and wait for its confirmation."""
        self._send(command, self._table.done, timeout_s or self._table.timings.reply_s)

    def _send(
        self, command: bytes, expected: re.Pattern[bytes], timeout_s: float
    ) -> re.Match[bytes]:
        """Send until there is a valid reply; the only place with retries."""
        attempts = self._table.attempts
        for left in reversed(range(attempts)):
            try:
                return self._attempt(command, expected, timeout_s)
            except TRY_AGAIN as error:
                if left == 0:
                    raise type(error)(
                        f"{self._who()}: no usable answer to {_shown(command)} in {attempts} "
                        f"attempts, the last: {error}"
                    ) from error
        raise AssertionError("a table allows at least one attempt")

    def _attempt(
        self, command: bytes, expected: re.Pattern[bytes], timeout_s: float
    ) -> re.Match[bytes]:
        """Send `command` once, synchronised, and match the reply."""
        with self._turn:
            self._synchronise()
            self._synchronised = False
            reply = self._link.exchange(command, self._table.terminator, timeout_s)
            match = expected.fullmatch(reply)
            refused = self._table.refused.fullmatch(reply)
            self._synchronised = bool(match or refused)
        if match:
            return match
        if refused:
            raise WrongState(
                f"{self._who()} refused {_shown(command)} with {reply!r}; wait until the projector is on and "
                "has a steady signal, then try again, or check that this model has the command"
            )
        raise GarbledReply(
            f"{self._who()} answered {_shown(command)} with {reply!r} instead of {expected.pattern!r}; "
            f"check that this is {self._table.make} at {self._table.baud_rate} baud"
        )

    def _synchronise(self) -> None:
        """After an error, make sure that no late reply is taken for the next one.

        A projector answers in order. When the reply to a command without effect is followed by silence,
        every earlier reply has arrived or never will.
        """
        if self._synchronised:
            return
        table = self._table
        received = self._link.exchange(table.synchronise, table.terminator, table.timings.reply_s)
        received += self._link.listen(table.timings.quiet_s)
        replies = re.split(b"(?<=" + re.escape(table.terminator) + b")", received)
        if replies[-2:] != [table.synchronised, b""]:
            raise GarbledReply(
                f"{self._who()} sent {received!r} during synchronisation, which must end with "
                f"{table.synchronised!r} alone; check that this is {table.make} at {table.baud_rate} baud"
            )
        self._synchronised = True

    def _who(self) -> str:
        """Projector and port, for messages."""
        return f"projector {self.name} on {self._link.port}"

    def _fault(self) -> str:
        """Message for a projector that does not switch on."""
        return (
            f"{self._who()} reports a fault ({', '.join(self._errors(Power.ERROR))}); clear it at the "
            "projector, then try again"
        )

    def _never_changed(self, on: bool, power: Power | None) -> str:
        """Message for a power change that did not happen."""
        return (
            f"{self._who()} is in power state {power or 'unknown (no answer)'}, not "
            f"{'on' if on else 'standby'}, after {self._table.timings.power_change_s:g} s; check its "
            "indicator lights and try again"
        )


def _shown(command: bytes) -> str:
    """A command for messages, without its ending."""
    return repr(command.strip().decode("ascii", "replace"))
