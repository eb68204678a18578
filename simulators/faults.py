"""Named faults that strike a simulated venue in mid-capture."""

from collections.abc import Mapping
from dataclasses import replace

from procam.devices.protocols import BackendRig, Camera
from procam.model.frame import CameraSettings, Frame
from simulators.serial_port import EmulatedEscVp21

STRIKE_AT_FRAME = 9


class StaleCamera:
    """A camera whose trigger slips once: it delivers the picture before the asked one again."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.name, self.size = camera.name, camera.size
        self._taken = 0
        self._last: Frame | None = None

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """As the real camera does."""
        return self._camera.configure(settings)

    def capture(self) -> Frame:
        """The picture, or once the one before it."""
        self._taken += 1
        if self._taken == STRIKE_AT_FRAME and self._last is not None:
            return self._last
        self._last = self._camera.capture()
        return self._last


def apply_faults(
    rig: BackendRig, wires: Mapping[str, EmulatedEscVp21], names: tuple[str, ...]
) -> BackendRig:
    """The rig with the named faults built in."""
    if "stale-frame" in names:
        rig = replace(rig, cameras={n: StaleCamera(c) for n, c in rig.cameras.items()})
    if "unplugged-serial" in names:
        last = list(wires.values())[-1]
        last.faults.commands, last.faults.unplug_at = b"MUTE OFF", 0
    return rig
