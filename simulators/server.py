"""A simulated media server: dome masters in, the frames of its projectors out.

Its alignment and soft edges are its own, imperfect, and not reported.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.devices.protocols import Shown
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import master_directions, master_pixels, normalise
from simulators.devices import require_drive
from simulators.projector_light import ProjectorLight
from simulators.projector_state import ProjectorState
from simulators.scene import DomeScene
from simulators.surface import Surface

NAME = "server"
BITS = 10  # of the masters it plays
ASSUMED_GAMMA = 2.2  # that the server assumes of its projectors
ERROR_ARCMIN = 1.5  # rms of its alignment, for each projector, both directions together
WAVES = 3  # largest number of half waves of the alignment's error across a panel
SETTLE_S = 0.1
ARCMIN = np.degrees(1) * 60


@dataclass(frozen=True)
class _Output:
    """One projector behind the server.

    Attributes
    ----------
    where : (H, W, 2) place in the master that the server reads for each panel pixel [px].
    encoded : (H, W, 1) soft edge as a factor on the drive.
    """

    where: Image
    encoded: Image


class MediaServer:
    """The server's alignment and soft edges: projector frames from dome masters.

    Its masters span `fov` [rad], and their bottom edge is shown at azimuth `rotation` [rad].

    Both are those of the venue before it drifted, and so are `pixel_directions`.
    """

    def __init__(
        self, scene: DomeScene, size: int, fov: float = np.pi, rotation: float = 0
    ) -> None:
        self.size, self.fov, self.turn = size, fov, _turn(rotation)
        assert isinstance(scene.surface, Surface)
        self._lights, self._surface = scene.undrifted.lights, scene.surface
        rng = np.random.default_rng([scene.seed, 77])
        self._shift = {name: _waves(light, rng) for name, light in self._lights.items()}
        self._outputs = {name: self._output(name) for name in self._lights}

    def frames(self, master: Image) -> dict[str, Image]:
        """Drives (H, W, 3) of the projectors for a master (N, N, 3), each in 0..1."""
        steps = np.float32(2**BITS - 1)
        played = np.rint(master * steps) / steps
        return {name: _rendered(played, output) for name, output in self._outputs.items()}

    def pixel_directions(self) -> tuple[Array, BoolArray]:
        """True directions (N, N, 3) of the master's pixels, and which of them reach the dome (N, N).

        Where soft edges overlap it is the mean over the projectors.
        """
        ideal, inside = master_directions(self.size, self.fov)
        ideal = ideal @ self.turn.T
        total, weight = np.zeros_like(ideal), np.zeros(inside.shape)
        for name, light in self._lights.items():
            pull, pixel = self._weight(name, ideal)
            # the shift is smooth: its value at the nominal pixel is that at the true one
            shift = cv2.remap(  # type: ignore[call-overload]
                self._shift[name], pixel.astype(np.float32), None, cv2.INTER_LINEAR
            )
            total += pull[..., None] * normalise(ideal - shift)
            lit = light.lit.astype(np.float32)
            arriving = cv2.remap(lit, pixel.astype(np.float32), None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
            weight += pull * (arriving >= 0.5)
        reached = inside & (weight > 0)
        return normalise(np.where(reached[..., None], total, ideal)), reached

    def _output(self, name: str) -> _Output:
        nominal = normalise(self._lights[name].direction + self._shift[name])
        pulls = {other: self._weight(other, nominal)[0] for other in self._lights}
        share = pulls[name] / np.maximum(np.sum(list(pulls.values()), axis=0), 1e-9)
        encoded = share ** (1 / ASSUMED_GAMMA)
        return _Output(
            master_pixels(nominal @ self.turn, self.size, self.fov).astype(np.float32),
            encoded.astype(np.float32)[..., None],
        )

    def _weight(self, name: str, direction: Array) -> tuple[Array, Array]:
        """Distance (H, W) from the edge of a projector's panel of directions (H, W, 3), and their pixels."""
        build = self._lights[name].build
        point = self._surface.radius(direction)[..., None] * direction
        pixel = project(build.projector_from_dome.apply(point), build.lens)
        size = np.array(build.size)
        near = np.minimum(pixel + 0.5, size - 0.5 - pixel).min(axis=-1)
        return np.clip(np.nan_to_num(near, nan=0.0), 0, None) / size.max(), pixel


class SimulatedServer:
    """The picture input of a media server for the projectors of a scene."""

    def __init__(self, scene: DomeScene, server: MediaServer) -> None:
        self._scene, self._server = scene, server
        self.name = NAME
        self.size = (server.size, server.size)

    def show(self, drive: Image) -> Shown:
        """Show a dome master `drive` (N, N, 3) in 0..1."""
        require_drive("master of the server", drive, self.size)
        for name, frame in self._server.frames(drive).items():
            self._scene.show(name, frame)
        self._scene.clock.sleep(SETTLE_S)
        return Shown(drive, self._scene.clock.now_s())


class Relay(ProjectorState):
    """One lamp switch and shutter for all projectors of a scene, whose lamps stay their own."""

    def __init__(self, scene: DomeScene) -> None:
        super().__init__(scene.clock)
        self._states = tuple(scene.states.values())

    def switch_on(self) -> None:
        """Ignite all lamps."""
        super().switch_on()
        for state in self._states:
            state.switch_on()

    def switch_off(self) -> None:
        """Put out all lamps."""
        super().switch_off()
        for state in self._states:
            state.switch_off()

    def set_muted(self, muted: bool) -> None:
        """Mute or show all pictures; a stuck shutter stays as it is."""
        super().set_muted(muted)
        for state in self._states:
            state.set_muted(self.muted)

    def break_down(self, code: str) -> None:
        """Fail for the reason `code`: all lamps go out and stay out."""
        super().break_down(code)
        for state in self._states:
            state.break_down(code)


def _turn(angle: float) -> Array:
    """The rotation (3, 3) about the pole by an angle to the left [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def projector_drives(
    server: MediaServer | None, drives: Mapping[str, Image]
) -> Mapping[str, Image]:
    """Drives of the projectors of a scene for drives by device name."""
    return drives if server is None else server.frames(drives[NAME])


def _rendered(master: Image, output: _Output) -> Image:
    frame = cv2.remap(master, output.where, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    return np.asarray(np.clip(frame * output.encoded, 0, 1), np.float32)


def _waves(light: ProjectorLight, rng: np.random.Generator) -> Image:
    """A smooth error (H, W, 3) of directions, as a shift of unit vectors."""
    height, width = light.lit.shape
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    shift = np.zeros((height, width, 3))
    for axis in range(3):
        for i in range(WAVES + 1):
            for j in range(WAVES + 1 - i):
                shift[..., axis] += (
                    rng.normal()
                    * np.cos(np.pi * (i * x + rng.uniform()))
                    * np.cos(np.pi * (j * y + rng.uniform()))
                )
    shift -= light.direction * np.sum(shift * light.direction, axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(np.sum(shift[light.lit] ** 2, axis=-1)))
    return np.asarray(shift * (ERROR_ARCMIN / ARCMIN / rms), np.float32)
