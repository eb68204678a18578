"""Light that the cells of a canvas scatter at each other, on a dome and in a room."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from procam.arrays import Array, Array32, BoolArray, Image
from procam.estimate.closed_loop.scatter import PatchScatter, Scatter
from procam.maths.fixed_point import fixed_point
from procam.maths.light.scatter_kernel import basis
from procam.maths.warp import pixel_places, sample
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen
from procam.model.transport import ScreenMaps

TOLERANCE = 1e-4  # of the brightest irradiance


def scatter_of(calibration: Calibration, size: int) -> Scatter:
    """The scattered light of cells inside a canvas of some width, in reading order."""
    if isinstance(calibration.screen, RoomScreen):
        return RoomCells.of_maps(calibration.screen, calibration.maps, size)
    maps, canvas, kernel = calibration.maps, calibration.screen.canvas, calibration.maps.kernel
    direction, inside = canvas.directions(size)
    scatter = sample(maps.scatter_per_flux, pixel_places(inside.shape, maps.coverage.shape))[inside]
    phi = basis(direction[inside], kernel.degree)
    spread = [
        (scatter[:, c] / (phi @ kernel.profile[c]))[:, None] * (phi @ kernel.matrix[c])
        for c in range(3)
    ]
    return PatchScatter(np.stack(spread), canvas.weights(size)[inside][:, None] * phi)


@dataclass(frozen=True, eq=False)
class RoomCells:
    """Scattered light on the canvas of a room, by its form factors.

    Attributes
    ----------
    screen, size : the room, and the width of the canvas. paint : (H, W, 3) albedo of the cells.
    albedo : (F, 3) of the faces.
    """

    screen: RoomScreen
    size: int
    paint: Image
    albedo: Array32

    @classmethod
    def of_maps(cls, screen: RoomScreen, maps: ScreenMaps, size: int) -> "RoomCells":
        """Those of a calibration's maps."""
        raster = screen.canvas.raster(size)
        paint = sample(maps.albedo, pixel_places(raster.face.shape, maps.coverage.shape))
        return cls(screen, size, paint, screen.face_albedo(raster.mean(paint)).astype(np.float32))

    def of(self, direct: Array) -> Array:
        """See `Scatter`."""
        return self._settled(lambda _: direct)

    def removed(self, change: Array, free: BoolArray, factor: Array) -> Array:
        """See `Scatter`."""

        def sent(scattered: Array) -> Array:
            return np.where(free, change - factor * scattered, 0.0)

        return sent(self._settled(sent))

    def limited(self, change: Array, down: Array, up: Array, factor: Array) -> Array:
        """See `Scatter`."""

        def sent(scattered: Array) -> Array:
            return np.clip(change - factor * scattered, -down, up)

        return sent(self._settled(sent))

    def _settled(self, sent: Callable[[Array], Array]) -> Array:
        """Scattered light (n, 3) of direct light that is sent where it is known."""
        nothing = np.zeros(self.albedo.shape, np.float32)
        return self._scattered(fixed_point(partial(self._step, sent), nothing, TOLERANCE))

    def _step(self, sent: Callable[[Array], Array], irradiance: Array32) -> Array32:
        """The irradiance (F, 3) of faces after one more bounce."""
        raster = self.screen.canvas.raster(self.size)
        picture = np.zeros((*raster.face.shape, 3), np.float32)
        picture[raster.lit] = sent(self._scattered(irradiance))
        return self.screen.factors.gather(raster.mean(picture) + self.albedo * irradiance)

    def _scattered(self, irradiance: Array32) -> Array:
        """Light (n, 3) that cells scatter."""
        raster = self.screen.canvas.raster(self.size)
        return np.asarray((raster.field(irradiance) * self.paint)[raster.lit], float)
