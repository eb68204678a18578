"""The rig leaves projectors dark, whatever happens."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from fake_devices import Clock, Control, Projector

from procam.devices.protocols import BackendRig, Power, Shown
from procam.devices.rig import Rig, open_backend, open_control
from procam.errors import DeviceError, InputError


def _rig(log: list[str], controls: Mapping[str, Any] | None = None) -> Rig:
    if controls is None:
        controls = {name: Control(name, log=log) for name in "ab"}
    projectors = {name: Projector(name, lit=True) for name in "ab"}
    return Rig({}, projectors, controls, Clock(), (lambda: log.append("closer"),))


def _dark(rig: Rig) -> bool:
    return not any(p.lit for p in rig.projectors.values())  # type: ignore[attr-defined]


class TestWayOut:
    def test_projectors_darken_then_ports_close_then_the_backend(self) -> None:
        log: list[str] = []
        with _rig(log) as rig:
            assert not _dark(rig)
        assert _dark(rig)
        assert sorted(log[:2]) == ["a shutter True", "b shutter True"]
        assert sorted(log[2:4]) == ["a close", "b close"]
        assert log[4:] == ["closer"]

    def test_dark_after_an_error_too(self) -> None:
        log: list[str] = []
        with pytest.raises(KeyboardInterrupt), _rig(log) as rig:
            raise KeyboardInterrupt
        assert _dark(rig) and log[-1] == "closer"

    def test_one_failing_projector_does_not_keep_the_others_lit(self) -> None:
        log: list[str] = []
        broken = Control("b", log=log)
        broken.broken = True
        with (
            pytest.raises(
                DeviceError, match=r"still be lit: b \(nobody home\); close its shutter or switch"
            ),
            _rig(log, {"a": Control("a", log=log), "b": broken}) as rig,
        ):
            pass
        assert _dark(rig)
        assert log == ["a shutter True", "b close", "a close", "closer"]

    def test_what_is_lit_is_said_even_if_a_connection_does_not_close(self) -> None:
        log: list[str] = []
        broken = Control("b", log=log)
        broken.broken = True

        def close() -> None:
            raise OSError(5, "Input/output error")

        broken.close = close  # type: ignore[method-assign]
        with (
            pytest.raises(DeviceError, match=r"still be lit: b \(nobody home\)"),
            _rig(log, {"a": Control("a", log=log), "b": broken}),
        ):
            pass

    def test_borrowed_lamps_are_switched_off_when_all_is_dark(self) -> None:
        log: list[str] = []
        with _rig(log) as rig:
            rig.borrowed = ["b"]
        assert sorted(log[:2]) == ["a shutter True", "b shutter True"]
        assert log[2] == "b power False" and log[-1] == "closer" and rig.dark

    def test_connections_are_closed_though_a_lamp_does_not_go_out(self) -> None:
        log: list[str] = []

        def refuse(_: bool) -> None:
            raise DeviceError("refused")

        with pytest.raises(DeviceError, match="refused"), _rig(log) as rig:
            rig.borrowed = ["b"]
            rig.controls["b"].set_power = refuse  # type: ignore[method-assign]
        assert log[-1] == "closer" and rig.dark

    def test_one_lamp_that_stays_on_does_not_keep_others_on(self) -> None:
        log: list[str] = []
        broken = Control("a", log=log)
        rig = _rig(log, {"a": broken, "b": Control("b", log=log)})
        message = r"were off before may still be on: a \(nobody home\); switch them off by hand"
        with pytest.raises(DeviceError, match=message), rig:
            rig.borrowed = ["a", "b"]
            rig.darken_all()
            rig.darken_all = dict  # type: ignore[method-assign]  # all is dark
            broken.broken = True
        assert "b power False" in log and log[-1] == "closer" and rig.dark

    def test_a_shutter_is_closed_though_black_cannot_be_shown(self) -> None:
        log: list[str] = []

        def refuse(_: np.ndarray) -> Shown:
            raise DeviceError("output is gone")

        with pytest.raises(DeviceError, match="a \\(output is gone\\)"), _rig(log) as rig:
            rig.projectors["a"].show = refuse  # type: ignore[method-assign]
        assert "a shutter True" in log and "b shutter True" in log

    def test_a_lamp_that_warms_up_is_waited_for(self) -> None:
        log: list[str] = []
        control = Control("a", Power.WARMING, log)
        rig = _rig(log, {"a": control})
        rig.clock.due = lambda: setattr(control, "power", Power.ON)  # type: ignore[attr-defined]
        with rig:
            pass
        assert log == ["a shutter True", "a close", "closer"]

    def test_without_remote_control_black_is_shown(self) -> None:
        with _rig([], {}) as rig:
            pass
        assert _dark(rig)


class TestLight:
    def test_start_switches_on_what_is_off_and_makes_it_dark(self) -> None:
        log: list[str] = []
        rig = _rig(log, {"a": Control("a", Power.STANDBY, log), "b": Control("b", log=log)})
        rig.start()
        assert "a power True" in log and "b power True" not in log
        assert _dark(rig)
        assert {"a shutter True", "b shutter True"} <= set(log)

    def test_black_is_shown_before_a_lamp_is_on(self) -> None:
        """While it warms up it refuses its shutter."""
        control, lit = Control("a", Power.STANDBY), list[bool]()
        rig: Any = _rig([], {"a": control})
        control.set_power = lambda _: lit.append(rig.projectors["a"].lit)  # type: ignore[method-assign]
        rig.start()
        assert lit == [False]

    def test_light_opens_one_shutter(self) -> None:
        log: list[str] = []
        _rig(log).light("b")
        assert log == ["b shutter False"]

    def test_a_projector_in_standby_is_left_alone(self) -> None:
        log: list[str] = []
        rig = _rig(log, {"a": Control("a", Power.STANDBY, log)})
        rig.darken("a")
        assert log == []


class TestOpening:
    def test_an_unknown_backend_is_refused_with_the_known(self) -> None:
        with pytest.raises(
            InputError, match=r"backend 'nope' is not installed; choose one of .*simulated"
        ):
            open_backend("nope", {}, None)  # type: ignore[arg-type]

    def test_a_backend_without_a_control_port(self) -> None:
        backend = BackendRig({}, {}, Clock())
        with pytest.raises(DeviceError, match=r"projector a: its backend provides no control port"):
            open_control("a", "escvp21", "backend", backend)
