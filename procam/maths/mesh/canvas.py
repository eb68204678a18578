"""The canvas of a mesh: the face that each pixel of a picture lies on, and fields of faces at pixels.

A field that is known by its mean over faces is made continuous by recovery: at each corner of a face a
linear function is fitted to the faces around it in the same part (Zienkiewicz and Zhu 1992,
doi:10.1002/nme.1620330702), so that it is right up to the edges of walls, where a mean of the neighbours
would be half a face off. Between corners it is linear.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.spatial import cKDTree

from procam.arrays import Array, Array32, BoolArray, FloatArray, Image, IndexArray
from procam.errors import InputError
from procam.maths.mesh.facets import Faces, face_areas

AROUND = 6
CHUNK = 1 << 22  # pixels of triangles' boxes at a time
SQUARE = 512  # pixels of a canvas on which overlaps are found


@dataclass(frozen=True, slots=True)
class MeshCanvas:
    """A canvas of some size in pixels, as far as a mesh's lit faces cover it.

    Attributes
    ----------
    face : (H, W) face of each pixel, -1 for none. area : (H, W) of the pixel on the screen [m^2].
    recovery : (V, F) sparse: values at vertices from means over faces.
    at_pixels : (H W, V) sparse: values at pixels from those at vertices.
    over_faces : (F, H W) sparse: means over faces of values at pixels.
    small : lit faces that no pixel's centre lies in, and the flat place of the pixel nearest to each.
    """

    face: IndexArray
    area: Array32
    recovery: csr_array
    at_pixels: csr_array
    over_faces: csc_array
    small: tuple[IndexArray, IndexArray]

    @classmethod
    def of(
        cls,
        seen: tuple[IndexArray, FloatArray],
        area: Array32,
        corners: IndexArray,
        recovery: csr_array,
        small: tuple[IndexArray, IndexArray],
    ) -> "MeshCanvas":
        """The canvas whose pixels see faces (H, W) at weights (K, 3) of their corners, in reading order.

        `corners` (F, 3) are vertices of all faces.
        """
        face, share = seen
        on, (vertices, faces) = face >= 0, recovery.shape
        index, weight = face[on], area[on]
        ends = np.concatenate([[0], np.cumsum(on.ravel(), dtype=np.int32)]).astype(np.int32)
        total = np.maximum(np.bincount(index, weight, faces), 1e-30)
        mean = (weight / total[index]).astype(np.float32)
        at_pixels = csr_array(
            (share.astype(np.float32).ravel(), corners[index].astype(np.int32).ravel(), 3 * ends),
            shape=(face.size, vertices),
        )
        over = csc_array((mean, index.astype(np.int32), ends), shape=(faces, face.size))
        return cls(face, area, recovery, at_pixels, over, small)

    @property
    def lit(self) -> BoolArray:
        """(H, W) pixels on the screen."""
        return np.asarray(self.face >= 0)

    def mean(self, picture: Image) -> Array:
        """Means (F, C) over the faces of a picture (H, W, C); 0 of faces that are not lit."""
        flat = picture.reshape(-1, picture.shape[-1])
        means = (self.over_faces @ flat).astype(float)
        faces, near = self.small
        means[faces] = flat[near]
        return np.asarray(means)

    def field(self, means: FloatArray) -> Image:
        """The picture (H, W, C) of a smooth field with these means (F, C) over faces; 0 off the screen."""
        picture = self.at_pixels @ (self.recovery @ means).astype(np.float32)
        return np.asarray(picture.reshape(*self.face.shape, -1))


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
    face, weights = np.full(size[::-1], -1), np.zeros((*size[::-1], 3), np.float32)
    _rasterise(face, weights, corner, lit)
    on = face >= 0
    area, on_canvas = face_areas(vertices, faces), np.abs(_twice_area(corner)) / 2
    pixel = np.zeros(face.shape, np.float32)
    pixel[on] = (area / on_canvas)[face[on]]
    recovery, corners = recovery_of(vertices, faces, part, lit), np.asarray(faces, np.intp)
    return MeshCanvas.of((face, weights[on]), pixel, corners, recovery, _small(face, corner, lit))


def rasterised_share(place: Array, faces: Faces) -> float:
    """The share of the area of faces with a place (V, 2), 0..1, that no other covers on the canvas."""
    corner = place[faces] * SQUARE - 0.5
    lit = np.flatnonzero(np.isfinite(corner).all(axis=(1, 2)))
    face, weights = np.full((SQUARE, SQUARE), -1), np.zeros((SQUARE, SQUARE, 3), np.float32)
    _rasterise(face, weights, corner, lit)
    return float((face >= 0).sum() / (np.abs(_twice_area(corner[lit])).sum() / 2))


def _rasterise(face: IndexArray, weights: Array32, corner: Array, lit: IndexArray) -> None:
    """Write the triangle (H, W) that each pixel's centre lies in, and weights (H, W, 3) of its corners.

    Boxes of like size are written together.
    """
    height, width = face.shape
    low = np.clip(np.ceil(corner[lit].min(axis=1)), 0, [width, height]).astype(int)
    high = np.clip(np.floor(corner[lit].max(axis=1)) + 1, 0, [width, height]).astype(int)
    extent = np.maximum(high - low, 0)
    order = np.lexsort(extent.T)
    at = 0
    while at < len(order):
        last = at + max(1, CHUNK // max(1, int(extent[order[at:]].max(axis=0).prod())))
        some = order[at:last]
        _write((face, weights), corner, lit[some], low[some], high[some])
        at = last


def _write(
    out: tuple[IndexArray, Array32], corner: Array, index: IndexArray, low: Array, high: Array
) -> None:
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
    out[0][row, column], out[1][row, column] = index[which[within]], share[within]


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
