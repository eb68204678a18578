"""A triangle mesh as a screen that rigs are solved on: the same questions as of a round one."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.kernels import ShapeDerivatives
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.mesh.facets import Faces
from procam.maths.mesh.raycast import Hits, MeshTracer

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshShape(RoundShape):
    """A surface |x| = radius (1 + b w(x/|x|)) whose one wave w is read off a mesh, with b = 1.

    Every place of it must be in sight of the origin, as in rooms, drums and domes.

    Attributes
    ----------
    radius_m : of the sphere round the mesh [m]; the mesh grows with it. tracer : of the mesh in
        units of that radius.
    """

    tracer: MeshTracer
    bumps: Array = field(default_factory=lambda: np.ones(1))

    @classmethod
    def of(cls, vertices: Array, faces: Faces, *, smooth: bool = False) -> "MeshShape":
        """The shape of a mesh (V, 3) [m], (F, 3), counter-clockwise seen from the origin.

        Raises
        ------
        InputError
            If a face is seen edge-on or from behind, or embreex is not installed.
        """
        a, b, c = np.moveaxis(vertices[faces], 1, 0)
        hidden = np.einsum("fi,fi->f", a, np.cross(b, c)) >= 0
        if hidden.any():
            raise InputError(
                f"mesh screen: got {hidden.sum()} of {len(faces)} faces that the origin sees edge-on "
                "or from behind, expected all of the screen in sight of it; move the dome frame's "
                "origin to the middle of the room"
            )
        radius_m = float(np.linalg.norm(vertices, axis=1).max())
        return cls(radius_m=radius_m, tracer=MeshTracer(vertices / radius_m, faces, smooth=smooth))

    @property
    def exact(self) -> bool:
        """Whether it is a sphere."""
        return False

    def waves(self, direction: Array) -> tuple[Array, Array]:
        """Height over the sphere (N, 1) and its slopes (N, 1, 3) in unit directions (N, 3)."""
        _, values, slopes = self._relief(self.tracer.first_hits(np.zeros(3), direction))
        return values, slopes

    def relief(self, origin: Array, direction: Array) -> ShapeDerivatives:
        """The mesh where rays (N, 3) meet it; NaN where they miss."""
        return self._relief(self.tracer.first_hits(origin / self.radius_m, direction))

    @staticmethod
    def _relief(hits: Hits) -> ShapeDerivatives:
        """The faces that were hit as heights over the unit sphere: r(u) = (p.n) / (u.n)."""
        distance = np.linalg.norm(hits.points, axis=1, keepdims=True)
        start = hits.points / distance
        depth = np.sum(hits.points * hits.normals, axis=1, keepdims=True)
        slopes = -(distance**2) * hits.normals / depth
        return ShapeDerivatives(start, distance - 1, slopes[:, None])
