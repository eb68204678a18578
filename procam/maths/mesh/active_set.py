"""Direct light within limits on a screen of any shape, one colour (science.md s.1, s.5).

With Q = I - rho F (paper eq. 1) and N its inverse, total light is b = N b0. Both problems are fixed points of
maps that bring all points closer. Newton's step from the piece at hand is taken where it helps, else the
sure step: so the limits that hold, the active set, are found in a few steps from anywhere.

Steps are solved with the factors in single precision and judged in double, which makes each step also the
refinement of the one before.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg, gmres

from procam.errors import DidNotConverge

Array = NDArray[np.float64]
Light = Callable[[Array], Array]
ROWS = 256  # of the factors, made double at a time
STEPS = 200
EXACT = 1e-13  # of the light, that a balance may leave unaccounted for
SETTLED = 1e-12  # of the light, that a solution may still move
HELPS = 0.9  # of what was left, that a Newton step must get below
STEP = 1e-5  # relative accuracy of a step
INNER = 1e-6  # of the balances within one


@dataclass(frozen=True, slots=True)
class MeshRoom:
    """Faces that exchange light: `albedo` (N,) of one colour, `factors` (N, N) of `form_factors`."""

    albedo: Array
    factors: NDArray[np.floating]

    def once(self, light: Array) -> Array:
        """Light (N,) that the next bounce of light (N,) brings, rho F b."""
        gathered = [self.factors[at].astype(float) @ light for at in self._blocks()]
        return np.asarray(self.albedo * np.concatenate(gathered))

    def once_back(self, light: Array) -> Array:
        """The transpose of `once`."""
        given, back = self.albedo * light, np.zeros_like(light)
        for at in self._blocks():
            back += given[at] @ self.factors[at].astype(float)
        return back

    def all(self, direct: Array) -> Array:
        """Total light N b0 of direct light (N,)."""
        return _balance(direct, self.once, self._roughly)

    def all_back(self, light: Array) -> Array:
        """The transpose of `all`."""
        return _balance(light, self.once_back, self._roughly_back)

    def rough_once(self, light: Array) -> Array:
        """`once` in single precision."""
        return np.asarray(self.albedo * (self.factors @ light.astype(self.factors.dtype)))

    def rough_hessian(self, weight: Array) -> Light:
        """N^T W N in single precision."""
        return lambda light: self._roughly_back(weight * self._roughly(light))

    def _roughly(self, light: Array) -> Array:
        return _step(light, self.rough_once, INNER)

    def _roughly_back(self, light: Array) -> Array:
        def once(x: Array) -> Array:
            return np.asarray((self.albedo * x).astype(self.factors.dtype) @ self.factors)

        return _step(light, once, INNER)

    def _blocks(self) -> list[slice]:
        return [slice(at, at + ROWS) for at in range(0, len(self.factors), ROWS)]


def exact_light(room: MeshRoom, target: Array, lo: Array, hi: Array) -> Array:
    """Direct light (N,) that solves (P): b0 = clip(t - (N - I) b0, lo, hi), all arrays (N,).

    Notes
    -----
    Of the total light that is b = clip(t, lo + rho F b, hi + rho F b), whose right side moves by less than
    rho F |change|. Where neither limit holds b is the target; the others follow from (I - rho F) b = limit.

    Raises
    ------
    DidNotConverge
        If light still moves after many steps.
    """

    def sure(total: Array) -> Array:
        bounced = room.once(total)
        return np.asarray(np.clip(target, lo + bounced, hi + bounced))

    def newton(total: Array, after: Array) -> Array:
        held = after != target
        return total + _step(after - total, lambda x: held * room.rough_once(x), STEP)

    total = _settled(target, sure, newton, np.ones_like(target))
    return np.clip(target - room.once(total), lo, hi)


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """(W): the least sum w (N b0 - t)^2 within the limits; all arrays (N,).

    `curvature` are the sums of the rows of its Hessian N^T W N. Nothing in that is negative, so that it is
    no more than their diagonal (Gershgorin): a gradient step over them never goes too far, and brings all
    points closer.
    """

    room: MeshRoom
    target: Array
    weight: Array
    lo: Array
    hi: Array
    curvature: Array

    @classmethod
    def of(
        cls, room: MeshRoom, target: Array, weight: Array, lo: Array, hi: Array
    ) -> "LeastSquares":
        """The problem. Faces without weight are for those whose limits leave no choice."""
        rows = room.all_back(weight * room.all(np.ones_like(weight)))
        return cls(room, target, weight, lo, hi, np.where(rows > 0, rows, 1))

    def step(self, direct: Array) -> Array:
        """A step downhill from direct light (N,); only the solution stays where it is."""
        slope = self.room.all_back(self.weight * (self.room.all(direct) - self.target))
        return np.asarray(np.clip(direct - slope / self.curvature, self.lo, self.hi))

    def solve(self, start: Array) -> Array:
        """Direct light (N,) that solves it, from any.

        Raises
        ------
        DidNotConverge
            If light still moves after many steps.
        """
        return _settled(start, self.step, self._newton, self.curvature)

    def _newton(self, direct: Array, after: Array) -> Array:
        """From the limits that a step meets: what is free lies where the slope there is 0."""
        held = (after == self.lo) | (after == self.hi)
        moved, hessian = np.where(held, after - direct, 0), self.room.rough_hessian(self.weight)
        right = np.where(held, 0, self.curvature * (after - direct) - hessian(moved))
        size = 2 * (len(direct),)
        free = LinearOperator(size, lambda x: np.where(held, x, hessian(np.where(held, 0, x))))
        scale = LinearOperator(size, lambda x: np.where(held, x, x / self.curvature))
        return np.asarray(direct + moved + cg(free, right, rtol=STEP, M=scale)[0])


def _settled(
    start: Array, sure: Light, newton: Callable[[Array, Array], Array], weight: Array
) -> Array:
    """The point that `sure` leaves where it is."""

    def left(value: Array, after: Array) -> float:
        return float(np.sqrt(np.sum(weight * (after - value) ** 2)))

    value, after = start, sure(start)
    enough = SETTLED * float(np.sqrt(np.sum(weight * np.maximum(after**2, start**2))))
    for _ in range(STEPS):
        was = left(value, after)
        if was <= enough:
            return after
        trial = newton(value, after)
        following = sure(trial)
        if left(trial, following) > HELPS * was:
            trial, following = after, sure(after)
        value, after = trial, following
    raise DidNotConverge(
        f"compensation of a mesh: light still moves by {was:.3g} after {STEPS} steps, expected less "
        f"than {enough:.3g}; is an albedo next to 1?"
    )


def _balance(right: Array, once: Light, roughly: Light) -> Array:
    """Light x = right + once(x)."""
    light, enough = right, EXACT * float(np.abs(right).max())
    for _ in range(STEPS):
        left = right + once(light) - light
        if np.abs(left).max() <= enough:
            return light
        light = light + roughly(left)
    raise DidNotConverge(
        f"light between faces: got no balance after {STEPS} corrections, expected one after 3; is an "
        "albedo next to 1?"
    )


def _step(right: Array, once: Light, accuracy: float) -> Array:
    """Light x = right + once(x), about."""
    size = 2 * (len(right),)
    system = LinearOperator(size, matvec=lambda x: x - once(x), dtype=float)
    return np.asarray(gmres(system, right, rtol=accuracy, restart=30, maxiter=10)[0])
