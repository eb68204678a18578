"""The canvas of a mesh: the face that each pixel of a picture lies on, and fields of faces at pixels.

A field that is known by its mean over faces is made continuous by recovery: at each corner of a face a
linear function is fitted to the faces around it in the same part (Zienkiewicz and Zhu 1992,
doi:10.1002/nme.1620330702), so that it is right up to the edges of walls, where a mean of the neighbours
would be half a face off. Between corners it is linear.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from procam.arrays import Array, Array32, BoolArray, FloatArray, Image, IndexArray
from procam.errors import InputError
from procam.maths.mesh.facets import Faces, face_areas

AROUND = 6
CHUNK = 1 << 22  # pixels of triangles' boxes at a time
BAND = 256  # rows at a time, to save memory


@dataclass(frozen=True, slots=True)
class MeshCanvas:
    """A canvas of some size in pixels, as far as a mesh's lit faces cover it.

    Attributes
    ----------
    face : (H, W) face of each pixel, -1 for none. corners : (F, 3) vertices of all faces.
    share : (H, W, 3) barycentric weights of a face's corners. area : (H, W) of the pixel on the screen [m^2].
    recovery : (V, F) sparse: values at vertices from means over faces.
    small : lit faces that no pixel's centre lies in, and the flat place of the pixel nearest to each.
    """

    face: IndexArray
    corners: IndexArray
    share: Array32
    area: Array32
    recovery: csr_array
    small: tuple[IndexArray, IndexArray]

    @property
    def lit(self) -> BoolArray:
        """(H, W) pixels on the screen."""
        return np.asarray(self.face >= 0)

    def mean(self, picture: Image) -> Array:
        """Means (F, C) over the faces of a picture (H, W, C); 0 of faces that are not lit."""
        on = self.lit
        index, weight = self.face[on], self.area[on].astype(float)
        count = self.recovery.shape[1]
        total = np.maximum(np.bincount(index, weight, count), 1e-30)
        sums = [np.bincount(index, weight * c, count) for c in np.moveaxis(picture[on], -1, 0)]
        means = np.stack([s / total for s in sums], axis=1)
        faces, near = self.small
        means[faces] = picture.reshape(-1, picture.shape[-1])[near]
        return means

    def field(self, means: FloatArray) -> Image:
        """The picture (H, W, C) of a smooth field with these means (F, C) over faces; 0 off the screen."""
        values = (self.recovery @ means).astype(np.float32)
        picture = np.zeros((*self.face.shape, means.shape[-1]), np.float32)
        for top in range(0, len(picture), BAND):
            rows = slice(top, top + BAND)
            on = self.face[rows] >= 0
            corners, share = self.corners[self.face[rows][on]], self.share[rows][on]
            picture[rows][on] = sum(share[:, k, None] * values[corners[:, k]] for k in range(3))
        return picture


def mesh_canvas(
    vertices: Array,
    faces: Faces,
    part: IndexArray,
    place: Array,
    size: tuple[int, int],
) -> MeshCanvas:
    """The canvas of (width, height) pixels.

    Parameters
    ----------
    vertices : (V, 3) [m]. faces : (F, 3). part : (F,) number of each face's part.
    place : (V, 2) position on the canvas, 0..1 from its upper left corner to its lower right; NaN of faces
        that are not lit.

    Raises
    ------
    InputError
        If no face has a place.
    """
    corner = place[faces] * np.array(size) - 0.5
    lit = np.flatnonzero(np.isfinite(corner).all(axis=(1, 2)))
    if not len(lit):
        raise InputError("canvas: no face has a place on it; name parts that projectors light")
    face = np.full(size[::-1], -1)
    _rasterise(face, corner, lit)
    on = face >= 0
    rows, columns = np.nonzero(on)
    share = np.zeros((*face.shape, 3), np.float32)
    share[on] = barycentric(corner[face[on]], np.stack([columns, rows], axis=1).astype(float))
    area, on_canvas = face_areas(vertices, faces), np.abs(_twice_area(corner)) / 2
    pixel = np.zeros(face.shape, np.float32)
    pixel[on] = (area / on_canvas)[face[on]]
    corners, recovery = np.asarray(faces, np.intp), recovery_of(vertices, faces, part, lit)
    return MeshCanvas(face, corners, share, pixel, recovery, _small(face, corner, lit))


def _rasterise(face: IndexArray, corner: Array, lit: IndexArray) -> None:
    """Write into `face` (H, W) the triangle that each pixel's centre lies in; boxes of like size together."""
    height, width = face.shape
    low = np.clip(np.ceil(corner[lit].min(axis=1)), 0, [width, height]).astype(int)
    high = np.clip(np.floor(corner[lit].max(axis=1)) + 1, 0, [width, height]).astype(int)
    extent = np.maximum(high - low, 0)
    order = np.lexsort(extent.T)
    at = 0
    while at < len(order):
        last = at + max(1, CHUNK // max(1, int(extent[order[at:]].max(axis=0).prod())))
        some = order[at:last]
        _write(face, corner, lit[some], low[some], high[some])
        at = last


def _write(face: IndexArray, corner: Array, index: IndexArray, low: Array, high: Array) -> None:
    across, down = (high - low).max(axis=0)
    x = low[:, None, None, 0] + np.arange(across)
    y = low[:, None, None, 1] + np.arange(down)[:, None]
    x, y = np.broadcast_arrays(x, y)
    inside = (x < high[:, None, None, 0]) & (y < high[:, None, None, 1])
    which = np.broadcast_to(np.arange(len(index))[:, None, None], x.shape)[inside]
    at = np.stack([x[inside], y[inside]], axis=1)
    share = barycentric(corner[index[which]], at.astype(float))
    within = share.min(axis=1) >= -1e-6
    column, row = at[within].T
    face[row, column] = index[which[within]]


def barycentric(corner: Array, at: Array) -> Array:
    """Weights (N, 3) of corners (N, 3, 2) at points (N, 2)."""
    a, b, c = np.moveaxis(corner - at[:, None], 1, 0)
    parts = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    return np.asarray(parts / parts.sum(axis=1, keepdims=True))


def _twice_area(corner: Array) -> Array:
    a, b, c = np.moveaxis(corner, 1, 0)
    return _cross(b - a, c - a)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _small(face: IndexArray, corner: Array, lit: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Lit faces that no pixel's centre lies in, and the flat place of the pixel nearest to each."""
    faces = np.setdiff1d(lit, face)
    rows, columns = face.shape
    near = np.clip(np.rint(corner[faces].mean(axis=1)), 0, [columns - 1, rows - 1]).astype(np.intp)
    return faces, near[:, 1] * columns + near[:, 0]


def recovery_of(vertices: Array, faces: Faces, part: IndexArray, lit: IndexArray) -> csr_array:
    """Values at the vertices of lit parts from means over their faces; no vertex is in two parts."""
    rows, columns, weights = [], [], []
    middle = vertices[faces].mean(axis=1)
    for number in np.unique(part[lit]):
        own = lit[part[lit] == number]
        corners = np.unique(faces[own])
        count = min(AROUND, len(own))
        _, near = cKDTree(middle[own]).query(vertices[corners], k=np.arange(1, count + 1))
        rows.append(np.repeat(corners, count))
        columns.append(own[near].ravel())
        weights.append(_linear_weights(middle[own][near] - vertices[corners][:, None]).ravel())
    shape = (len(vertices), len(faces))
    parts = (np.concatenate(each) for each in (weights, rows, columns))
    weight, row, column = parts
    return csr_array(coo_array((weight, (row, column)), shape=shape))


def _linear_weights(offset: Array) -> Array:
    """Weights (V, K) of values at offsets (V, K, 3) whose sum is the fitted linear function at 0.

    Fitted within the plane of the offsets: the direction in which they hardly differ is left out.
    """
    scale = np.sqrt(np.mean(np.sum(offset**2, axis=2), axis=1))[:, None, None]
    terms = np.concatenate([np.ones((*offset.shape[:2], 1)), offset / scale], axis=2)
    return np.asarray(np.linalg.pinv(terms, rcond=0.1)[:, 0])
