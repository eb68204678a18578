"""A simulated media server: dome masters in, the frames of its projectors out.

It has an alignment and soft edges of its own, neither of them perfect, and tells nobody of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.devices.protocols import Shown
from procam.errors import ShapeError, UnitError
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import (
    master_directions,
    master_pixels,
    master_solid_angles,
    normalise,
)
from simulators.projector_light import ProjectorLight
from simulators.projector_state import ProjectorState
from simulators.scene import DomeScene

Array = NDArray[np.float64]
Image = NDArray[np.float32]
NAME = "server"
BITS = 10  # of the masters it plays
ASSUMED_GAMMA = 2.2  # of its projectors, whatever they have
ERROR_ARCMIN = 1.5  # rms of its alignment, for each projector, both ways together
WAVES = 3  # across a panel, of its alignment's error at most
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
    """What a server makes of dome masters for the projectors of a scene."""

    def __init__(self, scene: DomeScene, size: int) -> None:
        self.size = size
        self._lights, self._surface = scene.lights, scene.surface
        rng = np.random.default_rng([scene.seed, 77])
        self._shift = {name: _waves(light, rng) for name, light in scene.lights.items()}
        self._outputs = {name: self._output(name) for name in scene.lights}

    def frames(self, master: Image) -> dict[str, Image]:
        """Drives (H, W, 3) of the projectors for a master (N, N, 3), each in 0..1."""
        steps = np.float32(2**BITS - 1)
        played = np.rint(master * steps) / steps
        return {name: _drawn(played, output) for name, output in self._outputs.items()}

    def landing(self) -> tuple[Array, NDArray[np.bool_]]:
        """Directions (N, N, 3) where the master's pixels really land, and which do (N, N).

        Where soft edges overlap it is the mean of what the projectors do.
        """
        ideal, inside = master_directions(self.size)
        total, weight = np.zeros_like(ideal), np.zeros(inside.shape)
        for name, light in self._lights.items():
            pull, pixel = self._pull(name, ideal)
            # the shift is slow: where the pixel is believed to be, it is as good as the same
            shift = cv2.remap(  # type: ignore[call-overload]
                self._shift[name], pixel.astype(np.float32), None, cv2.INTER_LINEAR
            )
            total += pull[..., None] * normalise(ideal - shift)
            lit = light.lit.astype(np.float32)
            arrives = cv2.remap(lit, pixel.astype(np.float32), None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
            weight += pull * (arrives >= 0.5)
        lands = inside & (weight > 0)
        return normalise(np.where(lands[..., None], total, ideal)), lands

    def _output(self, name: str) -> _Output:
        believed = normalise(self._lights[name].direction + self._shift[name])
        pulls = {other: self._pull(other, believed)[0] for other in self._lights}
        share = pulls[name] / np.maximum(np.sum(list(pulls.values()), axis=0), 1e-9)
        encoded = share ** (1 / ASSUMED_GAMMA)
        return _Output(
            master_pixels(believed, self.size).astype(np.float32),
            encoded.astype(np.float32)[..., None],
        )

    def _pull(self, name: str, direction: Array) -> tuple[Array, Array]:
        """How far inside the panel (H, W) of a projector directions (H, W, 3) are, and where."""
        build = self._lights[name].build
        point = self._surface.radius(direction)[..., None] * direction
        pixel = project(build.projector_from_dome.apply(point), build.lens)
        size = np.array(build.size)
        near = np.minimum(pixel + 0.5, size - 0.5 - pixel).min(axis=-1)
        return np.clip(np.nan_to_num(near, nan=0.0), 0, None) / size.max(), pixel


class SimulatedServer:
    """The picture input of a media server; its projectors are the scene's."""

    def __init__(self, scene: DomeScene, server: MediaServer) -> None:
        self._scene, self._server = scene, server
        self.name = NAME
        self.size = (server.size, server.size)

    def show(self, drive: NDArray[np.float32]) -> Shown:
        """Show a dome master `drive` (N, N, 3) in 0..1."""
        width, height = self.size
        if drive.shape != (height, width, 3):
            raise ShapeError("master of the server", drive.shape, f"{(height, width, 3)}")
        low, high = float(drive.min()), float(drive.max())
        if not (low >= 0 and high <= 1):
            raise UnitError(f"master of the server: got {low:.3g}..{high:.3g}, expected 0..1")
        for name, frame in self._server.frames(drive).items():
            self._scene.show(name, frame)
        self._scene.clock.sleep(SETTLE_S)
        return Shown(drive, self._scene.clock.now_s())


def put_behind(scene: DomeScene) -> ProjectorState:
    """One lamp switch and shutter for all projectors of a scene, as a server's relay has."""
    state = ProjectorState(scene.clock)
    scene.states = dict.fromkeys(scene.states, state)
    return state


def by_projector(server: MediaServer | None, drives: Mapping[str, Image]) -> Mapping[str, Image]:
    """What the projectors of a scene are sent for drives by device name."""
    return drives if server is None else server.frames(drives[NAME])


def _drawn(master: Image, output: _Output) -> Image:
    seen = cv2.remap(master, output.where, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    return np.asarray(np.clip(seen * output.encoded, 0, 1), np.float32)


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


def server_maps(server: MediaServer, white: Image) -> dict[str, NDArray[Any]]:
    """Truth of a master's pixels, channels of the calibration format by name.

    `white` (M, M, 3): direct radiance of full white on a dome master.
    """
    direction, lands = server.landing()
    valid = lands.astype(np.float32)
    at = master_pixels(direction, white.shape[0]).astype(np.float32)
    gain = cv2.remap(white, at, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    maps: dict[str, NDArray[Any]] = {
        f"direction.{axis}": direction[..., i] for i, axis in enumerate("xyz")
    }
    maps |= {
        "solid_angle": master_solid_angles(server.size),
        "sigma_arcmin": np.zeros_like(valid),
        "valid": valid,
        "measured": valid,
        "blend": valid,
    }
    return maps | {f"gain.{c}": gain[..., i] * valid for i, c in enumerate("RGB")}


def server_entry(server: MediaServer) -> dict[str, Any]:
    """What calibration.json says of the server: an equidistant fisheye at the centre."""
    middle = (server.size - 1) / 2
    return {
        "size": [server.size, server.size],
        "lens": {
            "kind": "kannala-brandt",
            "focal": [server.size / np.pi] * 2,
            "centre": [middle] * 2,
            "distortion": [0.0] * 4,
        },
        "projector_from_dome": {
            "rotation": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            "translation": [0.0] * 3,
        },
    }
