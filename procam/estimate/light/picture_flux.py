"""How much light a picture scatters, over that of white: one number on a dome, a field in a room.

On a sphere all light reaches all places alike, so the scattered light of a picture is that of white, times
the ratio of their fluxes. In a room it is the ratio of what arrives at each place, by the form factors:
stripes of a wall light a place beside it by more, or by less, than their share of white.
"""

from collections.abc import Iterator

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.room_view import RoomView
from procam.model.screen import RoomScreen, Screen

LEAST = 1e-3  # of the brightest light that arrives, or of white: less lights nothing
TINY = 1e-9


class PictureFlux:
    """Flux of pictures on the screen, in all and over that of white (H, W, 3).

    Attributes
    ----------
    weight : (H, W) of the camera pixels [sr or m^2]; 0 off the screen, or where white is not known.
    pattern : how scattered light of white differs from place to place, up to the paint; a number where it
        does not, or (H, W, 3).
    """

    pattern: Image | float = 1.0

    def __init__(self, weight: FloatArray, white: Image) -> None:
        usable = np.isfinite(white).all(axis=-1)
        self.weight = np.where(usable, weight, 0).astype(np.float32)
        self._white = self.total(white)

    def parts(self) -> Iterator[BoolArray]:
        """Parts (H, W) of the picture, over which paint and scattered light have no edges."""
        yield np.ones(self.weight.shape, bool)

    def total(self, light: Image) -> Array:
        """Flux (C,) on the screen [radiance sr or m^2]; saturated pixels count as 0."""
        total = np.tensordot(self.weight, light, 2).astype(float)
        if not np.isfinite(total).all():
            total = np.tensordot(self.weight, np.nan_to_num(light), 2).astype(float)
        return total

    def share(self, light: Image) -> FloatArray:
        """Scattered light of a picture (H, W, 3) over that of white, (3,) or (H, W, 3).

        What leaves the screen arrives there again: both are counted with their scattered light.
        """
        return self.total(light) / self._white


class RoomFlux(PictureFlux):
    """The same in a room."""

    def __init__(self, room: RoomView, white: Image) -> None:
        super().__init__(room.faces.area, white)
        self._room, arriving = room, room.at_pixels(room.irradiance(white))
        least = LEAST * max(float(arriving.max()), float(np.nanmean(white)), TINY)
        self.pattern = np.maximum(arriving, np.float32(least))

    def parts(self) -> Iterator[BoolArray]:
        """Each wall."""
        yield from self._room.parts()

    def share(self, light: Image) -> FloatArray:
        """By the irradiance of each place."""
        arriving = self._room.at_pixels(self._room.irradiance(light))
        arriving /= self.pattern
        return np.maximum(arriving, 0, out=arriving)


def picture_flux(screen: Screen, view: ScreenView, white: Image) -> PictureFlux:
    """Flux of one projector's pictures, given its white (H, W, 3)."""
    if isinstance(screen, RoomScreen):
        return RoomFlux(RoomView(screen, view), white)
    return PictureFlux(view.weight, white)
