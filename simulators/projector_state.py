"""The electrical state of one simulated projector, in the scene's time."""

import math
import threading

from procam.devices.protocols import Clock, Power
from procam.errors import WrongState
from simulators.builds import SETTLING_S, Features


class ProjectorState:
    """Lamp, shutter, input and faults, shared by the rendering and the serial port.

    Safe to use from the thread that renders the scene and from the one that serves the port.

    Parameters
    ----------
    clock : the scene's time.
    on : start with the lamp on; otherwise in standby.
    warm_up_s, cool_down_s : time that the lamp takes to reach full light and to cool [s].
    source : active input, a code of the emulated make.
    lamp_hours : hours on the lamp before the scene began [h].
    features : those that its menu has switched on, and of its lamp.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        on: bool = False,
        warm_up_s: float = 30.0,
        cool_down_s: float = 20.0,
        source: str = "30",
        lamp_hours: float = 0.0,
        features: Features | None = None,
    ) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._warm_up_s = warm_up_s
        self._cool_down_s = cool_down_s
        self._power = Power.ON if on else Power.STANDBY
        self._since_s = clock.now_s()
        self._lit_since_s = self._since_s if on else None
        self._lamp_s = 3600.0 * lamp_hours
        self._muted = False
        self._error_codes: tuple[str, ...] = ()
        self._features = features or Features()
        self._load, self._load_before, self._loaded_s = 0.0, 0.0, self._since_s
        self.source = source
        self.shutter_stuck = False

    @property
    def power(self) -> Power:
        """Power state now."""
        with self._lock:
            return self._advance()

    @property
    def muted(self) -> bool:
        """Whether the picture is muted; switching off ends it."""
        with self._lock:
            return self._muted

    @property
    def lamp_hours(self) -> float:
        """Hours on the lamp [h]."""
        with self._lock:
            return (self._lamp_s + self._burning_s()) / 3600.0

    @property
    def error_codes(self) -> tuple[str, ...]:
        """Fault codes of the emulated make."""
        with self._lock:
            return self._error_codes

    def light_factor(self) -> float:
        """Share of the full light that leaves the lens now, 0..1."""
        with self._lock:
            power = self._advance()
            if self._muted:
                return 0.0
            if power is Power.WARMING:  # a lamp is dim at first
                rise = ((self._clock.now_s() - self._since_s) / self._warm_up_s) ** 2
                return rise * (1 - self._features.settling)
            return self._feature_factor() * self._settled() if power is Power.ON else 0.0

    def follow(self, load: float) -> None:
        """Set the mean drive (0..1) of the picture that is shown from now on."""
        with self._lock:
            self._load_before = self._load_behind()
            self._load, self._loaded_s = load, self._clock.now_s()

    def switch_on(self) -> None:
        """Ignite the lamp; raises `WrongState` while cooling or with a fault."""
        with self._lock:
            power = self._advance()
            if power in (Power.COOLING, Power.ERROR):
                raise WrongState(f"simulated projector: cannot switch on in state {power}")
            if power is Power.STANDBY:
                self._enter(Power.WARMING, self._clock.now_s())
                self._lit_since_s = self._since_s

    def switch_off(self) -> None:
        """Put out the lamp; raises `WrongState` while it is warming up."""
        with self._lock:
            power = self._advance()
            if power is Power.WARMING:
                raise WrongState(f"simulated projector: cannot switch off in state {power}")
            if power is Power.ON:
                self._put_out(Power.COOLING)

    def set_muted(self, muted: bool) -> None:
        """Mute or show the picture; a stuck shutter stays as it is."""
        with self._lock:
            if not self.shutter_stuck:
                self._muted = muted

    def report_error(self, code: str) -> None:
        """Add a fault that does not stop the projector."""
        with self._lock:
            self._error_codes += (code,)

    def break_down(self, code: str) -> None:
        """Fail for the reason `code`: the lamp goes out and stays out."""
        with self._lock:
            self._error_codes += (code,)
            self._put_out(Power.ERROR)

    def _feature_factor(self) -> float:
        """Share of the full light with the menu features."""
        features = self._features
        open_iris = 1 - features.dynamic_black * (1 - self._load_behind())
        return open_iris * (1 - features.constant_light * self._load)

    def _settled(self) -> float:
        """Share of its full light that the lamp has reached since its warm-up."""
        on_s = self._clock.now_s() - self._since_s
        return 1 - self._features.settling * math.exp(-on_s / SETTLING_S)

    def _load_behind(self) -> float:
        """The mean drive that an iris, which follows with a delay, has reached."""
        if self._features.iris_s == 0:
            return self._load
        left = math.exp(-(self._clock.now_s() - self._loaded_s) / self._features.iris_s)
        return self._load + (self._load_before - self._load) * left

    def _put_out(self, power: Power) -> None:
        """Put out the lamp and enter `power`."""
        self._lamp_s += self._burning_s()
        self._lit_since_s = None
        self._muted = False
        self._enter(power, self._clock.now_s())

    def _burning_s(self) -> float:
        """Seconds since the lamp was ignited; 0 when it is out [s]."""
        return 0.0 if self._lit_since_s is None else self._clock.now_s() - self._lit_since_s

    def _advance(self) -> Power:
        """Update the power state to the present time."""
        for_s = self._clock.now_s() - self._since_s
        if self._power is Power.WARMING and for_s >= self._warm_up_s:
            self._enter(Power.ON, self._since_s + self._warm_up_s)
        elif self._power is Power.COOLING and for_s >= self._cool_down_s:
            self._enter(Power.STANDBY, self._since_s + self._cool_down_s)
        return self._power

    def _enter(self, power: Power, since_s: float) -> None:
        self._power = power
        self._since_s = since_s
