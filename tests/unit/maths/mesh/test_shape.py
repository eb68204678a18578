"""A mesh as the screen of the bundle adjustment."""

import mesh_shapes
import numpy as np
import pytest

from procam.errors import InputError
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.shape import MeshShape


def test_a_mesh_that_the_origin_does_not_see_is_refused() -> None:
    vertices, faces = mesh_shapes.box((-8.5, -7.6, -2.0), (8.3, 7.9, 6.5))
    with pytest.raises(InputError, match="the origin sees 2 of 12 faces edge-on"):
        MeshShape.of(vertices + np.array([0, 0, 2.0]), faces)


class TestHemisphere:
    """A mesh of a sphere gives the same points and gradients as the sphere."""

    vertices, faces = mesh_shapes.hemisphere(6.0, 40)
    mesh = MeshShape.of(vertices, faces, smooth=True)
    sphere = RoundShape(6.0)

    def _rays(self) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(4)
        direction = normalise(rng.normal(size=(500, 3)) * [1, 1, 0.3] + [0, 0, 1.0])
        return rng.normal(0, 0.5, (500, 3)) + np.array([0, 0, 0.5]), direction

    def test_points_and_gradients(self) -> None:
        origin, direction = self._rays()
        found, known = self.mesh.hit(origin, direction), self.sphere.hit(origin, direction)
        assert np.abs(found.point - known.point).max() < 1e-5
        assert np.abs(normalise(found.outward) - known.outward).max() < 1e-4

    def test_radius(self) -> None:
        _, direction = self._rays()
        np.testing.assert_allclose(self.mesh.radius_at(direction), 6.0, atol=1e-5)

    def test_rays_that_miss_are_nan(self) -> None:
        down = np.array([[0.0, 0.6, -0.8]])
        assert np.isnan(self.mesh.intersect(np.zeros((1, 3)), down)).all()
        assert np.isnan(self.mesh.radius_at(down)).all()
