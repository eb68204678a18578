"""One serial cable: a command out, one terminated reply back, and plain words when it fails."""

from collections.abc import Iterator
from contextlib import contextmanager

import serial

from procam.errors import DeviceError, DeviceTimeout, NotConnected

WRITE_TIMEOUT_S = 2.0
WIRE_ERRORS: tuple[type[Exception], ...] = (OSError,)
try:
    import termios
except ImportError:  # Windows, where pyserial raises nothing but OSError
    pass
else:  # pyserial lets this one through when a port dies while it is being set up
    WIRE_ERRORS = (OSError, termios.error)


class GarbledReply(DeviceError):
    """Bytes arrived, but they are no reply."""


class SerialLink:
    """An exclusively opened serial port, 8 data bits, no parity, 1 stop bit.

    A port that died (cable pulled, adapter gone) is opened again by the next call, so a link
    outlives its cable as long as the path comes back.

    Parameters
    ----------
    port : device path, best one that survives replugging such as ``/dev/serial/by-id/...``.
    baud_rate : speed [bit/s].
    longest_reply : more bytes than this without a terminator are garbage [byte].

    Raises
    ------
    NotConnected
        The port is absent, or another program holds it.
    """

    def __init__(self, port: str, *, baud_rate: int = 9600, longest_reply: int = 256) -> None:
        self.port = port
        self._baud_rate = baud_rate
        self._longest_reply = longest_reply
        self._serial: serial.Serial | None = None
        with self._wire():
            pass

    def exchange(self, command: bytes, terminator: bytes, timeout_s: float) -> bytes:
        """Drop what is waiting to be read, send `command`, and read one reply.

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
            The port cannot be opened, or died.
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
            f"port {self.port}: sent {command!r}, got {reply!r} within {timeout_s:g} s, expected a "
            f"reply that ends with {terminator!r}; check that the device is powered, the cable, "
            f"and that both ends run at {self._baud_rate} baud"
        )

    def listen(self, quiet_s: float) -> bytes:
        """Read whatever still comes until nothing has come for `quiet_s` [s].

        Raises
        ------
        NotConnected
            The port cannot be opened, or died.
        GarbledReply
            The other end does not stop talking.
        """
        heard = b""
        with self._wire() as wire:
            wire.timeout = quiet_s
            while len(heard) < self._longest_reply and (byte := wire.read(1)):
                heard += byte
        if len(heard) >= self._longest_reply:
            raise self._garbage(f"{len(heard)} bytes nobody asked for", heard)
        return heard

    def close(self) -> None:
        """Release the port."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    @contextmanager
    def _wire(self) -> Iterator[serial.Serial]:
        """Give the open port; what goes wrong with it becomes an error that names it."""
        try:
            if self._serial is None:
                self._serial = serial.Serial(
                    self.port, self._baud_rate, write_timeout=WRITE_TIMEOUT_S, exclusive=True
                )
            yield self._serial
        except serial.SerialTimeoutException as error:
            raise DeviceTimeout(
                f"port {self.port}: bytes could not be sent within {WRITE_TIMEOUT_S:g} s, expected "
                "the wire to take them at once; check flow control and the adapter"
            ) from error
        except WIRE_ERRORS as error:
            self.close()
            raise NotConnected(
                f"port {self.port}: got {error}, expected an open serial port; check that the "
                "cable is plugged in, that the path is right, that you may use it (group dialout) "
                "and that no other program holds it"
            ) from error

    def _garbage(self, what: str, heard: bytes) -> GarbledReply:
        """Make the error for bytes that make no sense."""
        return GarbledReply(
            f"port {self.port}: got {what}, starting {heard[:16]!r}; expected one short reply; "
            f"check that both ends run at {self._baud_rate} baud and that this is the right device"
        )
