"""An emulated Epson projector behind a pseudo terminal, with faults on the wire (Linux and macOS)."""

import os
import select
import tempfile
import threading
import time
import tty
from dataclasses import dataclass
from pathlib import Path

from procam.devices.protocols import Power
from procam.errors import WrongState
from simulators.projector_state import ProjectorState

PROMPT = b":"
REFUSAL = b"ERR\r:"
POWER_CODES = {
    Power.STANDBY: "00",
    Power.ON: "01",
    Power.WARMING: "02",
    Power.COOLING: "03",
    Power.ERROR: "05",
}
SOURCES = ("11", "14", "30", "41", "42", "53", "80", "A0")


@dataclass
class WireFaults:
    """Faults on the wire; they can be changed at any time.

    The counts go down by one for each command that they affect; 0 is a healthy wire.

    Attributes
    ----------
    commands : only commands that start with this are affected.
    split_at : reply bytes before a pause; None sends replies without one.
    split_pause_s : length of that pause, in real time [s].
    garbage, garbage_at : bytes put into a reply, and where.
    garbled_replies : replies with `garbage`.
    lost_commands : commands that never reach the projector.
    refused_commands : commands answered by a refusal and not carried out.
    lost_replies : replies that never arrive.
    late_replies : replies that arrive only once the next command has been sent.
    unplug_at : reply bytes after which the cable is unplugged; None keeps it plugged in.
    """

    commands: bytes = b""
    split_at: int | None = None
    split_pause_s: float = 0.002
    garbage: bytes = b""
    garbage_at: int = 0
    garbled_replies: int = 0
    lost_commands: int = 0
    refused_commands: int = 0
    lost_replies: int = 0
    late_replies: int = 0
    unplug_at: int | None = None

    def strikes(self, fault: str, command: bytes) -> bool:
        """Whether the named fault affects `command`; its count goes down by one if so."""
        if getattr(self, fault) < 1 or not command.startswith(self.commands):
            return False
        setattr(self, fault, getattr(self, fault) - 1)
        return True


class EmulatedEscVp21:
    """A projector with ESC/VP21 on a pseudo terminal, served by a thread.

    Parameters
    ----------
    state : the projector's state.

    Attributes
    ----------
    port : path to open as a serial port; stays the same when unplugged and replugged.
    faults : faults on the wire.
    """

    def __init__(self, state: ProjectorState) -> None:
        self.state = state
        self.faults = WireFaults()
        self._folder = Path(tempfile.mkdtemp(prefix="procam-serial-"))
        self.port = str(self._folder / "projector")
        self._thread: threading.Thread | None = None
        self._stop = -1
        self.replug()

    def replug(self) -> None:
        """Plug the cable in, after unplugging it if necessary."""
        self.unplug()
        self._late = b""
        master, slave = os.openpty()
        tty.setraw(slave)
        stopped, self._stop = os.pipe()
        Path(self.port).symlink_to(os.ttyname(slave))
        self._thread = threading.Thread(
            target=self._serve, args=(master, slave, stopped), name="emulated projector"
        )
        self._thread.daemon = True
        self._thread.start()

    def unplug(self) -> None:
        """Unplug the cable: the open port fails and its path disappears."""
        if self._thread is not None:
            os.close(self._stop)
            self._thread.join()
            self._thread = None

    def close(self) -> None:
        """Unplug the cable for the last time."""
        self.unplug()
        if self._folder.exists():
            self._folder.rmdir()

    def _serve(self, master: int, slave: int, stopped: int) -> None:
        """Answer until the cable is unplugged at either end."""
        try:
            pending = b""
            while stopped not in select.select([master, stopped], [], [])[0]:
                *commands, pending = (pending + os.read(master, 1024)).split(b"\r")
                for command in commands:
                    self._respond(master, command)
        except BrokenPipeError:
            pass
        finally:
            Path(self.port).unlink()  # first, so that nobody opens a port that is being closed
            for descriptor in (master, slave, stopped):
                os.close(descriptor)

    def _respond(self, master: int, command: bytes) -> None:
        """Carry out one command and reply, with the faults."""
        strikes = self.faults.strikes
        if strikes("lost_commands", command):
            return
        refused = strikes("refused_commands", command)
        reply = REFUSAL if refused else self._answer(command.decode("ascii", "replace").upper())
        if strikes("lost_replies", command):
            return
        if strikes("garbled_replies", command):
            at = self.faults.garbage_at
            reply = reply[:at] + self.faults.garbage + reply[at:]
        if strikes("late_replies", command):
            self._late += reply
            return
        late, self._late = self._late, b""
        self._send(master, late + reply, command)

    def _send(self, master: int, reply: bytes, command: bytes) -> None:
        """Send a reply at once, in two parts, or cut short by an unplugged cable."""
        faults = self.faults
        affected = command.startswith(faults.commands)
        if affected and faults.unplug_at is not None:
            os.write(master, reply[: faults.unplug_at])
            faults.unplug_at = None
            raise BrokenPipeError
        if affected and faults.split_at is not None:
            os.write(master, reply[: faults.split_at])
            time.sleep(faults.split_pause_s)
            reply = reply[faults.split_at :]
        os.write(master, reply)

    def _answer(self, command: str) -> bytes:
        """Reply to a command that arrived."""
        if not command:
            return PROMPT
        try:
            if command.endswith("?"):
                return f"{command[:-1]}={self._value(command)}\r:".encode()
            self._obey(command)
        except WrongState:
            return REFUSAL
        return PROMPT

    def _value(self, command: str) -> str:
        """Value of a query; most are refused unless the projector is on."""
        state = self.state
        if command == "PWR?":
            return POWER_CODES[state.power]
        if command == "ERR?":
            return " ".join(state.error_codes) or "00"
        self._require_on(command)
        if command == "MUTE?":
            return "ON" if state.muted else "OFF"
        if command == "SOURCE?":
            return state.source
        if command == "LAMP?":
            return str(int(state.lamp_hours))
        raise WrongState(f"emulated projector: unknown command {command}")

    def _obey(self, command: str) -> None:
        """Carry out a command; raises `WrongState` where the projector refuses."""
        word, _, value = command.partition(" ")
        if command == "PWR ON":
            self.state.switch_on()
        elif command == "PWR OFF":
            self.state.switch_off()
        elif word == "MUTE" and value in ("ON", "OFF"):
            self._require_on(command)
            self.state.set_muted(value == "ON")
        elif word == "SOURCE" and value in SOURCES:
            self._require_on(command)
            self.state.source = value
        else:
            raise WrongState(f"emulated projector: unknown command {command}")

    def _require_on(self, command: str) -> None:
        """Refuse `command` unless the projector is on."""
        if self.state.power is not Power.ON:
            raise WrongState(f"emulated projector: cannot {command} in state {self.state.power}")
