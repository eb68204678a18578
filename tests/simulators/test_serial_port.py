"""The emulated projector, seen from the wire with nothing of procam between."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from procam.devices.protocols import Power
from procam.errors import WrongState
from simulators.clock import SceneClock
from simulators.projector_state import ProjectorState
from simulators.serial_port import EmulatedEscVp21


class TestProjectorState:
    def test_lamp_comes_up_slowly_and_goes_out_at_once(self) -> None:
        clock = SceneClock()
        state = ProjectorState(clock, warm_up_s=30.0, cool_down_s=20.0)
        seen = [(state.power, state.light_factor())]
        state.switch_on()
        for step_s in (0.0, 15.0, 15.0):
            clock.sleep(step_s)
            seen.append((state.power, state.light_factor()))
        state.switch_off()
        for step_s in (0.0, 20.0):
            clock.sleep(step_s)
            seen.append((state.power, state.light_factor()))
        assert seen == [
            (Power.STANDBY, 0.0),
            (Power.WARMING, 0.0),
            (Power.WARMING, 0.25),
            (Power.ON, 1.0),
            (Power.COOLING, 0.0),
            (Power.STANDBY, 0.0),
        ]

    def test_stuck_shutter_stays(self) -> None:
        state = ProjectorState(SceneClock(), on=True)
        state.shutter_stuck = True
        state.set_muted(True)
        assert (state.muted, state.light_factor()) == (False, 1.0)

    def test_a_break_down_switches_the_lamp_off_permanently(self) -> None:
        state = ProjectorState(SceneClock(), on=True)
        state.report_error("01")
        assert state.light_factor() == 1.0
        state.break_down("06")
        assert (state.power, state.light_factor()) == (Power.ERROR, 0.0)
        assert state.error_codes == ("01", "06")
        with pytest.raises(WrongState, match="switch on in state error"):
            state.switch_on()


@pytest.fixture
def clock() -> SceneClock:
    return SceneClock()


@pytest.fixture
def emulator(clock: SceneClock) -> Iterator[EmulatedEscVp21]:
    emulator = EmulatedEscVp21(ProjectorState(clock, on=True, lamp_hours=1234.5))
    yield emulator
    emulator.close()


@pytest.fixture
def wire(emulator: EmulatedEscVp21) -> Iterator[serial.Serial]:
    with serial.Serial(emulator.port, timeout=5.0) as wire:
        yield wire


def ask(wire: serial.Serial, command: bytes) -> bytes:
    """Send a command and read its reply up to the prompt."""
    wire.write(command)
    return wire.read_until(b":")


class TestEmulatedEscVp21:
    @pytest.mark.parametrize(
        ("command", "reply"),
        [
            (b"\r", b":"),
            (b"PWR?\r", b"PWR=01\r:"),
            (b"pwr?\r", b"PWR=01\r:"),
            (b"MUTE?\r", b"MUTE=OFF\r:"),
            (b"MUTE ON\r", b":"),
            (b"MUTE MAYBE\r", b"ERR\r:"),
            (b"SOURCE?\r", b"SOURCE=30\r:"),
            (b"SOURCE A0\r", b":"),
            (b"SOURCE 99\r", b"ERR\r:"),
            (b"LAMP?\r", b"LAMP=1234\r:"),
            (b"ERR?\r", b"ERR=00\r:"),
            (b"NONSENSE?\r", b"ERR\r:"),
            (b"\xff\xfe\r", b"ERR\r:"),
        ],
    )
    def test_replies_when_on(self, wire: serial.Serial, command: bytes, reply: bytes) -> None:
        assert ask(wire, command) == reply

    def test_power_cycle(self, wire: serial.Serial, clock: SceneClock) -> None:
        received = [ask(wire, b"PWR OFF\r"), ask(wire, b"PWR?\r"), ask(wire, b"PWR ON\r")]
        clock.sleep(20.0)
        received += [ask(wire, b"PWR?\r"), ask(wire, b"MUTE?\r"), ask(wire, b"PWR ON\r")]
        received += [ask(wire, b"PWR?\r"), ask(wire, b"MUTE ON\r")]
        clock.sleep(30.0)
        received += [ask(wire, b"PWR?\r")]
        assert received == [
            *(b":", b"PWR=03\r:", b"ERR\r:"),
            *(b"PWR=00\r:", b"ERR\r:", b":"),
            *(b"PWR=02\r:", b"ERR\r:"),
            b"PWR=01\r:",
        ]

    def test_faults_hit_the_named_command_and_run_out(
        self, wire: serial.Serial, emulator: EmulatedEscVp21
    ) -> None:
        emulator.faults.commands = b"MUTE?"
        emulator.faults.refused_commands = 1
        received = [ask(wire, b"PWR?\r"), ask(wire, b"MUTE?\r"), ask(wire, b"MUTE?\r")]
        assert received == [b"PWR=01\r:", b"ERR\r:", b"MUTE=OFF\r:"]

    def test_lost_command_is_not_carried_out_and_lost_reply_is(
        self, wire: serial.Serial, emulator: EmulatedEscVp21
    ) -> None:
        emulator.faults.lost_commands = 1
        wire.write(b"MUTE ON\r")
        assert ask(wire, b"MUTE?\r") == b"MUTE=OFF\r:"
        emulator.faults.lost_replies = 1
        wire.write(b"MUTE ON\r")
        assert ask(wire, b"MUTE?\r") == b"MUTE=ON\r:"

    def test_late_reply_comes_before_the_next(
        self, wire: serial.Serial, emulator: EmulatedEscVp21
    ) -> None:
        emulator.faults.late_replies = 1
        wire.write(b"PWR?\r")
        assert ask(wire, b"MUTE?\r") == b"PWR=01\r:"
        assert wire.read_until(b":") == b"MUTE=OFF\r:"

    def test_garbage_is_put_at_its_position(
        self, wire: serial.Serial, emulator: EmulatedEscVp21
    ) -> None:
        emulator.faults.garbage, emulator.faults.garbage_at = b"\xff", 4
        emulator.faults.garbled_replies = 1
        assert ask(wire, b"PWR?\r") == b"PWR=\xff01\r:"

    def test_an_unplugged_cable_closes_the_port_and_removes_its_path(
        self, wire: serial.Serial, emulator: EmulatedEscVp21
    ) -> None:
        emulator.unplug()
        assert not Path(emulator.port).is_symlink()
        with pytest.raises(OSError):
            ask(wire, b"PWR?\r")
        emulator.replug()
        with serial.Serial(emulator.port, timeout=5.0) as again:
            assert ask(again, b"PWR?\r") == b"PWR=01\r:"
