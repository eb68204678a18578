"""Benches for the contract of serial remote controls: a control, a wire, an emulated projector.

A new make joins by adding one factory to `MAKES`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest

from procam.devices.control.escvp21 import ESC_VP21
from procam.devices.control.projector_control import SerialProjectorControl
from procam.devices.control.serial_link import SerialLink
from procam.devices.control.serial_table import SerialTable
from procam.devices.protocols import Clock, Power
from procam.errors import ProcamError
from simulators.clock import SceneClock
from simulators.projector_state import ProjectorState
from simulators.serial_port import EmulatedEscVp21

WARM_UP_S = 30.0
COOL_DOWN_S = 20.0


@dataclass
class Bench:
    """One make's control, wired to an emulated projector whose inside the tests can see.

    `sources` are codes of inputs that the projector has, `no_source` is one it lacks; `fault` is
    an error code and its text; `shutter_open` is a complete reply; `longest_reply` counts bytes.
    """

    protocol: str
    table: SerialTable
    clock: SceneClock
    state: ProjectorState
    emulator: EmulatedEscVp21
    link: SerialLink
    control: SerialProjectorControl
    sources: tuple[str, str, str]
    no_source: str
    fault: tuple[str, str]
    shutter_open: bytes
    longest_reply: int

    def reads(self, *, closed: bool) -> str:
        """Answer to the shutter question in that state."""
        return next(word for word, dark in self.table.shutter_codes.items() if dark is closed)

    def another_control(
        self, *, table: SerialTable | None = None, clock: Clock | None = None
    ) -> SerialProjectorControl:
        """Give a control on the same wire, with another table or clock."""
        return SerialProjectorControl(
            self.link, table or self.table, clock=clock or self.clock, name="north"
        )

    def close(self) -> None:
        """Let go of both ends of the wire."""
        self.control.close()
        self.emulator.close()

    def arm(self, question: bytes = b"", **faults: object) -> None:
        """Get in step, then let the wire fail from here on, for commands that start so."""
        self.control.state()
        self.emulator.faults.commands = question.rstrip(b"\r")
        for name, value in faults.items():
            setattr(self.emulator.faults, name, value)


def escvp21() -> Bench:
    clock = SceneClock()
    state = ProjectorState(
        clock, on=True, warm_up_s=WARM_UP_S, cool_down_s=COOL_DOWN_S, lamp_hours=1234.5
    )
    emulator = EmulatedEscVp21(state)
    timings = replace(ESC_VP21.timings, reply_s=0.2, source_reply_s=0.2, quiet_s=0.03)
    table = replace(ESC_VP21, timings=timings)
    link = SerialLink(emulator.port, longest_reply=64)
    control = SerialProjectorControl(link, table, clock=clock, name="north")
    return Bench(
        protocol="escvp21",
        table=table,
        clock=clock,
        state=state,
        emulator=emulator,
        link=link,
        control=control,
        sources=("30", "A0", "41"),
        no_source="99",
        fault=("04", "internal temperature high"),
        shutter_open=b"MUTE=OFF\r:",
        longest_reply=len(b"SOURCE=30\r:"),
    )


MAKES: tuple[Callable[[], Bench], ...] = (escvp21,)


def shown(command: bytes) -> str:
    """A command as messages show it."""
    return repr(command.strip().decode())


def do_everything(bench: Bench) -> None:
    """Use every kind of exchange, and check what the projector and its control make of it."""
    for closed, source in ((True, bench.sources[1]), (False, bench.sources[0])):
        bench.control.set_shutter(closed)
        bench.control.set_input(source)
        assert (bench.state.muted, bench.state.source) == (closed, source)
        seen = bench.control.state()
        assert (seen.power, seen.shuttered, seen.source) == (Power.ON, closed, source)
        assert (seen.lamp_hours, seen.errors) == (1234, ())


def message(kind: type[ProcamError], bench: Bench, act: Callable[[], object]) -> str:
    """Text of the error that `act` ends in; it must name the projector and its port."""
    with pytest.raises(kind) as caught:
        act()
    assert caught.type is kind
    text = str(caught.value)
    assert "projector north" in text
    assert bench.emulator.port in text
    return text
