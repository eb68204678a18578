"""Compensation on a screen of any shape, face by face: (P), (W) and perceptual, with dense transport.

Equations: docs/theory/compensation.md (C5), (C6).
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray
from procam.compensate.perceptual.faces import face_problem, face_target
from procam.compensate.perceptual.settings import Perceptual
from procam.errors import InputError, ShapeError, UnitError
from procam.maths.mesh.active_set import LeastSquares, MeshRoom, exact_light
from procam.maths.mesh.radiosity import check_gain

COLOURS = 3
FEWEST = 2  # faces between which there is contrast


@dataclass(frozen=True, slots=True)
class MeshCertificate:
    """How well light solves its problem, per colour (C,).

    Attributes
    ----------
    kkt : residual of the optimality conditions, relative to the largest target [-]. For (P) the
        largest |b0 - clip(t - scattered, lo, hi)|; for (W) the same of a gradient step.
    self_consistency : largest |b - b0 - rho F b| of the largest total light b [-].
    share_lo, share_hi : area at a limit, of the area whose light can be chosen.
    flux_in, flux_out : area times target, and times direct light [rel m2].
    """

    kkt: Array
    self_consistency: Array
    share_lo: Array
    share_hi: Array
    flux_in: Array
    flux_out: Array


@dataclass(frozen=True, slots=True)
class CompensatedMesh:
    """Light of the faces of a mesh, (N, C) each.

    Attributes
    ----------
    direct : light of the projectors [rel]. total : with all inter-reflections [rel].
    free : no limit holds; in (P) the total equals the target there.
    """

    direct: Array
    total: Array
    free: BoolArray
    certificate: MeshCertificate


class MeshCompensator:
    """Compensates light on the faces of one mesh.

    Parameters
    ----------
    factors : (N, N) of `form_factors`; kept, not copied.
    albedo : (N, C) [-], at least 0 and below 1.
    area_m2 : (N,) of the faces.
    lo, hi : (N, C) least and most direct light [rel]. Faces that no projector lights, such as floor
        and seats, have 0 for both: they only reflect light.

    Raises
    ------
    InputError
        Arrays of other shapes, values that are not finite or out of range, a room that absorbs no light.

    Examples
    --------
    Two plates that see half of each other; the second asks for less light than reaches it:

    >>> room = MeshCompensator(
    ...     np.array([[0.0, 0.5], [0.5, 0.0]]), np.full((2, 1), 0.8), np.ones(2),
    ...     lo=np.zeros((2, 1)), hi=np.ones((2, 1)),
    ... )
    >>> shown = room.exact(np.array([[0.5], [0.1]]))
    >>> shown.direct.ravel().round(3).tolist(), shown.total.ravel().round(3).tolist()
    ([0.42, 0.0], [0.5, 0.2])
    """

    def __init__(
        self, factors: FloatArray, albedo: Array, area_m2: Array, *, lo: Array, hi: Array
    ) -> None:
        _check_room(factors, albedo, area_m2)
        for name, limit in (("lo", lo), ("hi", hi)):
            _check_array(name, limit, albedo.shape)
        if (lo > hi).any():
            raise InputError(f"lo and hi: lo is above hi on {_count(lo > hi)}; are they swapped?")
        self._rooms = [MeshRoom(channel, factors) for channel in albedo.T]
        self._area_m2, self._lo, self._hi = area_m2, lo, hi

    def exact(self, target: Array) -> CompensatedMesh:
        """Light whose total is the target (N, C) [rel] wherever no limit holds: (P).

        Raises
        ------
        InputError
            A target that does not fit, or is not finite.
        DidNotConverge
            If the solution does not settle in many steps.
        """
        _check_array("target", target, self._lo.shape)
        direct, moved = np.empty(target.shape), np.empty(target.shape)
        for c, room in enumerate(self._rooms):
            wanted, lo, hi = target[:, c], self._lo[:, c], self._hi[:, c]
            direct[:, c] = exact_light(room, wanted, lo, hi)
            scattered = room.total(direct[:, c]) - direct[:, c]
            moved[:, c] = np.clip(wanted - scattered, lo, hi) - direct[:, c]
        return self._certified(target, direct, moved)

    def least_squares(self, target: Array, weight: Array | None = None) -> CompensatedMesh:
        """Light whose total has the least weighted squared error from the target (N, C): (W).

        `weight` (N,), by default the areas; 0 is allowed where nothing can be lit.

        Raises
        ------
        InputError
            A target or weights that do not fit, are not finite, below 0, or 0 where light can be chosen.
        DidNotConverge
            If the solution does not settle in many steps.
        """
        weight = self._area_m2 if weight is None else weight
        self._check_weight(weight)
        start = self.exact(target).direct
        direct, moved = np.empty(target.shape), np.empty(target.shape)
        for c, room in enumerate(self._rooms):
            lo, hi = self._lo[:, c], self._hi[:, c]
            problem = LeastSquares.of(room, target[:, c], weight, lo, hi)
            direct[:, c] = problem.solve(start[:, c])
            moved[:, c] = problem.step(direct[:, c]) - direct[:, c]
        return self._certified(target, direct, moved)

    def perceptual(
        self,
        target: Array,
        direction: Array,
        weight: Array | None = None,
        settings: Perceptual | None = None,
    ) -> CompensatedMesh:
        """(P) of the target within reach that costs the eye least (docs/theory/perceptual.md).

        Where (P) reaches all of the target (N, 3) [rel], that is its own solution.

        Parameters
        ----------
        direction : (N, 3) from the eyepoint to the faces, of any length.
        weight : (N,) of the faces for the eye, by default the areas of those whose light can be chosen.

        Raises
        ------
        InputError
            A target, directions or weights that do not fit, or are not finite; a target of other than
            three colours, or a direction of no length.
        DidNotConverge
            If the solution does not settle in many steps.
        """
        if target.ndim != 2 or target.shape[1] != COLOURS:
            raise ShapeError("target", target.shape, "(N, 3), since it is for human eyes")
        exact, settings = self.exact(target), settings or Perceptual()
        chosen = (self._lo < self._hi).any(axis=1)
        weight = self._area_m2 * chosen if weight is None else weight
        self._check_eyes(direction, weight)
        if exact.free[chosen].all() or np.count_nonzero(weight) < FEWEST:
            return exact
        unit = direction / np.linalg.norm(direction, axis=1)[:, None]
        limits, places = (self._lo, self._hi), (unit, weight)
        problem = face_problem(self._rooms, target, limits, places, settings.white_nits)
        found = face_target(problem, exact.direct.T.astype(np.float32), settings)
        return exact if found is None else self.exact(found.T.astype(float))

    def _check_eyes(self, direction: Array, weight: Array) -> None:
        _check_array("direction", direction, (len(self._area_m2), 3))
        _check_array("weight", weight, self._area_m2.shape)
        if (weight < 0).any() or not weight.any():
            raise UnitError("weight: it must be 0 or more, and above 0 on some faces")
        if (np.linalg.norm(direction, axis=1) == 0).any():
            raise InputError("direction: the eyepoint lies on a face; move it off the screen")

    def _certified(self, target: Array, direct: Array, moved: Array) -> CompensatedMesh:
        """The light (N, C) with its certificate; `moved` is the residual of its conditions."""
        rooms = list(enumerate(self._rooms))
        total = np.stack([room.total(direct[:, c]) for c, room in rooms], axis=1)
        again = np.stack([room.bounce(total[:, c]) for c, room in rooms], axis=1)
        choice = self._lo < self._hi
        at_lo, at_hi = choice & (direct <= self._lo), choice & (direct >= self._hi)
        chosen = np.maximum(self._area_m2 @ choice, np.finfo(float).tiny)
        certificate = MeshCertificate(
            kkt=_largest(moved) / _scale(target),
            self_consistency=_largest(total - direct - again) / _scale(total),
            share_lo=self._area_m2 @ at_lo / chosen,
            share_hi=self._area_m2 @ at_hi / chosen,
            flux_in=self._area_m2 @ target,
            flux_out=self._area_m2 @ direct,
        )
        return CompensatedMesh(direct, total, choice & ~at_lo & ~at_hi, certificate)

    def _check_weight(self, weight: Array) -> None:
        _check_array("weight", weight, self._area_m2.shape)
        if (weight < 0).any():
            raise UnitError(f"weight: the least is {weight.min():.3g}; none may be below 0")
        idle = (weight == 0)[:, None] & (self._lo < self._hi)
        if idle.any():
            raise InputError(
                f"weight: 0 on {_count(idle)} whose light can be chosen, which leaves it undetermined; "
                "give them a weight above 0"
            )


def _check_room(factors: FloatArray, albedo: Array, area_m2: Array) -> None:
    if factors.ndim != 2 or factors.shape[0] != factors.shape[1] or not len(factors):
        raise ShapeError("form factors", factors.shape, "(N, N), a row and a column for each face")
    faces = len(factors)
    if albedo.ndim != 2 or albedo.shape[0] != faces:
        raise ShapeError("albedo", albedo.shape, f"({faces}, C), a row for each face")
    _check_array("area_m2", area_m2, (faces,))
    if (area_m2 <= 0).any():
        raise UnitError(f"area_m2: the least is {area_m2.min():.3g}; areas must be above 0")
    _check_array("albedo", albedo, albedo.shape)
    if (albedo >= 1).any() or (albedo < 0).any():
        raise UnitError(
            f"albedo: {albedo.min():.3g} to {albedo.max():.3g} is not all within 0 <= albedo < 1; is it in "
            "percent?"
        )
    if not (np.isfinite(factors.sum(axis=1, dtype=float)).all() and factors.min() >= 0):
        raise InputError(
            "form factors: some are negative or not finite; compute them with form_factors"
        )
    check_gain(albedo, factors)


def _check_array(name: str, values: Array, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ShapeError(name, values.shape, f"{shape}")
    if not np.isfinite(values).all():
        raise InputError(
            f"{name}: NaN or infinity on {_count(~np.isfinite(values))}; fill unknown values first"
        )


def _count(where: BoolArray) -> str:
    return f"{np.count_nonzero(where)} of {where.size} values"


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).max(axis=0))


def _scale(values: Array) -> Array:
    return np.maximum(_largest(values), np.finfo(float).tiny)
