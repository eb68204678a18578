"""The perceptual method on meshes: levels of faces, and the guard on a room's own transport."""

import numpy as np
import pytest
from mesh_shapes import hemisphere

from procam.compensate.mesh import MeshCompensator
from procam.compensate.perceptual.faces import FaceLevels
from procam.compensate.perceptual.settings import Perceptual
from procam.errors import InputError, ShapeError, UnitError
from procam.maths.mesh.form_factors import form_factors
from procam.maths.vision.pu21 import pu21

LUMA = np.array([0.2126, 0.7152, 0.0722])
RIM_M = 0.3  # height below which nothing is lit
ALBEDO = 0.5


class Room:
    """A hemisphere of triangles, lit above its rim."""

    def __init__(self, steps: int = 8) -> None:
        vertices, faces = hemisphere(5.0, steps)
        corners = vertices[faces]
        self.direction = corners.mean(axis=1)
        self.area = (
            np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            )
            / 2
        )
        self.lit = self.direction[:, 2] > RIM_M
        self.factors = form_factors(vertices, faces)
        lo, hi = (np.where(self.lit[:, None], limit, 0) * np.ones(3) for limit in (0.0005, 1.0))
        albedo = np.full((len(faces), 3), ALBEDO)
        self.compensator = MeshCompensator(self.factors, albedo, self.area, lo=lo, hi=hi)

    def dusk(self) -> np.ndarray:
        """Bright on one side, dark with detail on the other."""
        rng = np.random.default_rng(4)
        dark = 0.05 * np.exp(0.6 * rng.normal(size=(len(self.area), 1)))
        light = np.where(self.direction[:, :1] > 0, 0.8, dark) * np.array([1.0, 0.9, 0.8])
        return np.where(self.lit[:, None], light, 0)

    def error(self, light: np.ndarray, target: np.ndarray) -> float:
        units = [pu21(each @ LUMA * 14) for each in (light, target)]
        return float(np.average((units[0] - units[1]) ** 2, weights=self.area * self.lit))

    def contrast(self, light: np.ndarray) -> float:
        dark = self.lit & (self.direction[:, 0] < 0)
        return float(np.log(light[dark] @ LUMA).std())


@pytest.fixture(scope="module")
def room() -> Room:
    return Room()


@pytest.mark.parametrize("db", [0.0, 1.0])
def test_more_contrast_within_the_guard(room: Room, db: float) -> None:
    target = room.dusk()
    exact = room.compensator.exact(target).total
    found = room.compensator.perceptual(target, room.direction, settings=Perceptual(db))
    lost = 10 * np.log10(room.error(found.total, target) / room.error(exact, target))
    assert lost <= db + 0.001
    assert room.contrast(found.total) > 1.3 * room.contrast(exact)
    assert found.certificate.kkt.max() < 1e-9
    assert found.certificate.self_consistency.max() < 1e-9
    # the light of the faces, bounced by a dense inverse
    bounced = np.linalg.solve(np.eye(len(room.area)) - ALBEDO * room.factors, found.direct)
    np.testing.assert_allclose(found.total, bounced, atol=1e-6)


def test_a_target_within_reach_is_solved_exactly(room: Room) -> None:
    target = np.where(room.lit[:, None], 0.5, 0.0) * np.ones(3)
    exact = room.compensator.exact(target)
    found = room.compensator.perceptual(target, room.direction)
    np.testing.assert_array_equal(found.direct, exact.direct)


def test_only_faces_that_are_looked_at_count(room: Room) -> None:
    one = np.zeros(len(room.area))
    one[np.flatnonzero(room.lit)[0]] = 1
    target = room.dusk()
    found = room.compensator.perceptual(target, room.direction, one)
    np.testing.assert_array_equal(found.direct, room.compensator.exact(target).direct)


class TestLevels:
    def test_adjoints(self, room: Room, rng: np.random.Generator) -> None:
        unit = room.direction / np.linalg.norm(room.direction, axis=1)[:, None]
        levels = FaceLevels(unit, room.area * room.lit)
        x, g = rng.normal(size=(2, 3, len(room.area))).astype(np.float32)
        for level in range(len(levels)):
            left = np.vdot(levels.reduced(level, x), g)
            assert left == pytest.approx(np.vdot(x, levels.reduced_adjoint(level, g)), rel=1e-4)
            assert np.vdot(levels.expanded(level, x), g) == np.vdot(
                x, levels.expanded_adjoint(level, g)
            )

    def test_blurs_are_means_of_what_counts(self, room: Room) -> None:
        unit = room.direction / np.linalg.norm(room.direction, axis=1)[:, None]
        levels = FaceLevels(unit, room.area * room.lit)
        light = np.where(room.lit, 0.4, 7.0).astype(np.float32)[None]
        np.testing.assert_allclose(levels.reduced(0, light)[0][room.lit], 0.4, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ("colours", ShapeError, "human eyes"),
        ("direction", ShapeError, "direction"),
        ("on a face", InputError, "the eyepoint lies on a face"),
        ("negative", UnitError, "weight: it must be 0 or more"),
        ("none", UnitError, "weight: it must be 0 or more"),
    ],
)
def test_what_is_refused(room: Room, change: str, error: type[Exception], message: str) -> None:
    target, direction, weight = room.dusk(), room.direction.copy(), room.area.copy()
    if change == "colours":
        target = target[:, :1]
    elif change == "direction":
        direction = direction[:-1]
    elif change == "on a face":
        direction[3] = 0
    else:
        weight = -weight if change == "negative" else 0 * weight
    with pytest.raises(error, match=message):
        room.compensator.perceptual(target, direction, weight)
