"""The camera of the closed loop: photographs of what is on the screen, as light per cell."""

from collections.abc import Mapping, Sequence

import numpy as np

from procam.arrays import Array, Image
from procam.errors import OutOfModelRange
from procam.estimate.camera.exposure import green
from procam.estimate.camera.noise import NO_NOISE, noise_from_repeat
from procam.estimate.closed_loop.brackets import bracket_for, merged_frame
from procam.estimate.closed_loop.patches import MIN_PHOTOGRAPHS
from procam.estimate.closed_loop.picture_loop import LoopCells
from procam.model.frame import Frame
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import Photographer, Wanted

FILL = 0.7  # of full scale, for the brightest content
# of white: what the room's light may change by, where a loop finds 0.1 % of white
ROOM_CHANGE = 0.002


class LoopCamera:
    """Photographs sets of projector frames and gives content light per cell."""

    def __init__(self, photographer: Photographer, camera: MainCamera) -> None:
        self._photographer, self._camera = photographer, camera
        self._sensor = camera.radiometer.camera.sensor
        self.cells = LoopCells.of(camera.canvas, camera.view.direction, camera.view.on_screen)
        self._exposures_s: tuple[float, ...] = (0.1,)
        self._noise = NO_NOISE
        self._dark = np.zeros(3)
        self._shown: Mapping[str, Image] = {}
        self.shots = 0

    def expose_for(self, observed: Image) -> None:
        """Choose the shutter time so that the brightest of `observed` fills the sensor well."""
        self._exposures_s = (self._exposure_for(observed),)

    def plan(self, pictures: Sequence[tuple[Mapping[str, Image], Image, int]]) -> None:
        """Say what will be photographed next: frames of all projectors, what is observed, how often."""
        self._photographer.plan(
            [
                Wanted(frames, self._exposure_for(observed))
                for frames, observed, count in pictures
                for _ in range(count)
            ]
        )

    def _exposure_for(self, observed: Image) -> float:
        light = observed.reshape(-1, 3) @ np.linalg.inv(self._camera.content_matrix).T
        return FILL / float(np.percentile(light, 99.9))

    def hold(self, light: Array, sigma: Array) -> bool:
        """Take brackets from now on if one exposure cannot hold cells of `light` (n,); whether so.

        `sigma` (n,) is the standard error that one exposure has shown.
        """
        self._exposures_s = bracket_for(light, sigma, self._exposures_s[0])
        if len(self._exposures_s) == 1:
            return False
        exposure_s = self._exposures_s[0]
        self._photographer.plan([Wanted(self._shown, exposure_s)] * 2)
        pair = [green(self._capture(exposure_s).counts) for _ in range(2)]
        self._noise = noise_from_repeat(pair[0], pair[1], self._sensor)
        return True

    def measure_dark(self) -> None:
        """Photograph the room's own light, with projectors dark; later photographs are without it."""
        self._shown = {}
        self._dark = np.mean(self.photographs(MIN_PHOTOGRAPHS), axis=0)

    def check_dark(self) -> None:
        """Refuse what was photographed if the room's light has changed; projectors are dark after it.

        Raises
        ------
        OutOfModelRange
            It has.
        """
        self._shown = {}
        change = np.average(self.photographs(1)[0], axis=(0, 1), weights=self.cells.count)
        worst = float(np.abs(change).max())
        if worst > ROOM_CHANGE:
            raise OutOfModelRange(
                f"the light in the room changed by {worst:.1%} of white during the loop, more than "
                f"{ROOM_CHANGE:.1%}; keep lamps and doors as they are, and refine again"
            )

    def show(self, frames: Mapping[str, Image]) -> None:
        """Put a frame on every projector."""
        self._shown = frames

    def photographs(self, count: int) -> list[Array]:
        """Cell means (N, N, 3) of what is on the screen [rel], `count` times."""
        self._photographer.plan([Wanted(self._shown, e) for e in self._exposures_s] * count)
        return [self._photograph() for _ in range(count)]

    def _photograph(self) -> Array:
        frames = [self._capture(exposure_s) for exposure_s in self._exposures_s]
        frame = frames[0] if len(frames) == 1 else merged_frame(frames, self._sensor, self._noise)
        light = self._camera.radiometer.radiance(frame)
        lost = float(np.isnan(light[self.cells.use]).any(axis=-1).mean())
        if lost > 0.01:
            raise OutOfModelRange(
                f"loop photograph at {frame.settings.exposure_s:.3g} s: {lost:.1%} of the screen is "
                "saturated, more than 1%; is room light on, or another projector?"
            )
        return self.cells.average(self._camera.content(np.nan_to_num(light))) - self._dark

    def _capture(self, exposure_s: float) -> Frame:
        self.shots += 1
        return self._photographer.take(Wanted(self._shown, exposure_s))
