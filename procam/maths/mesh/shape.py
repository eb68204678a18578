"""A triangle mesh as a screen for the bundle adjustment, with the interface of `RoundShape`."""

from dataclasses import dataclass, field

import numpy as np

from procam.arrays import Array
from procam.errors import InputError
from procam.kernels import ShapeDerivatives
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.mesh.facets import Faces
from procam.maths.mesh.raycast import Hits, MeshTracer


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshShape(RoundShape):
    """A surface |x| = radius (1 + w(x/|x|)), whose height w over the sphere is that of a mesh.

    To the solver w is a single harmonic with coefficient 1. The origin must see every point of the
    mesh, as in rooms, drums and domes.

    Attributes
    ----------
    radius_m : of the sphere around the mesh [m]; the mesh scales with it.
    tracer : of the mesh in units of that radius.
    """

    tracer: MeshTracer
    harmonic_coefficients: Array = field(default_factory=lambda: np.ones(1))

    @classmethod
    def of(cls, vertices: Array, faces: Faces, *, smooth: bool = False) -> "MeshShape":
        """The shape of a mesh (V, 3) [m], (F, 3), counter-clockwise seen from the origin.

        Raises
        ------
        InputError
            If the origin sees a face edge-on or from behind, or embreex is not installed.
        """
        a, b, c = np.moveaxis(vertices[faces], 1, 0)
        behind = np.einsum("fi,fi->f", a, np.cross(b, c)) >= 0
        if behind.any():
            raise InputError(
                f"mesh screen: the origin sees {behind.sum()} of {len(faces)} faces edge-on or from "
                "behind, but must see all of them. Move the dome frame's origin to the middle of the room."
            )
        radius_m = float(np.linalg.norm(vertices, axis=1).max())
        return cls(radius_m=radius_m, tracer=MeshTracer(vertices / radius_m, faces, smooth=smooth))

    @property
    def is_sphere(self) -> bool:
        """Whether the surface is an exact sphere."""
        return False

    def harmonics_at(self, direction: Array) -> tuple[Array, Array]:
        """Height over the sphere (N, 1) and its gradients (N, 1, 3) in unit directions (N, 3)."""
        _, values, slopes = self._derivatives(self.tracer.first_hits(np.zeros(3), direction))
        return values, slopes

    def shape_derivatives(self, origin: Array, direction: Array) -> ShapeDerivatives:
        """Height and gradient of the mesh where rays (N, 3) meet it; NaN where they miss."""
        return self._derivatives(self.tracer.first_hits(origin / self.radius_m, direction))

    @staticmethod
    def _derivatives(hits: Hits) -> ShapeDerivatives:
        """Height of the faces that were hit over the unit sphere: r(u) = (p.n) / (u.n)."""
        distance = np.linalg.norm(hits.points, axis=1, keepdims=True)
        start = hits.points / distance
        depth = np.sum(hits.points * hits.normals, axis=1, keepdims=True)
        slopes = -(distance**2) * hits.normals / depth
        return ShapeDerivatives(start, distance - 1, slopes[:, None])
