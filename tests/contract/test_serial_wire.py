"""What every serial remote control must survive or report when the wire misbehaves."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from serial_bench import COOL_DOWN_S, MAKES, Bench, do_everything, message, shown

from procam.devices.control.projector_control import SerialProjectorControl, open_serial_control
from procam.devices.control.serial_link import GarbledReply
from procam.devices.protocols import Power
from procam.errors import DeviceError, DeviceTimeout, InputError, NotConnected, WrongState
from simulators.clock import SceneClock


@pytest.fixture(params=MAKES, ids=lambda make: make.__name__)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = request.param()
    yield made
    made.close()


class TestWire:
    def test_replies_split_at_every_byte(self, bench: Bench) -> None:
        for split_at in range(1, bench.longest_reply):
            bench.emulator.faults.split_at = split_at
            do_everything(bench)

    @pytest.mark.parametrize("garbage", [b"\xff", b"\x00\xfe\r", b"=", b":", b"ERR"])
    def test_garbage_at_every_byte_of_a_reply(self, bench: Bench, garbage: bytes) -> None:
        table = bench.table
        for question in (table.power.command, table.shutter.command, table.shutter_commands[True]):
            for at in range(bench.longest_reply - 1):
                bench.arm(question, garbage=garbage, garbage_at=at, garbled_replies=1)
                bench.control.set_shutter(True)
                assert bench.state.muted
                assert bench.control.state().shuttered is True
                bench.control.set_shutter(False)

    def test_a_query_with_a_lost_reply_is_sent_again(self, bench: Bench) -> None:
        bench.arm(lost_replies=1)
        do_everything(bench)

    def test_a_late_reply_is_not_taken_for_the_next_query(self, bench: Bench) -> None:
        bench.arm(late_replies=1)
        do_everything(bench)

    def test_synchronisation_takes_one_attempt(self, bench: Bench) -> None:
        bench.arm(bench.table.shutter.command, late_replies=1)
        control = bench.another_control(table=replace(bench.table, attempts=2))
        assert control.state().shuttered is False

    def test_a_failed_call_leaves_no_reply_for_the_next(self, bench: Bench) -> None:
        control = bench.another_control(table=replace(bench.table, attempts=1))
        bench.arm(bench.table.shutter.command, late_replies=1)
        message(DeviceTimeout, bench, control.state)
        bench.state.set_muted(True)
        assert control.state().shuttered is True

    def test_an_unrequested_reply_is_discarded(self, bench: Bench) -> None:
        bench.state.set_muted(True)
        bench.arm(bench.table.power.command, garbled_replies=1)
        bench.emulator.faults.garbage = bench.shutter_open
        bench.emulator.faults.garbage_at = bench.longest_reply
        control = bench.another_control(table=replace(bench.table, attempts=1))
        assert control.state().shuttered is True

    def test_garbage_before_the_first_query_does_no_harm(self, bench: Bench) -> None:
        bench.emulator.faults.garbage = b"\x80\xff\x03:"
        bench.emulator.faults.garbled_replies = 1
        do_everything(bench)

    def test_half_a_command_left_by_another_program_does_no_harm(self, bench: Bench) -> None:
        with pytest.raises(DeviceTimeout):
            bench.link.exchange(bench.table.shutter_commands[True][:-2], b"\xee", 0.01)
        do_everything(bench)

    def test_silence_is_an_error(self, bench: Bench) -> None:
        bench.arm(lost_commands=100)
        text = message(DeviceTimeout, bench, bench.control.state)
        assert f"no usable answer to {shown(bench.table.power.command)} in 3 attempts" in text
        assert "was b'' after 0.2 s" in text
        assert "check that the device is powered" in text

    def test_nothing_but_garbage_is_an_error(self, bench: Bench) -> None:
        bench.arm(garbage=b"\xf0\x0f", garbled_replies=100)
        text = message(GarbledReply, bench, bench.control.state)
        assert f"no usable answer to {shown(bench.table.power.command)} in 3 attempts" in text
        assert "during synchronisation" in text
        assert "9600 baud" in text

    @pytest.mark.parametrize("garbage", [b"U" * 100, b":" * 100])
    def test_endless_bytes_are_an_error(self, bench: Bench, garbage: bytes) -> None:
        bench.arm(garbage=garbage, garbled_replies=100)
        text = message(GarbledReply, bench, bench.control.state)
        assert "received 64 bytes" in text
        assert "is the right device" in text

    def test_an_unknown_power_code_is_an_error(self, bench: Bench) -> None:
        control = bench.another_control(table=replace(bench.table, power_codes={"77": Power.ON}))
        text = message(DeviceError, bench, control.state)
        assert "power code 01 is not one of 77" in text

    def test_a_refused_power_query_is_an_error(self, bench: Bench) -> None:
        bench.arm(bench.table.power.command, refused_commands=1)
        text = message(WrongState, bench, bench.control.state)
        assert f"refused {shown(bench.table.power.command)} with" in text


def opened(bench: Bench) -> SerialProjectorControl:
    """Another control at the same port."""
    return open_serial_control(bench.emulator.port, bench.protocol, clock=bench.clock, name="north")


class TestCable:
    @pytest.mark.parametrize(
        ("there", "words"),
        [(False, "check that the cable is plugged in"), (True, "no other program holds it")],
    )
    def test_a_port_that_cannot_be_had(self, bench: Bench, there: bool, words: str) -> None:
        """As it is not there, or another program has it."""
        if not there:
            bench.emulator.unplug()
        text = message(NotConnected, bench, lambda: opened(bench))
        assert words in text

    def test_unplugged_between_two_commands(self, bench: Bench) -> None:
        bench.control.state()
        bench.emulator.unplug()
        text = message(NotConnected, bench, lambda: bench.control.set_shutter(True))
        assert text.startswith("shutter closed is not confirmed: ")

    @pytest.mark.parametrize("unplug_at", range(0, 9, 2))
    def test_unplugged_during_a_reply(self, bench: Bench, unplug_at: int) -> None:
        bench.arm(bench.table.shutter.command, unplug_at=unplug_at)
        message(NotConnected, bench, lambda: bench.control.set_shutter(True))
        bench.emulator.replug()
        do_everything(bench)

    def test_unplugged_while_switching_on(self, bench: Bench) -> None:
        bench.control.set_power(False)
        bench.clock.sleep(COOL_DOWN_S)
        bench.arm(bench.table.power_on, unplug_at=0)
        message(NotConnected, bench, lambda: bench.control.set_power(True))

    def test_plugged_in_again_before_the_next_command(self, bench: Bench) -> None:
        bench.control.state()
        bench.emulator.replug()
        do_everything(bench)

    def test_a_closed_control_releases_the_port(self, bench: Bench) -> None:
        bench.control.close()
        control = opened(bench)
        assert control.state().power is Power.ON
        control.close()


def test_an_unknown_protocol_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"projector north: .*'morse'.*choose one of escvp21"):
        open_serial_control("/dev/null", "morse", clock=SceneClock(), name="north")
