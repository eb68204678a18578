"""A serial port: sends a command and reads one terminated reply; errors name the port and the remedy."""

from collections.abc import Iterator
from contextlib import contextmanager

import serial

from procam.errors import DeviceError, DeviceTimeout, NotConnected

WRITE_TIMEOUT_S = 2.0
WIRE_ERRORS: tuple[type[Exception], ...] = (OSError,)
try:
    import termios
except ImportError:  # Windows, where pyserial raises OSError only
    pass
else:  # pyserial does not catch this error of a port that fails while it is being opened
    WIRE_ERRORS = (OSError, termios.error)


class GarbledReply(DeviceError):
    """The bytes that arrived are not a valid reply."""


class SerialLink:
    """An exclusively opened serial port, 8 data bits, no parity, 1 stop bit.

    A port that failed (cable or adapter unplugged) is opened again by the next call, so a link works
    again as soon as the path is back.

    Parameters
    ----------
    port : device path, best one that survives replugging such as ``/dev/serial/by-id/...``.
    baud_rate : speed [bit/s].
    longest_reply : more bytes than this without a terminator are an error [byte].

    Raises
    ------
    NotConnected
        The port does not exist, or another program holds it.
    """

    def __init__(self, port: str, *, baud_rate: int = 9600, longest_reply: int = 256) -> None:
        self.port = port
        self._baud_rate = baud_rate
        self._longest_reply = longest_reply
        self._serial: serial.Serial | None = None
        with self._wire():
            pass

    def exchange(self, command: bytes, terminator: bytes, timeout_s: float) -> bytes:
        """Discard the bytes that wait to be read, send `command`, and read one reply.

        Parameters
        ----------
        command : bytes to send, complete with their own ending.
        terminator : bytes that end a reply.
        timeout_s : time to wait for the next byte, and for the reply as a whole [s].

        Returns
        -------
        reply : bytes
            The reply with its terminator.

        Raises
        ------
        NotConnected
            The port cannot be opened, or failed.
        DeviceTimeout
            No terminator within `timeout_s`.
        GarbledReply
            `longest_reply` bytes came without a terminator.
        """
        with self._wire() as wire:
            wire.read(wire.in_waiting)
            wire.timeout = timeout_s
            wire.write(command)
            reply = wire.read_until(terminator, self._longest_reply)
        if reply.endswith(terminator):
            return reply
        if len(reply) >= self._longest_reply:
            raise self._garbage(f"{len(reply)} bytes without the end {terminator!r}", reply)
        raise DeviceTimeout(
            f"port {self.port}: the reply to {command!r} was {reply!r} after {timeout_s:g} s and does not "
            f"end with {terminator!r}; check that the device is powered, the cable, and that both ends "
            f"run at {self._baud_rate} baud"
        )

    def listen(self, quiet_s: float) -> bytes:
        """Read until no byte has arrived for `quiet_s` [s].

        Raises
        ------
        NotConnected
            The port cannot be opened, or failed.
        GarbledReply
            The other end does not stop sending.
        """
        received = b""
        with self._wire() as wire:
            wire.timeout = quiet_s
            while len(received) < self._longest_reply and (byte := wire.read(1)):
                received += byte
        if len(received) >= self._longest_reply:
            raise self._garbage(f"{len(received)} bytes without a command", received)
        return received

    def close(self) -> None:
        """Release the port."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    @contextmanager
    def _wire(self) -> Iterator[serial.Serial]:
        """The open port; its errors become those of procam, with its name."""
        try:
            if self._serial is None:
                self._serial = serial.Serial(
                    self.port, self._baud_rate, write_timeout=WRITE_TIMEOUT_S, exclusive=True
                )
            yield self._serial
        except serial.SerialTimeoutException as error:
            raise DeviceTimeout(
                f"port {self.port}: bytes could not be sent within {WRITE_TIMEOUT_S:g} s; check flow "
                "control and the adapter"
            ) from error
        except WIRE_ERRORS as error:
            self.close()
            raise NotConnected(
                f"port {self.port} cannot be used ({error}); check that the cable is plugged in, that the "
                "path is right, that you may use it (group dialout) and that no other program holds it"
            ) from error

    def _garbage(self, what: str, received: bytes) -> GarbledReply:
        """The error for bytes that are not a reply."""
        return GarbledReply(
            f"port {self.port} received {what}, starting {received[:16]!r}; check that both ends run at "
            f"{self._baud_rate} baud and that this is the right device"
        )
