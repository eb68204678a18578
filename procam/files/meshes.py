"""Surfaces of meshes, as exporters write them, made fit for tracing light.

Vertices at one place are welded, faces without area or drawn twice dropped, and faces turned to the side
where the audience is; every other fault is an error. To turn the faces, each face is two nodes of a graph, as
it is and reversed, and neighbours are joined so that they agree: a surface with two sides falls into two
components, a one-sided one does not. A component then faces the origin, or outwards if it is a body that the
origin sees from all round, such as a closed seat.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import FileFormatError
from procam.maths.geometry.sphere import angles_from_direction, normalise
from procam.maths.mesh.facets import half_edges, shared_edges

WELD = 1e-6  # of the extent: vertices nearer than this are one
NO_AREA = 1e-12  # of the extent squared: faces smaller than this are none
OTHER_RIM = 0.5  # of the longest rim: how long the other end of a tube is at least
AROUND = (
    1e-6  # of a whole turn: solid angle below which a component is a closed body beside the origin
)


@dataclass(frozen=True, slots=True)
class Surface:
    """A mesh that is being checked, its origin where directions begin, and its file.

    Attributes
    ----------
    vertices : (V, 3) [m]. faces : (F, 3). part : (F,) number of each face's part.
    texture : (F, 3, 2) texture coordinates of its corners; NaN where it has none.
    """

    path: Path
    vertices: Array
    faces: IndexArray
    part: IndexArray
    texture: Array

    @property
    def extent(self) -> float:
        """Longest edge of the bounding box [m]."""
        return float(np.ptp(self.vertices, axis=0).max())

    def only(self, kept: BoolArray) -> "Surface":
        """The faces that are kept."""
        faces, part, texture = self.faces[kept], self.part[kept], self.texture[kept]
        return replace(self, faces=faces, part=part, texture=texture)

    def turned(self, wrong: BoolArray) -> "Surface":
        """With some faces reversed."""
        faces = np.where(wrong[:, None], self.faces[:, ::-1], self.faces)
        texture = np.where(wrong[:, None, None], self.texture[:, ::-1], self.texture)
        return replace(self, faces=faces, texture=texture)

    def fault(self, message: str) -> FileFormatError:
        """An error about the file."""
        return FileFormatError(f"{self.path}: {message}")


def checked(surface: Surface) -> Surface:
    """The surface, welded, turned to the audience and without empty faces.

    Raises
    ------
    FileFormatError
        If the surface is one-sided or branches, or a component has an opening besides its rim. A tube, open
        at both ends, has two rims.
    """
    surface = _facing_inside(_without_empty_faces(_welded(surface)))
    _refuse_openings(surface)
    return surface


def _welded(surface: Surface) -> Surface:
    """Vertices at one place made one: exporters split them at seams and between panels."""
    pairs = cKDTree(surface.vertices).query_pairs(WELD * surface.extent, output_type="ndarray")
    count = len(surface.vertices)
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(count, count))
    place = connected_components(graph, directed=False)[1]
    first = np.unique(place, return_index=True)[1]
    return replace(
        surface, vertices=surface.vertices[first], faces=place[surface.faces].astype(np.intp)
    )


def _without_empty_faces(surface: Surface) -> Surface:
    """The surface without faces that have no area or are drawn twice."""
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    kept = np.zeros(len(surface.faces), bool)
    kept[np.unique(np.sort(surface.faces, axis=1), axis=0, return_index=True)[1]] = True
    kept &= area > NO_AREA * surface.extent**2
    if not kept.any():
        raise surface.fault(f"all {len(kept)} faces are without area; export it again")
    return surface.only(kept)


def _facing_inside(surface: Surface) -> Surface:
    """The surface with all faces counter-clockwise as seen from where the audience is."""
    _refuse_branches(surface)
    part, reversed_ = _sides(surface)
    surface = surface.turned(reversed_)
    corner = surface.vertices[surface.faces]
    a, b, c = np.moveaxis(corner, 1, 0)
    volume = np.bincount(part, np.einsum("fi,fi->f", a, np.cross(b, c)))  # six times
    away = np.bincount(part, _solid_angles(corner))
    beside = np.abs(away) < AROUND * 4 * np.pi
    return surface.turned(np.where(beside, volume < 0, away > 0)[part])


def _solid_angles(corner: Array) -> Array:
    """Solid angles (F,) [sr] of faces (F, 3, 3) at the origin, above 0 of those that face away from it.

    Van Oosterom and Strackee 1983, doi:10.1109/TBME.1983.325207.
    """
    a, b, c = np.moveaxis(normalise(corner), 1, 0)
    dots = [np.sum(one * other, axis=1) for one, other in ((a, b), (b, c), (c, a))]
    return np.asarray(2 * np.arctan2(np.einsum("fi,fi->f", a, np.cross(b, c)), 1 + sum(dots)))


def _refuse_branches(surface: Surface) -> None:
    """A surface has no edge with three faces."""
    edges, count = np.unique(np.sort(half_edges(surface.faces), axis=1), axis=0, return_counts=True)
    branching = edges[count > 2]
    if len(branching):
        raise surface.fault(
            f"{len(branching)} edges have three faces or more, the first {_place(surface, branching[0])}; "
            "delete the faces inside or behind the surface"
        )


def _sides(surface: Surface) -> tuple[IndexArray, BoolArray]:
    """Connected part of each face, and whether it has to be reversed to agree with its part.

    Each face is two nodes, as it is and reversed, and neighbours are joined so that they agree. A part
    then falls into two mirror images, unless it has only one side.
    """
    count = len(surface.faces)
    pairs, start = shared_edges(surface.faces), half_edges(surface.faces)[:, 0]
    first, second = (pairs // 3).T
    clash = start[pairs[:, 0]] == start[pairs[:, 1]]  # neighbours that agree run opposite ways
    rows = np.concatenate([first, first + count])
    columns = np.concatenate([second + count * clash, second + count * ~clash])
    graph = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * count, 2 * count))
    images = connected_components(graph, directed=False)[1].reshape(2, count)
    if (images[0] == images[1]).any():
        raise surface.fault(
            f"{(images[0] == images[1]).sum()} faces are on a surface with one side only; rebuild the "
            "surface there"
        )
    part = np.unique(images.min(axis=0), return_inverse=True)[1]
    return part, images[0] > images[1]


def _refuse_openings(surface: Surface) -> None:
    """Each component has one rim, a tube two; every other opening is a hole."""
    edges = _open_edges(surface)
    if not len(edges):
        return
    loop = _loops(edges)
    a, b = np.moveaxis(surface.vertices[edges], 1, 0)
    length = np.asarray(np.bincount(loop, np.linalg.norm(b - a, axis=1)), float)
    round_pole = _turns(loop, a, b) != 0
    of = _components(surface)[edges[np.unique(loop, return_index=True)[1], 0]]
    holes = [
        hole
        for component in np.unique(of)
        for hole in _holes(np.flatnonzero(of == component), length, round_pole)
    ]
    if holes:
        listed = "; ".join(_opening(surface, edges[loop == n]) for n in holes[:3])
        raise surface.fault(
            f"{len(holes)} {'hole' if len(holes) == 1 else 'holes'} besides the rim: {listed}"
            f"{'; ...' if len(holes) > 3 else ''}. Close holes; a door can be a group that is not lit"
        )


def _holes(loops: IndexArray, length: Array, round_pole: BoolArray) -> IndexArray:
    """Openings of a component that are no rims."""
    longest = loops[np.argmax(length[loops])]
    ends = loops[round_pole[loops] & (length[loops] >= OTHER_RIM * length[longest])]
    return np.setdiff1d(loops, ends if len(ends) == 2 and longest in ends else [longest])


def _components(surface: Surface) -> IndexArray:
    """Number (V,) of the component of each vertex."""
    one, other = half_edges(surface.faces).T
    count = len(surface.vertices)
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _open_edges(surface: Surface) -> IndexArray:
    """Vertices (E, 2) of the edges with one face, in that face's order.

    Where faces of different sizes meet, an edge is as many as there are vertices on it.
    """
    edges = half_edges(surface.faces)
    alone = np.ones(len(edges), bool)
    alone[shared_edges(surface.faces)] = False
    parts = np.concatenate([np.zeros((0, 2), np.intp), *_cut(surface, np.asarray(edges[alone]))])
    forwards = np.where(parts[:, 0] < parts[:, 1], 1, -1)
    pair, number = np.unique(np.sort(parts, axis=1), axis=0, return_inverse=True)
    open_ = np.bincount(number.ravel(), forwards, len(pair))
    return np.asarray(np.where(open_[:, None] < 0, pair[:, ::-1], pair)[open_ != 0])


def _cut(surface: Surface, edges: IndexArray) -> Iterator[IndexArray]:
    """The parts (K, 2) of each edge between the other edges' vertices that lie on it."""
    every = np.unique(edges)
    near, tree = WELD * surface.extent, cKDTree(surface.vertices[every])
    middle = surface.vertices[edges].mean(axis=1)
    reach = np.linalg.norm(np.diff(surface.vertices[edges], axis=1)[:, 0], axis=1) / 2 + near
    for (start, end), around in zip(edges, tree.query_ball_point(middle, reach), strict=True):
        ends, (a, b) = every[around], surface.vertices[[start, end]]
        points = surface.vertices[ends]
        share = (points - a) @ (b - a) / ((b - a) @ (b - a))
        off = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)
        on = (off < near) & (share > WELD) & (share < 1 - WELD)
        chain = np.concatenate([[start], ends[on][np.argsort(share[on])], [end]])
        yield np.stack([chain[:-1], chain[1:]], axis=1)


def _loops(edges: IndexArray) -> IndexArray:
    """Number of the loop that each edge belongs to."""
    count = int(edges.max()) + 1
    graph = coo_array((np.ones(len(edges), bool), tuple(edges.T)), shape=(count, count))
    member = connected_components(graph, directed=False)[1][edges[:, 0]]
    return np.asarray(np.unique(member, return_inverse=True)[1])


def _turns(loop: IndexArray, a: Array, b: Array) -> IndexArray:
    """Number of times that each loop of edges from a to b goes round the pole."""
    step = np.arctan2(b[:, 1], b[:, 0]) - np.arctan2(a[:, 1], a[:, 0])
    step -= 2 * np.pi * np.rint(step / (2 * np.pi))
    return np.rint(np.bincount(loop, step) / (2 * np.pi)).astype(np.intp)


def _opening(surface: Surface, edges: IndexArray) -> str:
    points = surface.vertices[np.unique(edges)]
    across = 2 * np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    return f"{across:.3g} m across {_place(surface, edges)}"


def _place(surface: Surface, vertices: IndexArray) -> str:
    """Direction of some vertices from the origin, for messages."""
    centre = surface.vertices[np.unique(vertices)].mean(axis=0)
    azimuth, elevation = np.degrees(angles_from_direction(normalise(centre)))
    return f"at azimuth {azimuth:.1f}, elevation {elevation:.1f} degrees"
