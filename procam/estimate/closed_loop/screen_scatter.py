"""Light that the cells of a canvas scatter at each other, on a dome and in a room."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.estimate.closed_loop.scatter import PatchScatter, Scatter
from procam.maths.light.scatter_kernel import basis
from procam.maths.mesh.bounces import settled_by
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
    albedo: Array

    @classmethod
    def of_maps(cls, screen: RoomScreen, maps: ScreenMaps, size: int) -> "RoomCells":
        """Those of a calibration's maps."""
        raster = screen.canvas.raster(size)
        paint = sample(maps.albedo, pixel_places(raster.face.shape, maps.coverage.shape))
        return cls(screen, size, paint, screen.face_albedo(raster.mean(paint)))

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
        raster = self.screen.canvas.raster(self.size)
        picture = np.zeros((*raster.face.shape, 3), np.float32)

        def direct(irradiance: Array) -> Array:
            picture[raster.lit] = sent(self._scattered(irradiance))
            return raster.mean(picture)

        return self._scattered(settled_by(self.screen.factors, self.albedo, direct, TOLERANCE))

    def _scattered(self, irradiance: Array) -> Array:
        """Light (n, 3) that cells scatter."""
        raster = self.screen.canvas.raster(self.size)
        return np.asarray((raster.field(irradiance) * self.paint)[raster.lit], float)
