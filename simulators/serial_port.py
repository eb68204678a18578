"""An Epson projector behind a pseudo terminal: the wire is real, its faults are ours."""

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
    """What goes wrong on the wire; change it at any time.

    The counts run down by one per command they hit, and 0 is a healthy wire.

    Attributes
    ----------
    commands : only commands that start with this are hit.
    split_at : reply bytes before a pause; None sends replies whole.
    split_pause_s : length of that pause, in real time [s].
    garbage, garbage_at : bytes put into a reply, and where.
    garbled_replies : replies that get `garbage`.
    lost_commands : commands that never reach the projector.
    refused_commands : commands answered by a refusal and not carried out.
    lost_replies : replies that never arrive.
    late_replies : replies that arrive only once the next command has been sent.
    unplug_at : reply bytes after which the cable is pulled; None leaves it in.
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
        """Whether the named count hits `command`; uses one up."""
        if getattr(self, fault) < 1 or not command.startswith(self.commands):
            return False
        setattr(self, fault, getattr(self, fault) - 1)
        return True


class EmulatedEscVp21:
    """A projector that speaks ESC/VP21 on a pseudo terminal, served by a thread.

    Parameters
    ----------
    state : the projector it speaks for.

    Attributes
    ----------
    port : path to open as a serial port; stays the same when unplugged and replugged.
    faults : what goes wrong on the wire.
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
        """Plug the cable in, after pulling it if need be."""
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
        """Pull the cable: the open port dies and its path is gone."""
        if self._thread is not None:
            os.close(self._stop)
            self._thread.join()
            self._thread = None

    def close(self) -> None:
        """Pull the cable for good."""
        self.unplug()
        if self._folder.exists():
            self._folder.rmdir()

    def _serve(self, master: int, slave: int, stopped: int) -> None:
        """Answer until the cable is pulled from either end."""
        try:
            pending = b""
            while stopped not in select.select([master, stopped], [], [])[0]:
                *commands, pending = (pending + os.read(master, 1024)).split(b"\r")
                for command in commands:
                    self._respond(master, command)
        except BrokenPipeError:
            pass
        finally:
            Path(self.port).unlink()  # first, so that nobody opens a dying port
            for descriptor in (master, slave, stopped):
                os.close(descriptor)

    def _respond(self, master: int, command: bytes) -> None:
        """Carry out one command and reply, as far as the faults allow."""
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
        """Put a reply on the wire in one piece, in two, or with the cable pulled half-way."""
        faults = self.faults
        hit = command.startswith(faults.commands)
        if hit and faults.unplug_at is not None:
            os.write(master, reply[: faults.unplug_at])
            faults.unplug_at = None
            raise BrokenPipeError
        if hit and faults.split_at is not None:
            os.write(master, reply[: faults.split_at])
            time.sleep(faults.split_pause_s)
            reply = reply[faults.split_at :]
        os.write(master, reply)

    def _answer(self, command: str) -> bytes:
        """Reply to a command that got through."""
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
        """Answer to a question; most are refused unless the picture is up."""
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
        raise WrongState(f"emulated projector: got {command}")

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
            raise WrongState(f"emulated projector: got {command}")

    def _require_on(self, command: str) -> None:
        """Refuse `command` unless the picture is up."""
        if self.state.power is not Power.ON:
            raise WrongState(f"emulated projector: got {command} in state {self.state.power}")
