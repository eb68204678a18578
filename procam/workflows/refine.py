"""Closed loop: show the compensated picture, photograph it, compare with the prediction, refine."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.compensate.exact import Compensated, Compensator
from procam.compensate.projector_frames import projector_frames
from procam.devices.rig import Rig
from procam.errors import OutOfModelRange
from procam.estimate.feedback import LOOP_SIZE, Cells, Loop
from procam.estimate.radiance import Radiometer
from procam.estimate.view import DomeView
from procam.maths.sphere import master_pixels
from procam.maths.warp import sample
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.frame import CameraSettings
from procam.model.quality import Figure, Goal
from procam.model.transport import DomeMaps
from procam.workflows.events import Event

Array = NDArray[np.float64]
Image = NDArray[np.float32]
MAX_ITERATIONS = 4
NOISE_SHOTS = 4
CLOSE_ENOUGH = 1.1  # times the noise floor: the goal
STOP = 1.06  # well inside it, so that no lucky photograph ends the loop
FILL = 0.7  # of full scale, for the brightest content


@dataclass(frozen=True, slots=True)
class Refined:
    """Outcome of a loop.

    Attributes
    ----------
    calibration : with gains corrected by what was seen. frames : the refined picture's, by projector.
    residual : after calibration and after each iteration [rel]. noise_floor : [rel].
    photographs : (LOOP_SIZE, LOOP_SIZE, 3) cell means by name: "before" (uncompensated), "after".
    target : (LOOP_SIZE, LOOP_SIZE, 3) what was predicted. free : cells that no limit holds.
    shots : photographs taken.
    """

    calibration: Calibration
    frames: Mapping[str, Image]
    residual: list[float]
    noise_floor: float
    photographs: Mapping[str, Array]
    target: Array
    free: NDArray[np.bool_]
    shots: int

    def figures(self) -> dict[str, Figure]:
        """The loop's figures by the names of summary.json."""
        figures = {
            "loop_residual_by_iteration": Figure(self.residual, "rel", None, int(self.free.sum())),
            "loop_noise_floor": Figure(self.noise_floor, "rel", None, NOISE_SHOTS),
            "loop_iterations": Figure(len(self.residual) - 1, "-", Goal("<=", MAX_ITERATIONS)),
        }
        if self.noise_floor > 0:  # a simulated camera may be free of noise
            over = self.residual[-1] / self.noise_floor
            goal = Goal("<=", CLOSE_ENOUGH)
            figures["loop_residual_over_floor"] = Figure(over, "-", goal, int(self.free.sum()))
        return figures


class LoopCamera:
    """Photographs sets of projector frames and gives content light per cell."""

    def __init__(self, rig: Rig, calibration: Calibration) -> None:
        self.rig, self.calibration = rig, calibration
        name, model = next(iter(calibration.cameras.items()))
        self._camera, self._radiometer = rig.cameras[name], Radiometer(model)
        dome = calibration.screen
        view = DomeView.of(model, dome, self._radiometer.rays, self._radiometer.seen)
        self.cells = Cells.of(view.direction, view.on_screen)
        self._matrix = calibration.content_from_camera.astype(np.float32)
        self._exposure_s = 0.1
        self.shots = 0

    def expose_for(self, observed: Image) -> None:
        """Choose the shutter time so that the brightest of `observed` fills the sensor well."""
        light = observed.reshape(-1, 3) @ np.linalg.inv(self._matrix).T
        self._exposure_s = FILL / float(np.percentile(light, 99.9))

    def show(self, frames: Mapping[str, Image]) -> None:
        """Put a frame on every projector."""
        for name, frame in frames.items():
            self.rig.projectors[name].show(frame)

    def photograph(self) -> Array:
        """Cell means (N, N, 3) of what is on the dome [rel]."""
        settings = self._camera.configure(CameraSettings(self._exposure_s, "rgb"))
        frame = self._camera.capture()
        self.shots += 1
        light = self._radiometer.radiance(frame)
        lost = float(np.isnan(light[self.cells.use]).any(axis=-1).mean())
        if lost > 0.01:
            raise OutOfModelRange(
                f"loop photograph at {settings.exposure_s:.3g} s: {lost:.1%} of the dome is "
                "saturated, expected less than 1%; is room light on, or another projector?"
            )
        return self.cells.average(np.nan_to_num(light) @ self._matrix.T)


def refine(rig: Rig, calibration: Calibration, content: Image) -> Iterator[Event]:
    """Refine on `content` (N, N, 3); the last event carries `data["refined"]`, a `Refined`."""
    total = MAX_ITERATIONS + 3
    plain = Compensator(calibration, content.shape[0], "none").solve(content)
    wanted = Compensator(calibration, content.shape[0]).solve(content)
    camera = LoopCamera(rig, calibration)
    for name in rig.projectors:
        rig.light(name)
    camera.expose_for(plain.observed)
    before = _shot(camera, plain.direct, calibration)
    yield Event("refine", 1, total, "uncompensated picture photographed")
    camera.expose_for(wanted.observed)
    predicted = camera.cells.average_master(wanted.observed)
    loop = Loop(calibration, camera.cells, wanted.free)
    seen = _shot(camera, wanted.direct, calibration)
    shots = [seen, *(camera.photograph() for _ in range(NOISE_SHOTS - 1))]
    floor = _noise_floor(loop, shots)
    residual = [loop.residual_rms(predicted - seen)]
    yield Event("refine", 2, total, f"residual {residual[0]:.3%} of white, noise {floor:.3%}")
    while residual[-1] > STOP * floor and loop.steps < MAX_ITERATIONS:
        loop.update(predicted - np.mean(shots, axis=0), len(shots))
        seen = _shot(camera, loop.corrected(wanted.direct), calibration)
        shots = [seen, camera.photograph()]
        residual.append(loop.residual_rms(predicted - seen))
        yield Event("refine", 2 + loop.steps, total, f"residual {residual[-1]:.3%} of white")
    refined = _finish(calibration, camera, loop, wanted, residual, floor, before, seen, predicted)
    yield Event("refine", total, total, "loop ended", {"refined": refined})


def _shot(camera: LoopCamera, direct: Image, calibration: Calibration) -> Array:
    camera.show(projector_frames(direct, calibration))
    return camera.photograph()


def _noise_floor(loop: Loop, shots: list[Array]) -> float:
    """Scatter of single photographs of one picture, from repeated ones [rel]."""
    spread = np.stack(shots).std(axis=0, ddof=1)
    return float(np.sqrt(np.mean(spread[loop.free] ** 2)))


def _finish(  # noqa: PLR0913, PLR0917
    calibration: Calibration,
    camera: LoopCamera,
    loop: Loop,
    wanted: Compensated,
    residual: list[float],
    floor: float,
    before: Array,
    after: Array,
    predicted: Array,
) -> Refined:
    factor = loop.gain_factor(wanted.direct, camera.cells)
    maps = calibration.maps
    projectors = {name: _regained(p, factor, maps) for name, p in calibration.projectors.items()}
    better = replace(calibration, projectors=projectors)
    return Refined(
        better,
        projector_frames(loop.corrected(wanted.direct), calibration),
        residual,
        floor,
        {"before": before, "after": after},
        predicted,
        loop.free,
        camera.shots,
    )


def _regained(
    projector: ProjectorCalibration, factor: Array, maps: DomeMaps
) -> ProjectorCalibration:
    direction = np.nan_to_num(projector.surface.direction)
    at = sample(factor, master_pixels(direction, LOOP_SIZE), outside=1.0)
    at[maps.is_protected(master_pixels(direction, maps.size))] = 1.0
    photometry = replace(projector.photometry, gain=projector.photometry.gain * at)
    return replace(projector, photometry=photometry)
