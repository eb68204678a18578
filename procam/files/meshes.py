"""Screens as triangle meshes, from OBJ and PLY files (trimesh; extra `geom`).

A mesh must be one surface round the dome frame's origin, in metres. Vertices at one place are welded,
faces without area dropped and faces that point outwards reversed, with a warning; every other fault is
an error. To orient the faces, each face is two nodes of a graph, as it is and reversed, and neighbours are
joined so that they agree: a surface with two sides falls into two components, a one-sided one does not.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import FileFormatError
from procam.maths.geometry.sphere import angles_from_direction, normalise
from procam.maths.mesh.facets import half_edges, shared_edges
from procam.model.screen import MeshScreen

SUFFIXES = (".obj", ".ply")
EXTRA = 'pip install "procam[geom]"'
LARGEST_M = 500.0
WELD = 1e-6  # of the extent: vertices nearer than this are one
NO_AREA = 1e-12  # of the extent squared: faces and openings smaller than this are none
OTHER_RIM = 0.5  # of the longest rim: how long the other end of a tube is at least


@dataclass(frozen=True, slots=True)
class _Mesh:
    """A mesh that is being checked, and its file."""

    path: Path
    vertices: Array
    faces: IndexArray

    @property
    def extent(self) -> float:
        """Longest edge of the bounding box [m]."""
        return float(np.ptp(self.vertices, axis=0).max())

    def fault(self, message: str) -> FileFormatError:
        return FileFormatError(f"{self.path}: {message}")

    def warn(self, message: str) -> None:
        warnings.warn(f"{self.path}: {message}", UserWarning, stacklevel=4)


def load_mesh(path: Path, *, smooth: bool = False) -> MeshScreen:
    """The screen in an OBJ or PLY file, in metres in the dome frame.

    Vertices at one place are welded. Faces without area or drawn twice are dropped, and faces that point
    outwards reversed, each with a UserWarning.

    Parameters
    ----------
    path : file.obj or file.ply.
    smooth : the mesh samples a smooth surface, such as a scanned dome; else its faces are flat.

    Raises
    ------
    FileFormatError
        If there is no such file, it has no faces, or NaN vertices; if it is larger than 500 m; if the
        surface is one-sided or branches; if it has an opening besides its rim. A tube, open at both
        ends, has two rims.
    """
    mesh = _read(Path(path))
    _check_numbers(mesh)
    mesh = _facing_inside(_without_empty_faces(_welded(mesh)))
    _refuse_openings(mesh)
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return MeshScreen(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32), smooth)


def _read(path: Path) -> _Mesh:
    """The mesh of a file, polygons as triangles."""
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: meshes are read from .obj and .ply files; export it as one")
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; a mesh is needed. Check the name")
    loader = _trimesh()
    try:
        found = loader.load_mesh(path, process=False)
        vertices, faces = (np.asarray(found.vertices, np.float64), np.asarray(found.faces, np.intp))
        stated = _faces_in_header(path)
        if len(faces) and (vertices.shape[1:], faces.shape[1:]) != ((3,), (3,)):
            raise ValueError("its points have no three coordinates, or its faces no three corners")
    except Exception as error:  # trimesh raises of every kind
        raise FileFormatError(
            f"{path} is not a readable OBJ or PLY mesh ({' '.join(str(error).split())}); export it again"
        ) from error
    mesh = _Mesh(path, vertices, faces)
    if len(mesh.faces) < stated:
        raise mesh.fault(f"{len(mesh.faces)} of the {stated} faces in its header; copy it again")
    if not len(mesh.faces):
        raise mesh.fault(
            "no faces; make a surface of the points, such as by Poisson reconstruction"
        )
    return mesh


def _trimesh() -> Any:
    try:
        import trimesh  # noqa: PLC0415
    except ImportError as error:
        raise FileFormatError(
            f"mesh screen: trimesh, which reads meshes, is not installed; run: {EXTRA}"
        ) from error
    return trimesh


def _faces_in_header(path: Path) -> int:
    """Number of polygons in the header of a PLY; 0 for other files."""
    if path.suffix.lower() != ".ply":
        return 0
    header = path.read_bytes().partition(b"end_header")[0]
    counts = [line.split()[2] for line in header.splitlines() if line.startswith(b"element face")]
    return int(counts[0]) if counts else 0


def _check_numbers(mesh: _Mesh) -> None:
    bad = int((~np.isfinite(mesh.vertices)).any(axis=1).sum())
    if bad:
        raise mesh.fault(
            f"{bad} of {len(mesh.vertices)} vertices are NaN or infinite; delete them and close the holes"
        )
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise mesh.fault(
            f"a face has vertex {mesh.faces.max()}, but there are {len(mesh.vertices)}; export it again"
        )
    if mesh.extent > LARGEST_M:
        raise mesh.fault(
            f"it extends over {mesh.extent:.6g} m, more than {LARGEST_M:g}; if it is in millimetres, scale "
            "it by 0.001 to metres"
        )


def _welded(mesh: _Mesh) -> _Mesh:
    """Vertices at one place made one: exporters split them at seams and between panels."""
    pairs = cKDTree(mesh.vertices).query_pairs(WELD * mesh.extent, output_type="ndarray")
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(count, count))
    place = connected_components(graph, directed=False)[1]
    first = np.unique(place, return_index=True)[1]
    return _Mesh(mesh.path, mesh.vertices[first], place[mesh.faces].astype(np.intp))


def _without_empty_faces(mesh: _Mesh) -> _Mesh:
    """The mesh without faces that have no area or are drawn twice."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    kept = np.zeros(len(mesh.faces), bool)
    kept[np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)[1]] = True
    kept &= area > NO_AREA * mesh.extent**2
    if not kept.any():
        raise mesh.fault(f"all {len(kept)} faces are without area; export it again")
    if not kept.all():
        mesh.warn(f"{(~kept).sum()} of {len(kept)} faces had no area or were drawn twice; dropped")
    return _Mesh(mesh.path, mesh.vertices, mesh.faces[kept])


def _facing_inside(mesh: _Mesh) -> _Mesh:
    """The mesh with all faces counter-clockwise as seen from the origin's side."""
    _refuse_branches(mesh)
    part, turned = _sides(mesh)
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    a, b, c = np.moveaxis(mesh.vertices[faces], 1, 0)
    outward = np.bincount(part, np.einsum("fi,fi->f", a, np.cross(b, c)))  # six times the volume
    wrong = turned ^ (outward > 0)[part]
    if wrong.any():
        mesh.warn(f"{wrong.sum()} of {len(wrong)} faces pointed outwards; reversed")
    return _Mesh(
        mesh.path, mesh.vertices, np.where(wrong[:, None], mesh.faces[:, ::-1], mesh.faces)
    )


def _refuse_branches(mesh: _Mesh) -> None:
    """A surface has no edge with three faces."""
    edges, count = np.unique(np.sort(half_edges(mesh.faces), axis=1), axis=0, return_counts=True)
    branching = edges[count > 2]
    if len(branching):
        raise mesh.fault(
            f"{len(branching)} edges have three faces or more, the first {_place(mesh, branching[0])}; "
            "delete the faces inside or behind the surface"
        )


def _sides(mesh: _Mesh) -> tuple[IndexArray, BoolArray]:
    """Connected part of each face, and whether it has to be reversed to agree with its part.

    Each face is two nodes, as it is and reversed, and neighbours are joined so that they agree. A part
    then falls into two mirror images, unless it has only one side.
    """
    count = len(mesh.faces)
    pairs, start = shared_edges(mesh.faces), half_edges(mesh.faces)[:, 0]
    first, second = (pairs // 3).T
    clash = start[pairs[:, 0]] == start[pairs[:, 1]]  # neighbours that agree run opposite ways
    rows = np.concatenate([first, first + count])
    columns = np.concatenate([second + count * clash, second + count * ~clash])
    graph = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * count, 2 * count))
    images = connected_components(graph, directed=False)[1].reshape(2, count)
    if (images[0] == images[1]).any():
        raise mesh.fault(
            f"{(images[0] == images[1]).sum()} faces are on a surface with one side only; rebuild the "
            "surface there"
        )
    part = np.unique(images.min(axis=0), return_inverse=True)[1]
    return part, images[0] > images[1]


def _refuse_openings(mesh: _Mesh) -> None:
    """A screen has one rim, a tube two; every other opening is a hole."""
    edges = _open_edges(mesh)
    if not len(edges):
        return
    loop = _loops(edges)
    a, b = np.moveaxis(mesh.vertices[edges], 1, 0)
    length = np.bincount(loop, np.linalg.norm(b - a, axis=1))
    enclosed = np.stack([np.bincount(loop, v) for v in np.cross(a, b).T], axis=1)
    slit = np.linalg.norm(enclosed, axis=1) / 2 < NO_AREA * mesh.extent**2
    longest = int(np.argmax(np.where(slit, 0, length)))
    round_pole = _turns(loop, a, b) != 0
    ends = np.flatnonzero(round_pole & (length >= OTHER_RIM * length[longest]) & ~slit)
    rims = ends if len(ends) == 2 and longest in ends else [longest]
    holes = [n for n in range(len(length)) if not slit[n] and n not in rims]
    if holes:
        listed = "; ".join(_opening(mesh, edges[loop == n]) for n in holes[:3])
        raise mesh.fault(
            f"{len(holes)} {'hole' if len(holes) == 1 else 'holes'} besides the rim: {listed}"
            f"{'; ...' if len(holes) > 3 else ''}. Close holes, delete loose pieces"
        )


def _open_edges(mesh: _Mesh) -> IndexArray:
    """Vertices (E, 2) of the edges with one face, in that face's order."""
    edges = half_edges(mesh.faces)
    alone = np.ones(len(edges), bool)
    alone[shared_edges(mesh.faces)] = False
    return np.asarray(edges[alone])


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


def _opening(mesh: _Mesh, edges: IndexArray) -> str:
    points = mesh.vertices[np.unique(edges)]
    across = 2 * np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    return f"{across:.3g} m across {_place(mesh, edges)}"


def _place(mesh: _Mesh, vertices: IndexArray) -> str:
    """Direction of some vertices from the origin, for messages."""
    centre = mesh.vertices[np.unique(vertices)].mean(axis=0)
    azimuth, elevation = np.degrees(angles_from_direction(normalise(centre)))
    return f"at azimuth {azimuth:.1f}, elevation {elevation:.1f} degrees"
