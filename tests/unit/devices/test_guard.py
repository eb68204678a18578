"""Light that another thread takes away, at any moment of a call, does not come back."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from fake_devices import SIZE, Clock, Control, Projector, nothing

from procam.devices.guard import Guard
from procam.devices.protocols import Power, Shown
from procam.devices.rig import Rig
from procam.errors import InputError, WrongState
from procam.threads import start

STUCK_S = 120.0
WHY = InputError("somebody may be in the dome")
WHITE = np.ones((SIZE[1], SIZE[0], 3), np.float32)


class Camera:
    name, size = "c", SIZE

    def __init__(self) -> None:
        self.meanwhile = nothing

    def configure(self, settings: Any) -> Any:
        return settings

    def capture(self) -> str:
        self.meanwhile()
        return "a photograph"


class Bench:
    def __init__(self) -> None:
        self.projector, self.camera, self.control = Projector(), Camera(), Control()
        self.clock = Clock()
        self.plain: Any = Rig(
            {"c": self.camera},  # type: ignore[dict-item]
            {"p": self.projector},
            {"p": self.control},  # type: ignore[dict-item]
            self.clock,
        )
        self.guard = Guard(self.plain)
        self.rig: Any = self.guard.rig

    def take(self) -> None:
        """Take the light, from another thread."""
        assert start(lambda: self.guard.close(WHY, STUCK_S)).result(STUCK_S) == {}

    def take_in_a_call(self) -> None:
        """The same while a call to the remote control is on its way, which may light it yet."""
        lit = start(lambda: self.guard.close(WHY, 0.1)).result(STUCK_S)
        assert lit == {"p": "no answer within 0.1 s"}

    @property
    def dark(self) -> bool:
        return not self.projector.lit and not self.control.open


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    with bench.guard:
        yield bench


def calls(bench: Bench) -> list[tuple[str, Callable[[], object]]]:
    """All that lights, or needs light."""
    rig = bench.rig
    return [
        ("projector", lambda: rig.projectors["p"].show(WHITE)),
        ("control", lambda: rig.controls["p"].set_shutter(False)),
        ("control", lambda: rig.controls["p"].set_power(True)),
        ("control", lambda: rig.controls["p"].set_input("30")),
        ("camera", rig.cameras["c"].capture),
    ]


def test_it_is_as_the_rig_before(bench: Bench) -> None:
    for _, call in calls(bench):
        call()
    assert bench.projector.lit and bench.control.open and bench.guard.closed is None
    bench.guard.check()


def test_nothing_lights_after_that_and_all_is_dark(bench: Bench) -> None:
    bench.rig.projectors["p"].show(WHITE)
    bench.rig.light("p")
    bench.take()
    for _, call in calls(bench):
        with pytest.raises(InputError, match="somebody may be in the dome"):
            call()
        assert bench.dark and bench.projector.times_lit == 1
    with pytest.raises(InputError), bench.rig:
        bench.rig.cameras["c"].configure(None)
    assert bench.dark and bench.rig.dark


@pytest.mark.parametrize("number", range(5))
def test_a_call_that_is_on_its_way_is_followed_by_darkness(number: int, bench: Bench) -> None:
    """Also one that hangs for longer than black waits for its turn."""
    device, call = calls(bench)[number]
    take = bench.take_in_a_call if device == "control" else bench.take
    getattr(bench, device).meanwhile = take
    with pytest.raises(InputError, match="somebody may be in the dome"):
        call()
    assert bench.dark
    bench.take()
    assert bench.dark


def test_a_picture_that_fails_is_followed_by_black_too(bench: Bench) -> None:
    def meanwhile() -> None:
        bench.take()
        bench.projector.lit = True
        raise OSError("cable")

    bench.projector.meanwhile = meanwhile
    with pytest.raises(InputError):
        bench.rig.projectors["p"].show(WHITE)
    assert bench.dark


def test_who_does_not_answer_in_time_is_named_and_the_others_are_dark(bench: Bench) -> None:
    may_end, shut = threading.Event(), bench.control.set_shutter

    def hangs(closed: bool) -> None:
        assert may_end.wait(STUCK_S)
        shut(closed)

    bench.projector.lit = bench.control.open = True
    bench.control.set_shutter = hangs  # type: ignore[method-assign]
    began = time.monotonic()
    assert bench.guard.close(WHY, 0.2) == {"p": "no answer within 0.2 s"}
    assert time.monotonic() - began < STUCK_S / 2
    assert not bench.projector.lit
    may_end.set()
    assert bench.guard.close(WHY, STUCK_S) == {}
    assert bench.dark


def test_what_fails_is_said(bench: Bench) -> None:
    def broken(_: bool) -> None:
        raise WrongState("stuck")

    bench.control.set_shutter = broken  # type: ignore[method-assign]
    assert bench.guard.close(WHY, STUCK_S) == {"p": "stuck"}


def test_a_driver_that_wants_to_end_the_process_is_named(bench: Bench) -> None:
    def ends(_: object) -> Shown:
        raise SystemExit

    bench.projector.show = ends  # type: ignore[assignment]
    assert bench.guard.close(WHY, STUCK_S) == {"p": "SystemExit"}


def test_a_lamp_that_is_warming_up_is_waited_for(bench: Bench) -> None:
    bench.control.power, bench.control.open = Power.WARMING, True

    def warm() -> None:
        if bench.clock.t_s > 30:
            bench.control.power = Power.ON

    bench.clock.due = warm
    bench.take()
    assert bench.dark and 30 < bench.clock.t_s < 60


def test_a_lamp_that_is_off_is_dark(bench: Bench) -> None:
    bench.control.power = Power.STANDBY
    bench.take()
    assert bench.dark


def test_a_lamp_that_is_switched_on_is_not_dark_yet(bench: Bench) -> None:
    """It says that it is off, until the order arrives."""
    bench.control.power = Power.STANDBY
    bench.control.meanwhile = bench.take_in_a_call
    with pytest.raises(InputError, match="somebody may be in the dome"):
        bench.rig.controls["p"].set_power(True)
    bench.take()
    assert bench.dark and bench.control.power is Power.ON
