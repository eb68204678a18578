"""The closed loop on patches of any screen: state update, next picture, stop criteria.

The model is y = N_c (x + d) + noise with N_c = I + c U V^T (docs/theory/closed-loop.md, L1): x is the direct
light asked for, y what is seen, U V^T the calibrated scatter, c a factor per channel and d the surplus
light of each patch. `LoopState.learn` splits the difference between a photograph and its prediction in
two: a common brightness and a common change of c, fitted to all patches at once and applied in full; and
the rest, applied per patch with decreasing weight, so that the camera's noise is averaged. The next
picture (`LoopState.step`) respects the limits of the projectors. Differences are judged in just
noticeable differences (JND).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import OutOfModelRange
from procam.estimate.closed_loop.scatter import Scatter

WHITE_NITS = 14.0  # luminance of white of a bright dome; the brighter, the smaller the JND
WEBER, BRIGHT_NITS = 0.007, 10.0  # Weber fraction from this luminance on
WEBER_DARK, DARK_NITS = 0.04, 0.1  # Weber fraction at the lowest luminance
FULL_STEPS = 2  # the second corrects what the first missed because gains were wrong
MAX_CORRECTIONS = 4  # corrections of one loop
MIN_PHOTOGRAPHS, MAX_PHOTOGRAPHS = 4, 16  # of a picture; four also give their noise
TWO_SIDED = 1.96  # sigmas within which 95 % of a normal distribution lies
CELL_QUANTILE = 0.95  # share of the patches that a statement covers
AVERAGED = 8  # a residual below the noise of the mean of so many photographs is not corrected
VISIBLE_JND = 0.5  # a smaller residual is not corrected
NOTICED_JND = 1.0  # a residual that grows to less is no regression: it is invisible
TINY = 1e-6  # of white
MIN_PATCHES = 30  # of a neighbourhood that is judged
SIGNIFICANT_SIGMAS, STRAY_SIGMA = 3.0, 0.005  # of a change of c; relative, by lens stray light
GAIN_SIGMA, SCATTER_SIGMA = 0.05, 0.1  # relative: priors of changes since the calibration


def just_noticeable(light: Array) -> Array:
    """One just noticeable difference (...) [rel] of light (...) [rel], by Weber fractions.

    0.7 % at 10 cd/m2 and above, rising to 4 % at 0.1, linear in both logarithms; below 0.1 cd/m2 the
    absolute difference is constant. White is assumed to have `WHITE_NITS`.

    >>> [round(float(v), 5) for v in just_noticeable(np.array([1.0, 0.0]))]
    [0.007, 0.00029]
    """
    nits = np.maximum(light * WHITE_NITS, DARK_NITS)
    dark = np.clip(np.log(BRIGHT_NITS / nits) / np.log(BRIGHT_NITS / DARK_NITS), 0, 1)
    return np.asarray(WEBER * (WEBER_DARK / WEBER) ** dark * nits / WHITE_NITS)


@dataclass(frozen=True, slots=True)
class LoopObservation:
    """A picture that was shown, and the mean of its photographs.

    Attributes
    ----------
    asked : (n, C) direct light [rel]. seen : (n, C) mean of `photographs` [rel].
    sigma : (n, C) standard error of `seen`, stray light included [rel]. known : (n, C) valid patches.
    """

    asked: Array
    seen: Array
    sigma: Array
    known: BoolArray
    photographs: int


class LoopState:
    """Estimates of the closed loop, updated by each observation.

    Parameters
    ----------
    scatter : as calibrated.
    block : (n,) neighbourhood of each patch. Errors within a neighbourhood are correlated, so the errors
        of common quantities come from a jackknife over blocks.
    scatter_sigma : (C,) relative standard error of the calibrated scatter [-].
    low_pass : function of (n, C) and the known patches (n, C), applied to the update of `surplus`.

    Attributes
    ----------
    surplus : (n, C) d, direct light beyond what is asked [rel].
    scatter_factor : (C,) c, scattered light over that of the calibration.
    steps : observations so far.
    """

    def __init__(
        self,
        scatter: Scatter,
        block: IndexArray,
        scatter_sigma: Array,
        low_pass: Callable[[Array, BoolArray], Array] = lambda light, _: light,
    ) -> None:
        self.surplus = np.zeros((len(block), len(scatter_sigma)))
        self.scatter_factor = np.ones(len(scatter_sigma))
        self.steps = self._averaged = 0
        self._scatter_sigma = scatter_sigma
        self._scatter, self._block, self._low_pass = scatter, block, low_pass

    def expected(self, asked: Array) -> Array:
        """Predicted total light (n, C) [rel] for direct light (n, C) asked for."""
        direct = asked + self.surplus
        return np.asarray(direct + self.scatter_factor * self._scatter.of(direct))

    def learn(self, observation: LoopObservation) -> None:
        """Update the estimates by the difference between an observation and its prediction."""
        direct, known = observation.asked + self.surplus, observation.known
        scattered = self.scatter_factor * self._scatter.of(direct)
        residual = np.where(known, observation.seen - direct - scattered, 0)
        share = self._share(observation.photographs)
        own = np.empty_like(residual)
        for c in range(residual.shape[1]):
            sigma = np.hypot(observation.sigma[:, c], GAIN_SIGMA * direct[:, c])
            weight = known[:, c] / np.maximum(sigma, TINY) ** 2
            total = (direct + scattered)[:, c]
            errors = common_errors(residual[:, c], total, scattered[:, c], weight, self._block)
            bright, change = posterior(*errors, self._scatter_sigma[c])
            common = bright * total + change * scattered[:, c]
            own[:, c] = np.where(known[:, c], residual[:, c] - common, 0)
            self.scatter_factor[c] *= 1 + change / (1 + bright)
            self.surplus[:, c] += bright * direct[:, c]
        own = share * self._low_pass(own, known)
        self.surplus += self._scatter.removed(own, known, self.scatter_factor)

    def step(self, asked: Array, goal: Array, down: Array, up: Array) -> Array:
        """Change (n, C) of the direct light asked for that moves the total nearest to `goal` (n, C).

        `down` and `up` (n, C), 0 or more, limit the change. Patches at a limit are held, and the others
        cancel the scatter of their own change (`remove_scatter`). Which patches are held follows from
        (C2) of docs/theory/compensation.md in the changes.
        """
        return self._scatter.limited(goal - self.expected(asked), down, up, self.scatter_factor)

    def _share(self, photographs: int) -> float:
        """Share of the patches' own residual that is applied.

        `FULL_STEPS` steps apply it in full. After that every photograph has the same weight, so that
        noise falls as one over the square root of their number.
        """
        self.steps += 1
        if self.steps <= FULL_STEPS:
            self._averaged = 0
        self._averaged += photographs
        return photographs / self._averaged


def common_errors(
    residual: Array, light: Array, scattered: Array, weight: Array, block: IndexArray
) -> tuple[Array, Array]:
    """Common relative errors (brightness, scatter) (2,) of a residual (n,), and their covariance (2, 2).

    Weighted least squares of residual = brightness * light + scatter * scattered + errors of patches,
    all (n,), weights inverse variances. The covariance is a jackknife over blocks: a smooth error of the
    gains that resembles scattered light differs from block to block.
    """
    rows = np.stack([light, scattered], axis=1)
    blocks = int(block.max()) + 1
    normal, right = np.zeros((blocks, 2, 2)), np.zeros((blocks, 2))
    for i in range(2):
        right[:, i] = np.bincount(block, weight * rows[:, i] * residual, blocks)
        for j in range(2):
            normal[:, i, j] = np.bincount(block, weight * rows[:, i] * rows[:, j], blocks)
    prior = np.diag([GAIN_SIGMA**-2, SCATTER_SIGMA**-2])
    found = np.linalg.solve(normal.sum(axis=0) + prior, right.sum(axis=0))
    used = np.trace(normal, axis1=1, axis2=2) > 0
    without = np.linalg.solve(
        normal.sum(axis=0) - normal[used] + prior, (right.sum(axis=0) - right[used])[..., None]
    )[..., 0]
    apart = without - found
    return found, max(len(apart) - 1, 0) / max(len(apart), 1) * apart.T @ apart


def posterior(found: Array, covariance: Array, scatter_sigma: float) -> tuple[float, float]:
    """Posterior common errors (brightness, scatter) from fitted ones (2,) and their covariance (2, 2).

    The scatter is taken as unchanged unless the change exceeds three standard errors, those of the
    calibration (`scatter_sigma`) and of lens stray light included. A significant change, as by an
    audience, is shrunk by its own variance.
    """
    prior = np.diag([GAIN_SIGMA**2, SCATTER_SIGMA**2])
    sigma = np.sqrt(covariance[1, 1] + scatter_sigma**2 + STRAY_SIGMA**2)
    if abs(found[1]) <= SIGNIFICANT_SIGMAS * sigma:
        slope = covariance[0, 1] / max(covariance[1, 1], TINY**2)
        bright = found[0] - slope * found[1]
        variance = max(covariance[0, 0] - slope * covariance[0, 1], 0.0)
        return float(bright * prior[0, 0] / (prior[0, 0] + variance)), 0.0
    bright, scatter = prior @ np.linalg.solve(prior + covariance, found)
    return float(bright), float(scatter)


def photographs_needed(sigma: Array, light: Array) -> int:
    """Number of photographs of each picture that resolves 1 JND of `light` (n,) in 95 % of the patches.

    `sigma` (n,) is the standard error of one photograph [rel].

    Raises
    ------
    OutOfModelRange
        If all photographs of a loop cannot resolve 1 JND in half of the patches.
    """
    error_jnd = TWO_SIDED * sigma / just_noticeable(light)
    half = float(np.median(error_jnd)) ** 2
    if half > MAX_PHOTOGRAPHS * MAX_CORRECTIONS:
        raise OutOfModelRange(
            f"closed loop: one photograph is uncertain by {np.sqrt(half):.2g} JND in half of the dome; it "
            f"needs at most {np.sqrt(MAX_PHOTOGRAPHS * MAX_CORRECTIONS):.2g}, so open the aperture, "
            "expose longer, or refine on a brighter picture"
        )
    wanted = np.ceil(np.quantile(error_jnd, CELL_QUANTILE) ** 2)
    return int(np.clip(wanted, MIN_PHOTOGRAPHS, MAX_PHOTOGRAPHS))


def residual_without_noise(residual: Array, sigma: Array, photographs: int) -> float:
    """Root mean square [rel] of `residual` (n,), less the noise of the mean of `photographs`."""
    return float(np.sqrt(max(float(np.mean(residual**2 - sigma**2 / photographs)), 0.0)))


def residual_jnd(residual: Array, light: Array) -> float:
    """95 % quantile of `residual` (n,) in JND of `light` (n,)."""
    return float(np.quantile(np.abs(residual) / just_noticeable(light), CELL_QUANTILE))


def converged(residual: Array, sigma: Array, light: Array, photographs: int) -> bool:
    """Whether to stop: 95 % of the residual is invisible, or it is less than noise."""
    noise = float(np.sqrt(np.mean(sigma**2) / AVERAGED))
    unseen = residual_jnd(residual, light) <= VISIBLE_JND
    return unseen or residual_without_noise(residual, sigma, photographs) <= noise


@dataclass(frozen=True, slots=True)
class Regression:
    """A neighbourhood `place` (n,) whose rms residual grew from `before` to `after` [JND]."""

    place: BoolArray
    channel: int
    before: float
    after: float


def largest_regression(
    first: Array, last: Array, noise: Array, judged: BoolArray, block: IndexArray
) -> Regression | None:
    """The neighbourhood and channel with the largest regression, None without a visible one.

    `first`, `last` (n, C) are residuals and `noise` (n, C) their standard error, in JND; `judged` (n, C)
    selects patches. A regression exceeds three sigmas and one JND.
    """
    found: Regression | None = None
    for c in range(first.shape[1]):
        for number in np.unique(block[judged[:, c]]):
            place = judged[:, c] & (block == number)
            if place.sum() < MIN_PATCHES:
                continue
            known = float(np.mean(noise[place, c] ** 2))
            before = float(np.mean(first[place, c] ** 2)) - known
            after = float(np.mean(last[place, c] ** 2)) - known
            sigmas = SIGNIFICANT_SIGMAS * np.sqrt(2 / place.sum())
            limit = sigmas * (known + max(before, after, 0))
            if after - max(before, NOTICED_JND**2) > limit and (
                found is None or after > found.after**2
            ):
                found = Regression(place, c, np.sqrt(max(before, 0)), np.sqrt(after))
    return found
