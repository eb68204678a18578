"""What every serial remote control must do with a projector, on every make's emulation."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from serial_bench import COOL_DOWN_S, MAKES, WARM_UP_S, Bench, do_everything, message, shown

from procam.devices.control.escvp21 import ESC_VP21
from procam.devices.control.projector_control import SERIAL_TABLES
from procam.devices.control.serial_table import SerialTable
from procam.devices.protocols import Power, ProjectorControl
from procam.errors import DeviceTimeout, InputError, WrongState
from simulators.clock import SceneClock
from simulators.projector_state import ProjectorState


@pytest.fixture(params=MAKES, ids=lambda make: make.__name__)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = request.param()
    yield made
    made.close()


class TestCommands:
    def test_is_a_projector_control(self, bench: Bench) -> None:
        control: ProjectorControl = bench.control
        assert control.state().power is Power.ON

    def test_does_everything_on_a_healthy_wire(self, bench: Bench) -> None:
        do_everything(bench)

    def test_power_goes_off_and_comes_back_through_cooling_and_warming(self, bench: Bench) -> None:
        bench.control.set_power(False)
        assert bench.control.state().power is Power.COOLING
        bench.control.set_power(True)
        assert bench.control.state().power is Power.ON
        assert bench.clock.now_s() == COOL_DOWN_S + WARM_UP_S

    def test_no_command_is_sent_for_the_present_power_state(self, bench: Bench) -> None:
        bench.control.set_power(True)
        assert bench.clock.now_s() == 0.0

    def test_power_off_while_warming_waits_for_the_lamp(self, bench: Bench) -> None:
        bench.control.set_power(False)
        bench.clock.sleep(COOL_DOWN_S)
        bench.state.switch_on()
        bench.control.set_power(False)
        assert bench.state.power is Power.COOLING
        assert bench.clock.now_s() > COOL_DOWN_S + WARM_UP_S

    def test_values_that_cannot_be_read_now_are_none(self, bench: Bench) -> None:
        bench.state.switch_off()
        for power in (Power.COOLING, Power.STANDBY):
            seen = bench.control.state()
            assert (seen.power, seen.shuttered, seen.source) == (power, None, None)
            bench.clock.sleep(COOL_DOWN_S)

    def test_a_refused_query_is_none_in_the_state(self, bench: Bench) -> None:
        bench.arm(bench.table.hours.command, refused_commands=1)
        seen = bench.control.state()
        assert (seen.power, seen.lamp_hours) == (Power.ON, None)

    def test_errors_are_given_in_words(self, bench: Bench) -> None:
        code, text = bench.fault
        bench.state.report_error(code)
        bench.state.report_error("7E")
        assert bench.control.state().errors == (text, "error code 7E")

    def test_a_fault_is_reported(self, bench: Bench) -> None:
        bench.state.break_down(bench.fault[0])
        seen = bench.control.state()
        assert (seen.power, seen.errors) == (Power.ERROR, (bench.fault[1],))

    def test_a_fault_without_a_reason_is_reported(self, bench: Bench) -> None:
        bench.state.break_down("00")
        assert bench.control.state().errors == ("fault without a stated reason",)

    def test_a_projector_with_a_fault_is_not_switched_on_and_counts_as_off(
        self, bench: Bench
    ) -> None:
        bench.state.break_down(bench.fault[0])
        text = message(WrongState, bench, lambda: bench.control.set_power(True))
        assert f"reports a fault ({bench.fault[1]})" in text
        assert "clear it at the projector" in text
        bench.control.set_power(False)


class TestShutterIsConfirmedOrAnError:
    @pytest.mark.parametrize(("closed", "ordered"), [(True, "closed"), (False, "open")])
    def test_a_stuck_shutter_is_an_error(self, bench: Bench, *, closed: bool, ordered: str) -> None:
        bench.control.set_shutter(not closed)
        bench.state.shutter_stuck = True
        text = message(WrongState, bench, lambda: bench.control.set_shutter(closed))
        assert text.startswith(f"shutter {ordered} is not confirmed: ")
        answers = (bench.reads(closed=not closed), bench.reads(closed=closed))
        assert "still answers {} after 3 s instead of {};".format(*answers) in text
        assert "switch it off if the picture must be dark" in text

    def test_a_slow_shutter_is_waited_for(self, bench: Bench) -> None:
        class Slow(SceneClock):
            """Time in which the shutter moves."""

            def sleep(self, duration_s: float) -> None:
                bench.state.shutter_stuck = False
                bench.state.set_muted(True)

        bench.state.shutter_stuck = True
        bench.another_control(clock=Slow()).set_shutter(True)
        assert bench.state.muted

    def test_a_command_that_never_arrives_is_given_again(self, bench: Bench) -> None:
        bench.arm(bench.table.shutter_commands[True], lost_commands=1)
        bench.control.set_shutter(True)
        assert bench.state.muted

    def test_silence_instead_of_confirmation_is_an_error(self, bench: Bench) -> None:
        bench.arm(bench.table.shutter.command, lost_replies=3)
        text = message(DeviceTimeout, bench, lambda: bench.control.set_shutter(True))
        assert text.startswith("shutter closed is not confirmed: ")
        assert f"{shown(bench.table.shutter.command)} in 3 attempts" in text

    def test_a_refused_shutter_is_an_error(self, bench: Bench) -> None:
        bench.arm(bench.table.shutter_commands[True], refused_commands=1)
        text = message(WrongState, bench, lambda: bench.control.set_shutter(True))
        assert text.startswith("shutter closed is not confirmed: ")
        assert f"refused {shown(bench.table.shutter_commands[True])} with" in text
        assert "check that this model has the command" in text

    def test_a_projector_in_standby_cannot_confirm(self, bench: Bench) -> None:
        bench.state.switch_off()
        bench.clock.sleep(COOL_DOWN_S)
        text = message(WrongState, bench, lambda: bench.control.set_shutter(True))
        assert "is in power state standby; switch it on first" in text

    @pytest.mark.parametrize("closed", [True, False])
    def test_a_late_reply_does_not_confirm(self, bench: Bench, *, closed: bool) -> None:
        bench.control.set_shutter(closed)
        bench.arm(bench.table.shutter.command, late_replies=1)
        assert bench.control.state().shuttered is closed
        bench.control.set_shutter(not closed)
        assert bench.state.muted is not closed

    def test_replies_that_stay_late_do_not_confirm(self, bench: Bench) -> None:
        bench.control.set_shutter(True)
        bench.arm(bench.table.shutter.command, late_replies=3)
        message(DeviceTimeout, bench, bench.control.state)
        bench.control.set_shutter(False)
        bench.state.shutter_stuck = True  # what is confirmed now must be an answer of now
        message(WrongState, bench, lambda: bench.control.set_shutter(True))


class ChoosesForItself(ProjectorState):
    """A projector that keeps its input after every command."""

    def __setattr__(self, name: str, value: object) -> None:
        if name != "source" or not hasattr(self, "source"):
            super().__setattr__(name, value)


class TestInput:
    def test_an_invalid_source_code_is_refused_with_examples(self, bench: Bench) -> None:
        text = message(InputError, bench, lambda: bench.control.set_input("hdmi"))
        assert "input 'hdmi' is not a source code" in text
        assert f"{bench.sources[0]} ({bench.table.source_names[bench.sources[0]]})" in text

    def test_a_code_the_model_lacks_is_refused_by_the_projector(self, bench: Bench) -> None:
        text = message(WrongState, bench, lambda: bench.control.set_input(bench.no_source))
        assert text.startswith(f"input {bench.no_source} is not confirmed: ")
        assert " refused " in text

    def test_an_input_that_does_not_change_is_an_error(self, bench: Bench) -> None:
        bench.emulator.state = ChoosesForItself(bench.clock, on=True, source=bench.sources[2])
        text = message(WrongState, bench, lambda: bench.control.set_input(bench.sources[1]))
        _, wanted, stays = bench.sources
        assert f"still answers {stays} after 3 s instead of {wanted};" in text

    def test_a_group_code_is_confirmed_by_a_member(self, bench: Bench) -> None:
        groups = {bench.sources[1]: frozenset({bench.sources[2]})}

        bench.emulator.state = ChoosesForItself(bench.clock, on=True, source=bench.sources[2])
        control = bench.another_control(table=replace(bench.table, source_groups=groups))
        control.set_input(bench.sources[1])
        assert control.state().source == bench.sources[2]


class TestPowerOnABadWire:
    @pytest.fixture(autouse=True)
    def standby(self, bench: Bench) -> None:
        bench.state.switch_off()
        bench.clock.sleep(COOL_DOWN_S)

    @pytest.mark.parametrize("fault", ["lost_replies", "late_replies", "lost_commands"])
    def test_a_power_command_that_is_not_answered(self, bench: Bench, fault: str) -> None:
        bench.arm(bench.table.power_on, **{fault: 1})
        bench.control.set_power(True)
        assert bench.state.power is Power.ON

    @pytest.mark.parametrize("fault", ["lost_commands", "refused_commands"])
    def test_a_projector_too_busy_to_answer_while_warming(self, bench: Bench, fault: str) -> None:
        class Busy(SceneClock):
            """Lets the wire fail from the first wait on, for a while."""

            def sleep(self, duration_s: float) -> None:
                if bench.state.power is Power.STANDBY:
                    pytest.fail("waited for a lamp that was not switched on")
                if bench.clock.now_s() == COOL_DOWN_S:
                    setattr(bench.emulator.faults, fault, bench.table.attempts)
                bench.clock.sleep(duration_s)

            def now_s(self) -> float:
                return bench.clock.now_s()

        bench.another_control(clock=Busy()).set_power(True)
        assert bench.state.power is Power.ON

    def test_a_refused_power_command_is_an_error(self, bench: Bench) -> None:
        bench.arm(bench.table.power_on, refused_commands=1)
        text = message(WrongState, bench, lambda: bench.control.set_power(True))
        assert f"refused {shown(bench.table.power_on)} with" in text

    def test_a_lamp_that_never_comes_up_is_an_error(self, bench: Bench) -> None:
        slow = ProjectorState(bench.clock, warm_up_s=1e9)
        bench.emulator.state = slow
        text = message(DeviceTimeout, bench, lambda: bench.control.set_power(True))
        assert "is in power state warming, not on, after 240 s" in text
        assert "check its indicator lights" in text

    def test_a_lamp_that_fails_while_warming_is_an_error(self, bench: Bench) -> None:
        class Failing(SceneClock):
            def sleep(self, duration_s: float) -> None:
                bench.state.break_down(bench.fault[0])

        control = bench.another_control(clock=Failing())
        text = message(WrongState, bench, lambda: control.set_power(True))
        assert bench.fault[1] in text


@pytest.mark.parametrize("table", SERIAL_TABLES.values(), ids=SERIAL_TABLES)
def test_every_source_code_and_group_can_be_selected(table: SerialTable) -> None:
    for code in {*table.source_names, *table.source_groups}:
        assert table.source_code.fullmatch(code)


@pytest.mark.parametrize(
    ("code", "power"),
    [
        ("00", Power.STANDBY),
        ("01", Power.ON),
        ("02", Power.WARMING),
        ("03", Power.COOLING),
        ("04", Power.STANDBY),
        ("05", Power.ERROR),
        ("09", Power.STANDBY),
    ],
)
def test_esc_vp21_power_codes(code: str, power: Power) -> None:
    assert ESC_VP21.power_codes[code] is power


def test_esc_vp21_gives_the_hours_of_two_lamps() -> None:
    match = ESC_VP21.hours.reply.fullmatch(b"LAMP=1200 340\r:")
    assert match is not None
    assert match["value"] == b"1200 340"
