"""Photographs of one projector's pictures without a rig, a clock or files, for studies and tests.

They come from the same scene and sensor as those of `devices.SimulatedCamera`. Rendering and digitising
are separate steps, so that one render can be given noise many times.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Image
from procam.errors import ShapeError, UnitError
from simulators.presets import white_exposure_s
from simulators.scene import GREEN, DomeScene
from simulators.sensor import Sensor


class PhotographBench:
    """One projector of a scene before one camera; all other projectors are shuttered.

    Parameters
    ----------
    scene : a scene, as of `backend.build_scene` or `DomeScene.altered`.
    projector : its projector that shows the pictures.
    camera : its camera; None for the first. It takes the green band (mono) and does not drift.
    exposure_s : exposure time [s]; None for the one that keeps white just below saturation.
    """

    def __init__(
        self,
        scene: DomeScene,
        projector: str,
        camera: str | None = None,
        exposure_s: float | None = None,
    ) -> None:
        camera = camera or next(iter(scene.cameras))
        self.scene, self.projector, self.camera = scene, projector, camera
        self.exposure_s = exposure_s or white_exposure_s(scene.preset)
        self._light, self._lines = scene.lights[projector], scene.sight_lines(camera)
        self._sensor = Sensor(scene, camera)

    def photograph(self, pictures: Iterable[NDArray[np.uint8]]) -> Iterator[Image]:
        """Signals (H, W) of grey 8-bit pictures (H, W, 1), one by one [share of full scale].

        Without noise, black level, saturation and rounding.
        """
        shape = (*self._light.lit.shape, 1)
        for picture in pictures:
            if picture.shape != shape:
                what = f"picture of projector {self.projector}"
                raise ShapeError(what, picture.shape, f"{shape}")
            if picture.dtype != np.uint8:
                raise UnitError(
                    f"picture of projector {self.projector} has {picture.dtype}; it needs uint8"
                )
            irradiance = {self.projector: self._light.emit_grey(picture, GREEN)}
            radiance = self.scene.radiance_of_irradiances(
                self._lines, irradiance, 1, self._sensor.blur_px
            )
            yield self._sensor.signal(radiance, self.exposure_s)[..., 0]

    def digitise(
        self, signal: Image, rng: np.random.Generator, snr: float | None = None
    ) -> NDArray[np.uint16]:
        """Counts (H, W) [DN] of a signal (H, W), which is not changed.

        `snr` is that of the darkest lit pixel (`presets.Overrides`) at this bench's exposure; None
        for the noise of the scene's own camera. `rng` needs a bit generator of 64 raw bits: any
        of NumPy's but MT19937.
        """
        sensor = self._sensor
        noise = sensor.noise if snr is None else sensor.noise_of_snr(snr, self.exposure_s)
        return sensor.digitise(signal, rng, noise)

    def projector_pixels(self) -> Image:
        """The truth: projector pixel (H, W, 2) under each camera pixel's centre.

        NaN where the projector's picture does not fall, also behind the blackout plates. Accurate to
        1e-4 px (float32).
        """
        return self._lines.projector_pixels(self.projector, self._light.lit)
