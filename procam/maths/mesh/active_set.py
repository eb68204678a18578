"""Direct light within limits on a screen of any shape, one colour (docs/theory/compensation.md (C5)).

With N = (I - rho F)^-1 (docs/theory/interreflection.md (I3)) the total light is b = N b0. Problem (P)
asks for the target wherever no limit holds, problem (W) for the least weighted squared error. Both
are fixed points of contractions. Each iteration tries a Newton step for the active set of the
contraction's result and keeps it if it reduces the residual; otherwise it takes the contraction's
own step, which converges from any start.

The systems within a step are solved in single precision and their residuals evaluated in double, so
each step also refines the previous one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg, gmres

from procam.arrays import Array, FloatArray
from procam.errors import DidNotConverge

Operator = Callable[[Array], Array]
ROWS = 256  # of the form factors, converted to double at a time
STEPS = 200
BALANCED = 1e-13  # of the largest light: residual of an interreflection solve
CONVERGED = 1e-12  # of the light: change at which an iteration ends
REDUCTION = 0.9  # of the residual, below which a Newton step is kept
NEWTON_ACCURACY = 1e-5  # relative
INNER_ACCURACY = 1e-6  # relative, of the interreflection solves within a Newton step


@dataclass(frozen=True, slots=True)
class MeshRoom:
    """Faces that exchange light: `albedo` (N,) of one colour, `factors` (N, N) of `form_factors`."""

    albedo: Array
    factors: FloatArray

    def bounce(self, light: Array) -> Array:
        """The next bounce rho F b (N,) of light (N,)."""
        gathered = [self.factors[at].astype(float) @ light for at in self._blocks()]
        return np.asarray(self.albedo * np.concatenate(gathered))

    def bounce_transposed(self, light: Array) -> Array:
        """The transpose of `bounce`."""
        weighted, back = self.albedo * light, np.zeros_like(light)
        for at in self._blocks():
            back += weighted[at] @ self.factors[at].astype(float)
        return back

    def total(self, direct: Array) -> Array:
        """Total light N b0 (N,) of direct light (N,)."""
        return _solve(direct, self.bounce, self._total_single)

    def total_transposed(self, light: Array) -> Array:
        """The transpose of `total`."""
        return _solve(light, self.bounce_transposed, self._total_transposed_single)

    def bounce_single(self, light: Array) -> Array:
        """`bounce` in single precision."""
        return np.asarray(self.albedo * (self.factors @ light.astype(self.factors.dtype)))

    def hessian_single(self, weight: Array) -> Operator:
        """N^T W N in single precision."""
        return lambda light: self._total_transposed_single(weight * self._total_single(light))

    def _total_single(self, light: Array) -> Array:
        return _step(light, self.bounce_single, INNER_ACCURACY)

    def _total_transposed_single(self, light: Array) -> Array:
        def bounce(x: Array) -> Array:
            return np.asarray((self.albedo * x).astype(self.factors.dtype) @ self.factors)

        return _step(light, bounce, INNER_ACCURACY)

    def _blocks(self) -> list[slice]:
        return [slice(at, at + ROWS) for at in range(0, len(self.factors), ROWS)]


def exact_light(room: MeshRoom, target: Array, lo: Array, hi: Array) -> Array:
    """Direct light (N,) that solves (P): b0 = clip(t - (N - I) b0, lo, hi), all arrays (N,).

    Notes
    -----
    In total light this is b = clip(t, lo + rho F b, hi + rho F b) (docs/theory/compensation.md (C5)).
    The right side changes by less than rho F |change of b|, so it is a contraction. Where no limit
    holds b is the target; the other faces follow from (I - rho F) b = limit.

    Raises
    ------
    DidNotConverge
        If the light still changes after `STEPS` steps.
    """

    def contraction(total: Array) -> Array:
        scattered = room.bounce(total)
        return np.asarray(np.clip(target, lo + scattered, hi + scattered))

    def newton(total: Array, after: Array) -> Array:
        held = after != target
        return total + _step(after - total, lambda x: held * room.bounce_single(x), NEWTON_ACCURACY)

    total = _fixed_point(target, contraction, newton, np.ones_like(target))
    return np.clip(target - room.bounce(total), lo, hi)


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """Problem (W): the least sum of w (N b0 - t)^2 within the limits; all arrays (N,).

    `curvature` is the row sums of the Hessian N^T W N, whose entries are not negative. By
    Gershgorin's theorem they bound its eigenvalues, so a gradient step divided by `curvature` is a
    contraction (docs/theory/compensation.md (C6)).
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
        """The problem; a weight of 0 is only allowed on faces where lo = hi."""
        rows = room.total_transposed(weight * room.total(np.ones_like(weight)))
        return cls(room, target, weight, lo, hi, np.where(rows > 0, rows, 1))

    def step(self, direct: Array) -> Array:
        """A projected gradient step from direct light (N,); its fixed point is the solution."""
        slope = self.room.total_transposed(self.weight * (self.room.total(direct) - self.target))
        return np.asarray(np.clip(direct - slope / self.curvature, self.lo, self.hi))

    def solve(self, start: Array) -> Array:
        """Direct light (N,) that solves the problem, from any start.

        Raises
        ------
        DidNotConverge
            If the light still changes after `STEPS` steps.
        """
        return _fixed_point(start, self.step, self._newton, self.curvature)

    def _newton(self, direct: Array, after: Array) -> Array:
        """Faces that the gradient step puts on a limit stay there; the others get gradient 0."""
        held = (after == self.lo) | (after == self.hi)
        moved, hessian = np.where(held, after - direct, 0), self.room.hessian_single(self.weight)
        right = np.where(held, 0, self.curvature * (after - direct) - hessian(moved))
        size = 2 * (len(direct),)
        free = LinearOperator(size, lambda x: np.where(held, x, hessian(np.where(held, 0, x))))
        scale = LinearOperator(size, lambda x: np.where(held, x, x / self.curvature))
        return np.asarray(direct + moved + cg(free, right, rtol=NEWTON_ACCURACY, M=scale)[0])


def _fixed_point(
    start: Array, contraction: Operator, newton: Callable[[Array, Array], Array], weight: Array
) -> Array:
    """The fixed point of `contraction`; residuals are weighted norms of its steps."""

    def residual(value: Array, after: Array) -> float:
        return float(np.sqrt(np.sum(weight * (after - value) ** 2)))

    value, after = start, contraction(start)
    enough = CONVERGED * float(np.sqrt(np.sum(weight * np.maximum(after**2, start**2))))
    for _ in range(STEPS):
        before = residual(value, after)
        if before <= enough:
            return after
        trial = newton(value, after)
        following = contraction(trial)
        if residual(trial, following) > REDUCTION * before:
            trial, following = after, contraction(after)
        value, after = trial, following
    raise DidNotConverge(
        f"compensation of a mesh: the light still changes by {before:.3g} after {STEPS} steps, where "
        f"{enough:.3g} would do. Check that no albedo is close to 1."
    )


def _solve(right: Array, bounce: Operator, solve_single: Operator) -> Array:
    """Solve x = right + bounce(x) by iterative refinement of single-precision solutions."""
    light, enough = right, BALANCED * float(np.abs(right).max())
    for _ in range(STEPS):
        residual = right + bounce(light) - light
        if np.abs(residual).max() <= enough:
            return light
        light = light + solve_single(residual)
    raise DidNotConverge(
        f"light between faces: no solution after {STEPS} corrections, where 3 are usual. Check that no "
        "albedo is close to 1."
    )


def _step(right: Array, bounce: Operator, accuracy: float) -> Array:
    """Solve x = right + bounce(x) to a relative accuracy."""
    size = 2 * (len(right),)
    system = LinearOperator(size, matvec=lambda x: x - bounce(x), dtype=float)
    return np.asarray(gmres(system, right, rtol=accuracy, restart=30, maxiter=10)[0])
