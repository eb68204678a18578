"""The closed loop on patches of any dome: what a photograph teaches, and what to show next (science.md s.6).

What is seen is N (x + d) + noise for asked direct light x: N the bounces, known but for a factor, d what
lands more or less than asked. A photograph tells both: the factor and a common brightness from all
patches at once, so fast; d patch by patch, so slowly, or the camera's noise would become the picture's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import OutOfModelRange
from procam.maths.light.box_solver import solve_moments

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WHITE_NITS = 14.0  # of a bright dome (science.md s.7): the brighter, the finer the eye
WEBER, BRIGHT_NITS = 0.007, 10.0
WEBER_DARK, DARK_NITS = 0.04, 0.1
WHOLE_STEPS = 2  # the first finds the error, the second what the first missed for wrong gains
MAX_CORRECTIONS = 4  # corrections of one loop
MIN_PHOTOGRAPHS, MOST = 4, 16  # photographs of a picture: four also tell their own noise
TWO_SIDED = 1.96  # sigmas within which 95 % of a normal distribution lies
CELL_QUANTILE = 0.95  # of the patches must be as good as is told
AVERAGED = 8  # a residual below the noise of so many photographs' mean is left alone
VISIBLE_JND = 0.5  # of which no one will see more, if it is corrected
TINY = 1e-6  # of white
FEWEST_PATCHES = 30  # of a neighbourhood, for its mean to be judged
CLEAR_SIGMAS, STRAY_DOUBT = 3.0, 0.005  # of bounced light
GAIN_DOUBT, SCATTER_DOUBT = 0.05, 0.1  # one sigma of what may have moved since the calibration


def just_noticeable(light: Array) -> Array:
    """Smallest difference that is seen (...) [rel] of light (...) [rel]: one Weber JND.

    .7 % at 10 cd/m2 and above, rising to 4 % at .1, straight in the logarithms of both; below, what
    it is at .1. White is taken for `WHITE_NITS`.

    >>> [round(float(v), 5) for v in just_noticeable(np.array([1.0, 0.0]))]
    [0.007, 0.00029]
    """
    nits = np.maximum(light * WHITE_NITS, DARK_NITS)
    dark = np.clip(np.log(BRIGHT_NITS / nits) / np.log(BRIGHT_NITS / DARK_NITS), 0, 1)
    return np.asarray(WEBER * (WEBER_DARK / WEBER) ** dark * nits / WHITE_NITS)


def remove_scatter(change: Array, free: Mask, spread: Array, collect: Array) -> Array:
    """Direct light (n,) on the `free` patches (n,) alone that changes what is seen there by `change` (n,).

    dx_F = r_F - U_F (I + V_F^T U_F)^-1 V_F^T r_F for bounces U V^T, `spread` and `collect` (n, K); the
    others are held and only reflect. On a sphere it is r_F - rho_F (a_F.r_F) / (A_s - sum of a rho over all
    that is not free), of science.md s.6.
    """
    system = np.eye(collect.shape[1]) + collect[free].T @ spread[free]
    caught = np.linalg.solve(system, collect[free].T @ change[free])
    return np.where(free, change - spread @ caught, 0.0)


@dataclass(frozen=True, slots=True)
class PatchScatter:
    """Bounced light of C channels on n patches: `spread` (C, n, K), `collect` (n, K), b+ = U V^T b0."""

    spread: Array
    collect: Array

    def of(self, direct: Array) -> Array:
        """Bounced light (n, C) [rel] of direct light (n, C)."""
        return np.einsum("cnk,kc->nc", self.spread, self.collect.T @ direct)


@dataclass(frozen=True, slots=True)
class LoopObservation:
    """A picture as it was asked for and as it was seen.

    Attributes
    ----------
    asked : (n, C) direct light [rel]. seen : (n, C) mean of `photographs` [rel].
    doubt : (n, C) standard error of `seen` as light of the patch alone [rel]. known : (n, C) patches that
        it tells of.
    """

    asked: Array
    seen: Array
    doubt: Array
    known: Mask
    photographs: int


class LoopState:
    """What the loop believes of a dome; every look teaches it.

    Parameters
    ----------
    bounces : as calibrated. block : (n,) which neighbourhood each patch is in; errors of a
        neighbourhood go together, and what looks common to all is believed as far as the blocks agree.
    scatter_sigma : (C,) relative standard error of bounced light as calibrated [-].
    low_pass : takes (n, C) and the known patches (n, C) and gives what is kept of it.

    Attributes
    ----------
    surplus : (n, C) d, light that lands beyond what is asked [rel].
    scatter_factor : (C,) bounced light over that of the calibration.
    """

    def __init__(
        self,
        bounces: PatchScatter,
        block: NDArray[np.intp],
        scatter_sigma: Array,
        low_pass: Callable[[Array, Mask], Array] = lambda light, _: light,
    ) -> None:
        channels, patches, _ = bounces.spread.shape
        self.surplus = np.zeros((patches, channels))
        self.scatter_factor = np.ones(channels)
        self.steps = self._averaged = 0
        self._scatter_sigma = scatter_sigma
        self._bounces, self._block, self._low_pass = bounces, block, low_pass

    def expected(self, asked: Array) -> Array:
        """What should be seen (n, C) [rel] of direct light (n, C) that is asked for."""
        landing = asked + self.surplus
        return np.asarray(landing + self.scatter_factor * self._bounces.of(landing))

    def learn(self, look: LoopObservation) -> None:
        """Fold what was not expected into the belief.

        Two steps take the patches' own part whole; from then on each photograph weighs the same, so that
        noise falls as one over the root of their number.
        """
        landing = look.asked + self.surplus
        bounced = self.scatter_factor * self._bounces.of(landing)
        news = np.where(look.known, look.seen - landing - bounced, 0)
        share = self._share(look.photographs)
        own = np.empty_like(news)
        for c in range(news.shape[1]):
            own_doubt = np.hypot(look.doubt[:, c], GAIN_DOUBT * landing[:, c])
            weight = look.known[:, c] / np.maximum(own_doubt, TINY) ** 2
            errors = common_errors(
                news[:, c], (landing + bounced)[:, c], bounced[:, c], weight, self._block
            )
            bright, scatter = posterior(*errors, self._scatter_sigma[c])
            fast = bright * (landing + bounced)[:, c] + scatter * bounced[:, c]
            own[:, c] = np.where(look.known[:, c], news[:, c] - fast, 0)
            self.scatter_factor[c] *= 1 + scatter / (1 + bright)
            self.surplus[:, c] += bright * landing[:, c]
        own = share * self._low_pass(own, look.known)
        for c, factor in enumerate(self.scatter_factor):
            spread = factor * self._bounces.spread[c]
            self.surplus[:, c] += remove_scatter(
                own[:, c], look.known[:, c], spread, self._bounces.collect
            )

    def step(self, asked: Array, goal: Array, down: Array, up: Array) -> Array:
        """Change (n, C) of the direct light asked for that brings the goal (n, C) nearest.

        `down` and `up` (n, C), 0 or more: how far each patch can go. Patches at a limit that pulls them
        further are held, the others undo the bounces of their own change (`remove_scatter`): which are
        which is found by Newton's method, as problem (P) of science.md s.5 in the changes.
        """
        wanted = goal - self.expected(asked)
        change = np.empty_like(wanted)
        for c, factor in enumerate(self.scatter_factor):
            spread, collect = factor * self._bounces.spread[c], self._bounces.collect
            limits = -down[:, c], up[:, c]
            caught = solve_moments(wanted[:, c], spread, collect, *limits)
            change[:, c] = np.clip(wanted[:, c] - spread @ caught, *limits)
        return change

    def _share(self, photographs: int) -> float:
        """Share of a look's news that is believed of single patches."""
        self.steps += 1
        if self.steps <= WHOLE_STEPS:
            self._averaged = 0
        self._averaged += photographs
        return photographs / self._averaged


def common_errors(
    news: Array, light: Array, bounced: Array, weight: Array, block: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Common errors (brightness, bounced light) [-] that explain `news` (n,) best, and their covariance.

    news = brightness * light + scatter * bounced + what patches have of their own. All (n,), weights inverse
    variances. The covariance comes from leaving out each block in turn (jackknife): a smooth error of the
    gains that looks like bounced light is not alike in all blocks.
    """
    rows = np.stack([light, bounced], axis=1)
    blocks = int(block.max()) + 1
    normal, right = np.zeros((blocks, 2, 2)), np.zeros((blocks, 2))
    for i in range(2):
        right[:, i] = np.bincount(block, weight * rows[:, i] * news, blocks)
        for j in range(2):
            normal[:, i, j] = np.bincount(block, weight * rows[:, i] * rows[:, j], blocks)
    pull = np.diag([GAIN_DOUBT**-2, SCATTER_DOUBT**-2])
    found = np.linalg.solve(normal.sum(axis=0) + pull, right.sum(axis=0))
    used = np.trace(normal, axis1=1, axis2=2) > 0
    without = np.linalg.solve(
        normal.sum(axis=0) - normal[used] + pull, (right.sum(axis=0) - right[used])[..., None]
    )[..., 0]
    apart = without - found
    return found, max(len(apart) - 1, 0) / max(len(apart), 1) * apart.T @ apart


def posterior(found: Array, covariance: Array, scatter_sigma: float) -> tuple[float, float]:
    """What is believed of common errors (brightness, bounced light) [-].

    Bounced light is taken to have changed, as when an audience has come, only if it is off by more
    than three standard errors of what was calibrated (`scatter_sigma`) and of what is seen, stray light of
    lenses included; then what is found holds, shrunk by its own variance.
    """
    doubt = np.diag([GAIN_DOUBT**2, SCATTER_DOUBT**2])
    chance = np.sqrt(covariance[1, 1] + scatter_sigma**2 + STRAY_DOUBT**2)
    if abs(found[1]) <= CLEAR_SIGMAS * chance:
        slope = covariance[0, 1] / max(covariance[1, 1], TINY**2)
        bright = found[0] - slope * found[1]
        left = max(covariance[0, 0] - slope * covariance[0, 1], 0.0)
        return float(bright * doubt[0, 0] / (doubt[0, 0] + left)), 0.0
    bright, scatter = doubt @ np.linalg.solve(doubt + covariance, found)
    return float(bright), float(scatter)


def photographs_needed(sigma: Array, light: Array) -> int:
    """How many photographs of each picture show 1 JND of `light` (n,) in almost all patches.

    `sigma` (n,) is a single one's standard error [rel].

    Raises
    ------
    OutOfModelRange
        If half of the patches cannot be told to 1 JND by all photographs that a loop takes.
    """
    blur = TWO_SIDED * sigma / just_noticeable(light)
    half = float(np.median(blur)) ** 2
    if half > MOST * MAX_CORRECTIONS:
        raise OutOfModelRange(
            f"closed loop: got a camera whose single photograph is uncertain by {np.sqrt(half):.2g} "
            f"JND in half of the dome, expected at most {np.sqrt(MOST * MAX_CORRECTIONS):.2g}; open the "
            "aperture, expose longer, or refine on a brighter picture"
        )
    return int(np.clip(np.ceil(np.quantile(blur, CELL_QUANTILE) ** 2), MIN_PHOTOGRAPHS, MOST))


def residual_without_noise(residual: Array, sigma: Array, photographs: int) -> float:
    """Root mean square [rel] of what is left of `residual` (n,) without the noise of its mean."""
    return float(np.sqrt(max(float(np.mean(residual**2 - sigma**2 / photographs)), 0.0)))


def residual_jnd(residual: Array, light: Array) -> float:
    """What almost all patches of `residual` (n,) are off by at most, of light (n,) [JND]."""
    return float(np.quantile(np.abs(residual) / just_noticeable(light), CELL_QUANTILE))


def converged(residual: Array, sigma: Array, light: Array, photographs: int) -> bool:
    """Whether to stop: what is left is less than noise, or than half a JND in almost all patches."""
    noise = float(np.sqrt(np.mean(sigma**2) / AVERAGED))
    unseen = residual_jnd(residual, light) <= VISIBLE_JND
    return unseen or residual_without_noise(residual, sigma, photographs) <= noise


@dataclass(frozen=True, slots=True)
class Regression:
    """Where light is further from its goal than before, `before` and `after` in JND; `place` (n,) of it."""

    place: Mask
    channel: int
    before: float
    after: float


def largest_regression(
    first: Array, last: Array, noise: Array, judged: Mask, block: NDArray[np.intp]
) -> Regression | None:
    """The neighbourhood and channel that got worse most, None if none did so that it is seen.

    `first`, `last` (n, C) residuals and `noise` (n, C) their standard error, in JND; `judged` (n, C).
    Worse: further off by more than three sigmas, and by more than half a JND.
    """
    found: Regression | None = None
    for c in range(first.shape[1]):
        for number in np.unique(block[judged[:, c]]):
            place = judged[:, c] & (block == number)
            if place.sum() < FEWEST_PATCHES:
                continue
            known = float(np.mean(noise[place, c] ** 2))
            before = float(np.mean(first[place, c] ** 2)) - known
            after = float(np.mean(last[place, c] ** 2)) - known
            chance = 3 * np.sqrt(2 / place.sum()) * (known + max(before, after, 0))
            if after - max(before, VISIBLE_JND**2) > chance and (
                found is None or after > found.after**2
            ):
                found = Regression(place, c, np.sqrt(max(before, 0)), np.sqrt(after))
    return found
