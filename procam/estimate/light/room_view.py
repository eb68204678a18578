"""A room as the main camera sees it: light of its faces, and what of it arrives at them again."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.estimate.geometry.camera_view import ScreenView
from procam.maths.mesh.bounces import settled
from procam.model.screen import RoomScreen

SEEN = 0.3  # of a face's area that the camera must see, for its light to be measured


class RoomView:
    """Faces (F,) of a room at the pixels (H, W) of a camera.

    Attributes
    ----------
    faces : at the pixels. known : (F,) whose light is measured. Others of lit parts count with that of the
        nearest which is, and the rest reflects by its stated albedo.
    """

    def __init__(self, screen: RoomScreen, view: ScreenView) -> None:
        self.faces = view.faces(screen)
        used = self.faces.area > 0
        area = screen.factors.area
        seen = np.bincount(self.faces.face[used], self.faces.area[used], len(area))
        self.known: BoolArray = seen > SEEN * area
        self._factors, self._stated = screen.factors, screen.stated_albedo[:, 0]
        self._room, self._like = screen.room, _nearest_known(screen, self.known)

    def parts(self) -> Iterator[BoolArray]:
        """Pixels (H, W) of each part of the room."""
        for number in range(len(self._room.names)):
            yield (self._room.part == number)[self.faces.face] & (self.faces.face >= 0)

    def mean(self, picture: Image) -> Array:
        """Light (F, C) of the faces in a picture (H, W, C); 0 where it is neither seen nor lit."""
        means = self.faces.mean(np.nan_to_num(picture)) * self.known[:, None]
        return means[self._like]

    def irradiance(self, picture: Image) -> Array:
        """E = F L (F, C), of all light L that leaves the walls in a picture (H, W, C)."""
        return self.arriving(self.mean(picture), self._stated)

    def arriving(self, light: Array, stated: Array) -> Array:
        """E (F, C) of light (F, C) of the faces; what is neither seen nor lit reflects by an albedo (F,)."""
        unseen = np.where(self.known[self._like], 0.0, stated)[:, None]
        return settled(self._factors, unseen * np.ones((1, light.shape[1])), light)

    def at_pixels(self, values: Array) -> Image:
        """The picture (H, W, C) of a smooth field with means (F, C)."""
        return self.faces.field(values)


def _nearest_known(screen: RoomScreen, known: BoolArray) -> IndexArray:
    """Face (F,) whose light each face has: its own, or of lit parts that of the nearest which is known."""
    room = screen.room
    like, middle = np.arange(len(room.faces)), room.vertices[room.faces].mean(axis=1)
    for name in screen.lit:
        own = room.part == room.names.index(name)
        seen, lost = np.flatnonzero(own & known), np.flatnonzero(own & ~known)
        if len(seen) and len(lost):
            like[lost] = seen[cKDTree(middle[seen]).query(middle[lost])[1]]
    return like
