"""A triangle mesh as a screen for the bundle adjustment, with the interface of `RoundShape`."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import InputError
from procam.kernels import ShapeDerivatives
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.mesh.facets import Faces
from procam.maths.mesh.raycast import Hits, MeshTracer, weights_of_corners
from procam.maths.mesh.wall_moves import WallMoves

NOTHING = MappingProxyType[int, str]({})
DRAWN_M = (
    0.02  # standard deviation of walls from the drawing that they were built by, rms over a wall
)
NEAR = 1e-3  # of the extent: points of a line of sight that are one
SAMPLES = ((1 / 3, 1 / 3, 1 / 3), (0.96, 0.02, 0.02), (0.02, 0.96, 0.02), (0.02, 0.02, 0.96))


class MovedMesh:
    """A mesh (V, 3), (F, 3) whose parts may move; the tracer of the last moves is kept.

    `seen` (F,) are the faces that the origin sees whole, None for all.
    """

    def __init__(
        self,
        vertices: Array,
        faces: Faces,
        smooth: bool,
        moves: WallMoves | None = None,
        seen: BoolArray | None = None,
    ) -> None:
        self.vertices, self.faces, self.smooth, self.moves = vertices, faces, smooth, moves
        self.seen = seen
        self._kept: tuple[bytes, MeshTracer] | None = None

    def moved_vertices(self, amount: Array) -> Array:
        """The vertices (V, 3) after moves (K,)."""
        if self.moves is None:
            return self.vertices
        return self.vertices + np.tensordot(amount, self.moves.fields, 1)

    def tracer(self, amount: Array) -> MeshTracer:
        """Traces rays against the mesh after moves (K,)."""
        key = amount.tobytes()
        if self._kept is None or self._kept[0] != key:
            vertices = self.moved_vertices(amount)
            self._kept = key, MeshTracer(vertices, self.faces, smooth=self.smooth)
        return self._kept[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshShape(RoundShape):
    """A surface |x| = radius (1 + w(x/|x|)), whose height w over the sphere is that of a mesh.

    To the solver w is a harmonic with coefficient 1, plus one for each way in which walls move. The origin
    must see every point of the mesh that counts, as in rooms, drums and domes; rays that meet another, such
    as the back of a seat, miss.

    Attributes
    ----------
    radius_m : of the sphere around the mesh [m]; the mesh scales with it.
    mesh : in units of that radius. part : (F,) number of each face's part.
    free : names of parts that may move, by number.
    harmonic_coefficients : (1 + K,) 1, then the displacements [radius] of walls that are solved for.
    """

    mesh: MovedMesh
    part: IndexArray
    free: Mapping[int, str]
    harmonic_coefficients: Array = field(default_factory=lambda: np.ones(1))

    @classmethod
    def of(
        cls,
        vertices: Array,
        faces: Faces,
        *,
        smooth: bool = False,
        part: IndexArray | None = None,
        free: Mapping[int, str] = NOTHING,
        convex: bool = True,
    ) -> "MeshShape":
        """The shape of a mesh (V, 3) [m], (F, 3), counter-clockwise seen from the room.

        Where it is not `convex`, faces may hide others from the origin.

        Raises
        ------
        InputError
            If the origin sees a face of a convex mesh from behind, or embreex is not installed.
        """
        seen = (
            None
            if convex
            else seen_faces(vertices, faces, MeshTracer(vertices, faces, smooth=smooth))
        )
        behind = _from_behind(vertices[faces])
        if convex and behind.any():
            raise InputError(
                f"mesh screen: the origin sees {behind.sum()} of {len(faces)} faces edge-on or from "
                "behind, but must see all of them. Move the dome frame's origin to the middle of the room."
            )
        radius_m = float(np.linalg.norm(vertices, axis=1).max())
        return cls(
            radius_m=radius_m,
            mesh=MovedMesh(vertices / radius_m, faces, smooth, seen=seen),
            part=np.zeros(len(faces), np.intp) if part is None else part,
            free=free,
        )

    @property
    def is_sphere(self) -> bool:
        """Whether the surface is an exact sphere."""
        return False

    @property
    def coefficient_sigmas(self) -> Array:
        """Prior standard deviations (1 + K,): the mesh is what it is, and walls are near their drawing."""
        return np.r_[0.0, np.full(self.moves.size, DRAWN_M / self.radius_m)]

    @property
    def moves(self) -> Array:
        """Displacements (K,) [radius] of the walls."""
        return self.harmonic_coefficients[1:]

    @property
    def tracer(self) -> MeshTracer:
        """Of the mesh as it is now, in units of the radius."""
        return self.mesh.tracer(self.moves)

    def moved_parts(self) -> dict[str, Array]:
        """How the walls moved: the seven numbers of `maths.mesh.wall_moves`, in metres, by name."""
        if self.mesh.moves is None:
            return {}
        metres = np.r_[np.full(4, self.radius_m), np.ones(3)]
        return {
            name: self.moves[own] @ self.mesh.moves.numbers[own] * metres
            for part, name in self.free.items()
            if (own := self.mesh.moves.part == part).any()
        }

    def with_free_walls(self) -> "MeshShape":
        """The shape whose free parts the solver may move; itself if there are none."""
        if not self.free:
            return self
        mesh = self.mesh
        moves = WallMoves.of(mesh.vertices, mesh.faces, self.part, list(self.free))
        coefficients = np.r_[1.0, np.zeros(len(moves.part))]
        mesh = MovedMesh(mesh.vertices, mesh.faces, mesh.smooth, moves, mesh.seen)
        return replace(self, mesh=mesh, harmonic_coefficients=coefficients)

    def harmonics_at(self, direction: Array) -> tuple[Array, Array]:
        """Height over the sphere (N, 1 + K) and its gradients (N, 1 + K, 3) in unit directions (N, 3)."""
        _, values, slopes = self._derivatives(self.tracer.first_hits(np.zeros(3), direction))
        return values, slopes

    def shape_derivatives(self, origin: Array, direction: Array) -> ShapeDerivatives:
        """Height and gradient of the mesh where rays (N, 3) meet it; NaN where they miss."""
        return self._derivatives(self.tracer.first_hits(origin / self.radius_m, direction))

    def sees(self, origin: Array, points: Array) -> BoolArray:
        """Whether nothing is between an origin (3,) and points (N, 3) of the mesh."""
        if self.mesh.seen is None:
            return np.ones(len(points), bool)
        end, start = points / self.radius_m, origin / self.radius_m
        met = self.tracer.intersect(start, end - start)
        return np.asarray(np.linalg.norm(met - end, axis=1) < NEAR)

    def drawn(self, points: Array) -> Array:
        """Where the drawing has points (N, 3) [m] of the moved walls."""
        if not self.moves.any():
            return points
        hits = self.tracer.first_hits(np.zeros(3), points)
        return points - self.radius_m * np.einsum("nki,k->ni", self._moved(hits), self.moves)

    def moved_at(self, points: Array) -> Array:
        """Displacements (N, K, 3) [m] of points (N, 3) [m] by each move of 1 radius."""
        return self.radius_m * self._moved(self.tracer.first_hits(np.zeros(3), points))

    def _derivatives(self, hits: Hits) -> ShapeDerivatives:
        """Height of the faces that were hit over the unit sphere: r(u) = (p.n) / (u.n).

        The mesh's own is what is left of it after those of the moves, so that the sum is exact.
        """
        hits = self._known(hits)
        distance = np.linalg.norm(hits.points, axis=1, keepdims=True)
        start = hits.points / distance
        depth = np.sum(hits.points * hits.normals, axis=1, keepdims=True)
        across = -(distance**2) * hits.normals / depth
        lifts = np.einsum("nki,ni->nk", self._moved(hits), hits.normals) * distance / depth
        values = np.c_[distance - 1 - (lifts @ self.moves)[:, None], lifts]
        slopes = np.zeros((*values.shape, 3))
        slopes[:, 0] = across
        return ShapeDerivatives(start, values, slopes)

    def _known(self, hits: Hits) -> Hits:
        """Hits of faces that the origin sees; NaN of others."""
        if self.mesh.seen is None or not len(hits.faces):
            return hits
        known = self.mesh.seen[hits.faces] & (hits.faces >= 0)
        return hits._replace(points=np.where(known[:, None], hits.points, np.nan))

    def _moved(self, hits: Hits) -> Array:
        """Displacements (N, K, 3) of points that were hit, by each move; NaN where rays missed."""
        if self.mesh.moves is None:
            return np.zeros((len(hits.points), 0, 3))
        corner = self.mesh.faces[hits.faces]
        vertices = self.mesh.moved_vertices(self.moves)
        share = weights_of_corners(vertices[corner], hits.points)
        return np.einsum("nc,kncj->nkj", share, self.mesh.moves.fields[:, corner])


def seen_faces(vertices: Array, faces: Faces, tracer: MeshTracer) -> BoolArray:
    """Faces (F,) of a mesh [m] that the origin sees whole, by points near their corners and in the middle."""
    corner = vertices[faces]
    seen = ~_from_behind(corner)
    near = NEAR * float(np.ptp(vertices, axis=0).max())
    for share in SAMPLES:
        points = np.einsum("c,fci->fi", share, corner[seen])
        met = tracer.intersect(np.zeros(3), points)
        seen[seen] = np.linalg.norm(met - points, axis=1) < near
    return seen


def _from_behind(corner: Array) -> BoolArray:
    """Whether the origin sees faces of some corners (F, 3, 3) edge-on or from behind."""
    a, b, c = np.moveaxis(corner, 1, 0)
    return np.asarray(np.einsum("fi,fi->f", a, np.cross(b, c)) >= 0)
