"""The perceptual target on the faces of a mesh, at their own resolution."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from procam.arrays import Array, Array32
from procam.compensate.perceptual.bounds import (
    NEGLIGIBLE,
    Allowance,
    hue_limited,
    limited_places,
    mixed,
)
from procam.compensate.perceptual.descent import Descent, Problem
from procam.compensate.perceptual.objective import Contrast, Guard
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import RATE, STEPS
from procam.errors import InputError
from procam.maths.mesh.active_set import MeshRoom
from procam.maths.vision.pyramid import LOWEST

DIGITS = 6  # of directions: what is nearer is the same
REACH = 3.0  # standard deviations of a blur that count
PEAK = 0.153  # cycles per standard deviation that pass best between two blurs, one twice as wide


class FaceLevels:
    """Faces and ever wider blurs of them, all at the same faces; see `objective.Levels`.

    Parameters
    ----------
    direction : (N, 3) unit vectors to the faces from the eyepoint. weight : (N,), 0 where a face does not
        count.
    """

    def __init__(self, direction: Array, weight: Array) -> None:
        spacing = _spacing(direction[weight > 0])
        self._spacing_deg, self._blurs = float(np.degrees(spacing)), list[csr_array]()
        while not self._blurs or self.frequency(len(self._blurs) - 1) > LOWEST:
            wider = spacing * 2.0 ** len(self._blurs)
            known = wider / 2 if self._blurs else 0
            self._blurs.append(_blur(direction, weight, float(np.sqrt(wider**2 - known**2))))

    def __len__(self) -> int:
        return len(self._blurs)

    def frequency(self, level: int) -> float:
        """What is lost from a level to the next [cycles per degree at the eyepoint]."""
        if level == 0:
            return 0.5 / self._spacing_deg
        return PEAK / (self._spacing_deg * 2.0 ** (level - 1))

    def blurred(self, level: int, plane: Array32) -> Array32:
        """A plane (N,) over the reach of masking."""
        return np.asarray(self._blurs[level] @ plane, np.float32)

    def reduced(self, level: int, planes: Array32) -> Array32:
        """From a level to the next (C, N)."""
        return np.asarray((self._blurs[level] @ planes.T).T, np.float32)

    def expanded(self, level: int, planes: Array32) -> Array32:
        """All levels have the same faces."""
        return planes

    def reduced_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `reduced`."""
        return np.asarray((self._blurs[level].T @ slope.T).T, np.float32)

    def expanded_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `expanded`."""
        return slope


def _spacing(direction: Array) -> float:
    """Median distance of unit vectors (N, 3) from their nearest neighbours elsewhere [rad]."""
    places = np.unique(direction.round(DIGITS), axis=0)
    if len(places) < 2:
        raise InputError(
            "direction: all faces lie in one direction from the eyepoint; check the directions"
        )
    distance = np.asarray(cKDTree(places).query(places, k=2)[0])
    return float(np.median(distance[:, 1]))


def _blur(direction: Array, weight: Array, sigma: float) -> csr_array:
    """(N, N): weighted mean about each face, Gaussian in the chord of the angle [rad]."""
    tree = cKDTree(direction)
    near = tree.sparse_distance_matrix(tree, REACH * sigma, output_type="coo_matrix")
    reach = np.exp(-0.5 * (near.data / sigma) ** 2) * weight[near.col]
    rows = csr_array((reach, (near.row, near.col)), shape=near.shape)
    total = np.maximum(rows.sum(axis=1), np.finfo(np.float32).tiny)
    rows.data /= np.repeat(total, np.diff(rows.indptr))
    return rows.astype(np.float32)


class RoomTransport:
    """Transport between the faces of a mesh, per colour; see `descent.Transport`."""

    def __init__(self, rooms: Sequence[MeshRoom]) -> None:
        self._rooms = rooms

    def total(self, direct: Array32) -> Array32:
        """Total light (C, N)."""
        pairs = zip(self._rooms, direct.astype(float), strict=True)
        return np.array([room.total(light) for room, light in pairs], np.float32)

    def adjoint(self, slope: Array32) -> Array32:
        """Slopes over direct light (C, N), from those over total light."""
        pairs = zip(self._rooms, slope.astype(float), strict=True)
        return np.array([room.total_transposed(s) for room, s in pairs], np.float32)


def face_target(problem: Problem, exact: Array32, settings: Perceptual) -> Array32 | None:
    """Total light (3, N) for (P) to solve, from its solution `exact` (3, N); None: that is the best."""
    first = problem.transport.total(exact)
    most = problem.guard.of(first)[0] * settings.allowed
    if most <= NEGLIGIBLE:
        return None
    found = Descent(problem, first - exact).run(exact, most, STEPS, RATE)
    guard = problem.guard
    places = limited_places(exact, problem.lo, problem.hi, guard.weight)
    last = problem.transport.total(hue_limited(problem, first, places, found))
    allowance = Allowance(partial(mixed, first, last), guard.target, guard.weight, places, settings)
    total = mixed(first, last, allowance.share())
    better = problem.contrast.value(total) < problem.contrast.value(first)
    return total if better else None


def face_problem(
    rooms: Sequence[MeshRoom],
    target: Array,
    limits: tuple[Array, Array],
    places: tuple[Array, Array],
    white_nits: float,
) -> Problem:
    """To show a target (N, 3) within limits (N, 3), on faces in directions (N, 3) of weights (N,)."""
    direction, weight = places
    lo, hi = (np.ascontiguousarray(limit.T, np.float32) for limit in limits)
    wanted = np.ascontiguousarray(target.T, np.float32)
    share = (weight / weight.sum()).astype(np.float32)
    contrast = Contrast(FaceLevels(direction, weight), wanted, share, white_nits)
    return Problem(contrast, Guard(wanted, share, white_nits), RoomTransport(rooms), lo, hi)
