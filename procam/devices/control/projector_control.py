"""Remote control of projectors over a serial wire: one engine for every make's table."""

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
    clock : the time the projector lives in.
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
            f"projector {name}: serial protocol {protocol!r} is not known; "
            f"expected one of {', '.join(SERIAL_TABLES)}"
        )
    table = SERIAL_TABLES[protocol]
    try:
        link = SerialLink(port, baud_rate=table.baud_rate)
    except NotConnected as error:
        raise NotConnected(f"projector {name}: {error}") from error
    return SerialProjectorControl(link, table, clock=clock, name=name)


class SerialProjectorControl:
    """A projector on a serial wire; implements `ProjectorControl`.

    Lost and garbled replies are asked for again, after getting back into step with the projector,
    and so is what a pulled cable cut short, once it is back in; a refusal is not. A value that was
    set is read back, and one that cannot be read back is an error: nothing is assumed to have
    worked.

    Parameters
    ----------
    link : the open wire; closed together with this object.
    table : what the make understands and answers.
    clock : the time the projector lives in; waits for lamps and shutters are made in it.
    name : the projector's name, for messages.
    """

    def __init__(self, link: SerialLink, table: SerialTable, *, clock: Clock, name: str) -> None:
        self.name = name
        self._link = link
        self._table = table
        self._clock = clock
        self._in_step = False  # half a command of an earlier program may still be on the wire

    def state(self) -> ControlState:
        """Ask for everything that can be asked in this power state."""
        power = self._power()
        shutter = self._look(self._table.shutter, power)
        hours = self._look(self._table.hours, power)
        return ControlState(
            power=power,
            shuttered=None if shutter is None else self._table.shutter_codes[shutter],
            source=self._look(self._table.source, power),
            lamp_hours=None if hours is None else max(int(lamp) for lamp in hours.split()),
            errors=self._errors(power),
        )

    def set_power(self, on: bool) -> None:
        """Switch on and wait for the picture, or switch off and wait until the light is out.

        Goes through what the projector insists on: a cool-down before it starts again, a finished
        warm-up before it can be switched off. Cooling counts as off: the light is out.

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
        """Make the picture dark or let it out; returns when the projector has confirmed it.

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
        """Select an input by the projector's own code for it, and read it back.

        Raises
        ------
        InputError
            `source` is no source code.
        DeviceError
            Anything that leaves the input unconfirmed, as for `set_shutter`.
        """
        table = self._table
        if not table.source_code.fullmatch(source):
            known = ", ".join(f"{code} ({text})" for code, text in table.source_names.items())
            raise InputError(
                f"{self._who()}: got input {source!r}, expected a source code, for example {known}"
            )
        before, after = table.source_command
        with self._confirmed_or_error(f"input {source}"):
            self._require_on()
            self._order(before + source.encode() + after, timeout_s=table.timings.source_reply_s)
            self._confirm(table.source, {source} | table.source_groups.get(source, frozenset()))

    def close(self) -> None:
        """Let go of the wire."""
        self._link.close()

    def _power(self) -> Power:
        """Ask for the power state."""
        code = self._ask(self._table.power)
        if code not in self._table.power_codes:
            raise DeviceError(
                f"{self._who()}: got power code {code}, expected one of "
                f"{', '.join(self._table.power_codes)}; check the model's list of codes"
            )
        return self._table.power_codes[code]

    def _power_in_transit(self) -> Power | None:
        """Power state of a projector that may be too busy to say; None then."""
        try:
            return self._power()
        except (DeviceTimeout, GarbledReply, WrongState):
            return None

    def _order_power(self, command: bytes) -> None:
        """Send a power command; only the power state will tell whether it worked.

        Some models confirm only when the lamp burns, so a missing reply is not waited for again.
        """
        try:
            self._attempt(command, self._table.done, self._table.timings.reply_s)
        except TRY_AGAIN:
            pass

    def _require_on(self) -> None:
        """Refuse what a projector can do only when it is on."""
        power = self._power()
        if power is not Power.ON:
            raise WrongState(
                f"{self._who()}: got power state {power}, expected {Power.ON}; switch it on first"
            )

    def _errors(self, power: Power) -> tuple[str, ...]:
        """Complaints in words; a fault state without a reason is a complaint too."""
        texts = self._table.error_texts
        codes = (self._look(self._table.errors, power) or "").split()
        named = tuple(texts.get(code, f"error code {code}") for code in codes)
        errors = tuple(text for text in named if text)
        return errors or (("fault without a stated reason",) if power is Power.ERROR else ())

    def _look(self, query: Query, power: Power) -> str | None:
        """Answer to a question; None when it cannot be asked in this power state."""
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
                    f"{timings.confirm_s:g} s, expected {' or '.join(sorted(accepted))}; "
                    "look at the projector, and switch it off if the picture must be dark"
                )
            self._clock.sleep(timings.confirm_poll_s)

    @contextmanager
    def _confirmed_or_error(self, what: str) -> Iterator[None]:
        """Say in every error which wish it leaves open."""
        try:
            yield
        except DeviceError as error:
            raise type(error)(f"{what} is not confirmed: {error}") from error

    def _ask(self, query: Query) -> str:
        """Put a question; returns the value in its answer."""
        match = self._insist(query.command, query.reply, self._table.timings.reply_s)
        return match["value"].decode("ascii")

    def _order(self, command: bytes, timeout_s: float | None = None) -> None:
        """Give a command and wait until the projector says it is done."""
        self._insist(command, self._table.done, timeout_s or self._table.timings.reply_s)

    def _insist(
        self, command: bytes, expected: re.Pattern[bytes], timeout_s: float
    ) -> re.Match[bytes]:
        """Try until there is an answer; the only place where anything is tried again."""
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
        """Send `command` once, in step, and match the reply."""
        self._get_in_step()
        self._in_step = False
        reply = self._link.exchange(command, self._table.terminator, timeout_s)
        match = expected.fullmatch(reply)
        refused = self._table.refused.fullmatch(reply)
        self._in_step = bool(match or refused)
        if match:
            return match
        if refused:
            raise WrongState(
                f"{self._who()}: got the refusal {reply!r} to {_shown(command)}, expected it to be "
                "carried out; wait until the projector is on and has a steady signal, then try "
                "again, or check that this model knows the command"
            )
        raise GarbledReply(
            f"{self._who()}: got {reply!r} to {_shown(command)}, expected {expected.pattern!r}; "
            f"check that this is {self._table.make} at {self._table.baud_rate} baud"
        )

    def _get_in_step(self) -> None:
        """After anything odd, make sure that no late answer is taken for the next one.

        A projector answers in order. When the answer to a command without effect is the last thing
        before a silence, every answer due before it has come or never will.
        """
        if self._in_step:
            return
        table = self._table
        heard = self._link.exchange(table.synchronise, table.terminator, table.timings.reply_s)
        heard += self._link.listen(table.timings.quiet_s)
        replies = re.split(b"(?<=" + re.escape(table.terminator) + b")", heard)
        if replies[-2:] != [table.synchronised, b""]:
            raise GarbledReply(
                f"{self._who()}: got {heard!r} when getting back into step, expected it to end "
                f"with {table.synchronised!r} alone; check that this is {table.make} at "
                f"{table.baud_rate} baud"
            )
        self._in_step = True

    def _who(self) -> str:
        """Projector and port, for messages."""
        return f"projector {self.name} on {self._link.port}"

    def _fault(self) -> str:
        """Message for a projector that will not switch on."""
        return (
            f"{self._who()}: got power state {Power.ERROR} ({', '.join(self._errors(Power.ERROR))})"
            f", expected {Power.STANDBY}; clear the fault at the projector, then try again"
        )

    def _never_changed(self, on: bool, power: Power | None) -> str:
        """Message for a power change that did not come."""
        return (
            f"{self._who()}: got power state {power or 'unknown (no answer)'} after "
            f"{self._table.timings.power_change_s:g} s, expected {'on' if on else 'standby'}; "
            "look at its indicator lights and try again"
        )


def _shown(command: bytes) -> str:
    """Show a command in messages, without its ending."""
    return repr(command.strip().decode("ascii", "replace"))
