"""A hemisphere as a mesh, in the room's code, against the dome's: one scalar there, form factors here."""

from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest

from procam.compensate.compensator import Compensator
from procam.compensate.room import RoomCompensator
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import master_pixels
from procam.maths.mesh.canvas import mesh_canvas
from procam.maths.mesh.compressed import compressed_factors
from procam.model.calibration import Calibration

SIZE, RADIUS_M, STEPS = 256, 4.0, 36
ALBEDO, LO = 0.6, 0.001
EDGE = 0.97  # of the circle's radius: an inner part, as the rim of the mesh is a polygon


@pytest.fixture(scope="module")
def room() -> RoomCompensator:
    vertices, faces = mesh_shapes.hemisphere(RADIUS_M, STEPS)
    place = (master_pixels(vertices / RADIUS_M, SIZE) + 0.5) / SIZE
    canvas = mesh_canvas(vertices, faces, np.zeros(len(faces), np.intp), place, (SIZE, SIZE))
    albedo = np.full((len(faces), 3), ALBEDO)
    return RoomCompensator(canvas, compressed_factors(vertices, faces), albedo, LO, 1.0)


@pytest.fixture
def dome(calibration: Calibration) -> Calibration:
    """A bare dome of one paint, lit to its rim: u = rho / (4 pi - rho 2 pi)."""
    plane = np.ones((SIZE, SIZE, 3), np.float32)
    maps = replace(
        calibration.maps,
        scatter_per_flux=np.float32(ALBEDO / (4 * np.pi - ALBEDO * 2 * np.pi)) * plane,
        albedo=np.float32(ALBEDO) * plane,
        lo=np.float32(LO) * plane,
        hi=plane,
        coverage=plane[..., 0],
    )
    return replace(calibration, maps=maps)


def _contents() -> dict[str, np.ndarray]:
    direction, inside = STANDARD.directions(SIZE)
    half = np.where(direction[..., :1] > 0, 0.8, 0.02)
    spot = np.where(direction @ [0.6, 0.0, 0.8] > 0.95, 0.9, 0.05)[..., None]
    smooth = 0.45 + 0.3 * direction[..., 1:2]
    return {
        name: np.float32(c * inside[..., None] * np.ones(3))
        for name, c in (("half", half), ("spot", spot), ("smooth", smooth))
    }


@pytest.mark.parametrize("name", ["half", "spot", "smooth"])
def test_a_sphere_as_a_mesh_is_the_dome(
    name: str, room: RoomCompensator, dome: Calibration
) -> None:
    content = _contents()[name]
    by_dome, by_mesh = Compensator(dome, SIZE).predict(content), room.exact(content)
    offset = (np.arange(SIZE) - (SIZE - 1) / 2) / (SIZE / 2)
    inner = np.hypot(*np.meshgrid(offset, offset)) < EDGE
    np.testing.assert_allclose(by_mesh.direct[inner], by_dome.direct[inner], atol=1e-3)
    np.testing.assert_allclose(by_mesh.observed[inner], by_dome.observed[inner], atol=1e-3)


def test_its_feedback_is_that_of_the_sphere(room: RoomCompensator) -> None:
    """m = rho 2 pi / (4 pi - rho 2 pi)."""
    ideal = room.with_black(0.0)
    white = np.ones((SIZE, SIZE, 3), np.float32)
    seen, weight = ideal.none(white).observed[..., 1], ideal.canvas.area
    m = float((weight * seen).sum() / weight.sum()) - 1
    assert m == pytest.approx(ALBEDO / (2 - ALBEDO), rel=2e-3)
