"""The canvas of a room: pixels of pictures, and directions of their places from its origin."""

from functools import cached_property

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, IndexArray
from procam.maths.mesh.canvas import MeshCanvas, mesh_canvas, recovery_of
from procam.maths.mesh.raycast import weights_of_corners
from procam.maths.mesh.rooms import Room
from procam.maths.mesh.shape import MeshShape

BLOCK = 1 << 18  # directions at a time, to save memory
NOWHERE = -10.0  # pixels, far enough from any that `sample` gives 0


class RoomCanvas:
    """Pictures of some width [px] on the canvas of a room, its pixels square on the screen.

    Directions are those from the room's origin.
    """

    def __init__(self, room: Room, shape: MeshShape) -> None:
        self._room, self._shape = room, shape
        self._rasters: dict[int, MeshCanvas] = {}

    def shape(self, size: int) -> tuple[int, int]:
        """Rows and columns of a picture of that width."""
        width, height = self._room.size_m
        return max(1, round(size * height / width)), size

    def raster(self, size: int) -> MeshCanvas:
        """Faces and areas of the pixels; kept, as it takes a while."""
        if size not in self._rasters:
            room, (rows, columns) = self._room, self.shape(size)
            self._rasters[size] = mesh_canvas(
                room.vertices, room.faces, room.part, self._places, (columns, rows)
            )
        return self._rasters[size]

    def directions(self, size: int) -> tuple[Array, BoolArray]:
        """Directions (H, W, 3) of the pixels, and which lie on the screen; up where they do not.

        A face that the origin does not see whole has no directions.
        """
        raster, seen = self.raster(size), self._shape.mesh.seen
        lit = raster.lit if seen is None else raster.lit & seen[raster.face]
        direction = np.broadcast_to([0.0, 0.0, 1.0], (*lit.shape, 3)).copy()
        share = raster.at_pixels.data.reshape(-1, 3)[lit[raster.lit]].astype(float)
        points = self._shape.tracer.points_on(raster.face[lit], share[:, 1], share[:, 2])
        direction[lit] = points / np.linalg.norm(points, axis=1, keepdims=True)
        return direction, lit

    def weights(self, size: int) -> Array:
        """Areas (H, W) [m^2] of the pixels, 0 off the screen."""
        return np.asarray(self.raster(size).area, float)

    def photograph(self, direction: FloatArray, area: FloatArray) -> MeshCanvas:
        """A camera's picture as a canvas of all faces, lit or not.

        `direction` (H, W, 3) is the direction of what a pixel sees, `area` (H, W) its area [m^2]; 0 off the
        screen.
        """
        face, seen = np.full(area.shape, -1), area > 0
        face[seen], share = self._met(direction[seen])
        room, every = self._room, np.arange(len(self._room.faces))
        recovery = recovery_of(room.vertices, room.faces, room.part, every)
        nothing = np.zeros(0, np.intp)
        met, known = (face, share[face[seen] >= 0]), np.where(face >= 0, area, 0)
        return MeshCanvas.of(
            met, known.astype(np.float32), room.faces, recovery, (nothing, nothing)
        )

    def pixels(self, direction: FloatArray, size: int) -> FloatArray:
        """Pixel coordinates (..., 2) as (column, row) of unit directions; `NOWHERE` off the lit parts."""
        face, share = self._met(direction)
        found = np.full((*direction.shape[:-1], 2), NOWHERE, direction.dtype)
        hit = np.isin(face, self.lit_faces)
        place = self._places[self._room.faces[face[hit]]]
        at = np.array(self.shape(size)[::-1])
        found[hit] = np.einsum("nk,nki->ni", share[hit], place) * at - 0.5
        return found

    def _met(self, direction: FloatArray) -> tuple[IndexArray, Array]:
        """Face (...) that unit directions (..., 3) meet, -1 for none, and weights (..., 3) of its corners."""
        flat = direction.reshape(-1, 3)
        face, share = np.full(len(flat), -1), np.zeros(flat.shape)
        for at in range(0, len(flat), BLOCK):
            some = slice(at, at + BLOCK)
            met = self._shape.tracer.first_hits(np.zeros(3), flat[some].astype(float))
            hit = met.faces >= 0
            corner = self._room.vertices[self._room.faces[met.faces[hit]]] / self._shape.radius_m
            face[some] = met.faces
            share[some][hit] = weights_of_corners(corner, met.points[hit])
        return face.reshape(direction.shape[:-1]), share.reshape(direction.shape)

    @cached_property
    def _places(self) -> Array:
        return np.asarray(self._room.place / np.array(self._room.size_m))

    @cached_property
    def lit_faces(self) -> IndexArray:
        """Faces that lie on the canvas."""
        return np.flatnonzero(np.isfinite(self._places[self._room.faces]).all(axis=(1, 2)))
