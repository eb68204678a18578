"""Operators of a room, and direct light where no limit, or every limit, holds."""

import mesh_shapes
import numpy as np
from tolerances import SOLVER

from procam.maths.mesh.active_set import LeastSquares, MeshRoom, exact_light
from procam.maths.mesh.form_factors import form_factors


def _room(rng: np.random.Generator) -> MeshRoom:
    vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 3)
    return MeshRoom(rng.uniform(0.2, 0.7, len(faces)), form_factors(vertices, faces))


def test_operators_and_their_transposes(rng: np.random.Generator) -> None:
    room = _room(rng)
    a, b = rng.uniform(size=(2, len(room.albedo)))
    np.testing.assert_allclose(a @ room.bounce(b), room.bounce_transposed(a) @ b, rtol=1e-12)
    np.testing.assert_allclose(a @ room.total(b), room.total_transposed(a) @ b, rtol=1e-10)
    np.testing.assert_allclose(room.total(b) - room.bounce(room.total(b)), b, atol=1e-11)


def test_without_limits_both_problems_reach_the_target(rng: np.random.Generator) -> None:
    room = _room(rng)
    target = rng.uniform(0.4, 0.6, len(room.albedo))
    wide = np.full_like(target, 10.0)
    direct = exact_light(room, target, -wide, wide)
    np.testing.assert_allclose(room.total(direct), target, atol=SOLVER)
    weight = rng.uniform(0.5, 1, len(target))
    problem = LeastSquares.of(room, target, weight, -wide, wide)
    np.testing.assert_allclose(problem.solve(0 * target), direct, atol=SOLVER)


def test_light_stays_within_limits(rng: np.random.Generator) -> None:
    room = _room(rng)
    target, lo = rng.uniform(0, 1, len(room.albedo)), np.full(len(room.albedo), 0.01)
    hi = np.full_like(lo, 0.3)
    direct = exact_light(room, target, lo, hi)
    assert (direct >= lo).all() and (direct <= hi).all()
    total, free = room.total(direct), (direct > lo) & (direct < hi)
    assert free.any() and not free.all()
    np.testing.assert_allclose(total[free], target[free], atol=SOLVER)
    assert (total[direct == hi] <= target[direct == hi] + SOLVER).all()
