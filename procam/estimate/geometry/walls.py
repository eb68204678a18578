"""Walls of a room that cameras do not see where its drawing has them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array
from procam.estimate.geometry.adjustment import Adjustment, RigProblem, prior_sigmas
from procam.estimate.geometry.fiducials import with_camera_errors
from procam.estimate.geometry.fits import agreeing, fitted
from procam.estimate.geometry.model import Observations, Pair, ParameterLayout, RigGeometry
from procam.maths.mesh.shape import MeshShape
from procam.maths.mesh.wall_moves import outwards

CONTRADICTS = (
    5.0  # standard deviations of chi squared, from which walls are not where they were drawn
)
EVEN_M = 1e-3  # rms over a wall


@dataclass(frozen=True, slots=True)
class MovedWall:
    """A wall that is not where it was drawn.

    `outwards_m` is by how much its mean is further out, with `sigma_m`; `most_m` the largest displacement
    on it, with `most_sigma_m`.
    """

    name: str
    outwards_m: float
    sigma_m: float
    most_m: float
    most_sigma_m: float


def with_walls(
    problem: RigProblem, few: Mapping[Pair, Observations], rig: RigGeometry
) -> tuple[RigProblem, RigGeometry]:
    """A room's problem with its marks' errors, and its rig, solved from one with walls that may move.

    They are as drawn unless that is contradicted.
    """
    marks = problem.fiducials
    problem = replace(problem, fiducials=with_camera_errors(rig, marks))
    moved = fitted(problem, few, rig)
    fit = Adjustment(problem, agreeing(moved, few), prior_sigmas(problem, moved))
    if not _contradicts_drawing(moved, fit.uncertainty(moved)[0]):
        moved = replace(moved, shape=problem.shape)
    problem = replace(problem, fiducials=with_camera_errors(moved, marks))
    return problem, fitted(problem, few, moved)


def _contradicts_drawing(rig: RigGeometry, covariance: Array) -> bool:
    """Whether the moves of a room's walls, with the rig's covariance (P, P), are more than chance.

    Walls are uneven by `EVEN_M`, so that angles known far better than that contradict nothing.
    """
    assert isinstance(rig.shape, MeshShape)
    moves = rig.shape.moves
    if not moves.size:
        return False
    own = ParameterLayout.of(rig).screen
    variance = covariance[own, own][2:, 2:]  # after the radius and the mesh itself
    variance = variance + (EVEN_M / rig.shape.radius_m) ** 2 * np.eye(moves.size)
    excess = moves @ np.linalg.solve(variance, moves) - moves.size
    return bool(excess > CONTRADICTS * np.sqrt(2 * moves.size))


def moved_walls(rig: RigGeometry, covariance: Array) -> list[MovedWall]:
    """The walls that were solved for, as they are."""
    shape = rig.shape
    if not isinstance(shape, MeshShape) or shape.mesh.moves is None or not shape.moves.any():
        return []
    own = ParameterLayout.of(rig).screen
    variance = covariance[own, own][2:, 2:] * shape.radius_m**2
    return [_moved_wall(shape, variance, part, name) for part, name in shape.free.items()]


def _moved_wall(shape: MeshShape, variance: Array, part: int, name: str) -> MovedWall:
    mesh = shape.mesh
    assert mesh.moves is not None
    own = mesh.moves.part == part
    ways = outwards(mesh.vertices, mesh.faces[shape.part == part], mesh.moves.numbers[own])
    by = shape.radius_m * shape.moves[own] @ ways
    mean, there = ways.mean(axis=1), ways[:, np.abs(by).argmax()]
    sigma, most = (np.sqrt(way @ variance[np.ix_(own, own)] @ way) for way in (mean, there))
    return MovedWall(name, float(by.mean()), float(sigma), float(np.abs(by).max()), float(most))
