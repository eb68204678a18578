"""Dust and stains: what is common to the light of all projectors at a place of the dome.

Lamps change the light of a whole panel, the screen that of all projectors at a place. So slow harmonics of
the direction and one level for each projector are fitted together, and spots are looked for in the residual.
Dust only takes light away: the cleanest place that is seen counts as clean.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array, BoolArray
from procam.estimate.drift.light_change import WindowLight
from procam.maths.geometry.harmonics import harmonics
from procam.maths.statistics import robust_sigma

LOWEST, HIGHEST = 1, 2  # degrees of dust
HUBER = 2.0
ROUNDS = 20
CERTAIN = 5.0  # sigmas
LEAST_DUST, LEAST_STAIN = 0.012, 0.025  # of the albedo
SEARCH = np.radians(7.0)  # Gaussian with which spots are looked for
WIDEST = np.radians(25.0)
LEAST_WINDOWS = 12
SCATTER_LEFT = 0.05  # of a change of the scattered light: what stays in the windows
LEAST_SIGMA = 5e-4
SHAPE_SIGMA = 0.008  # relative: dust is no sum of few harmonics
STAIN_SIGMA = 0.016  # relative: no stain is a Gaussian
DEAD = 0.1  # of a primary's light before: not used
OFF_PICTURE = 1.0  # log of the light, below a projector's level: nothing is shown there


@dataclass(frozen=True, slots=True)
class Spot:
    """A place that lost `loss` of its albedo, with a Gaussian of `width` [rad] about `direction` (3,)."""

    loss: float
    sigma: float
    direction: Array
    width: float

    def log_albedo(self, direction: Array) -> Array:
        """Log (n,) of the albedo over that before."""
        return _spot(direction, self.direction, self.width, self.loss)


@dataclass(frozen=True, slots=True)
class Dust:
    """A slow loss of albedo, `loss` at its largest, in `direction` (3,); 0 at the cleanest place seen."""

    loss: float
    sigma: float
    direction: Array
    coefficients: Array
    highest: float

    def log_albedo(self, direction: Array) -> Array:
        """Log (n,) of the albedo over that before."""
        return np.asarray(_slow(direction) @ self.coefficients - self.highest)


@dataclass(frozen=True, slots=True)
class DomeChange:
    """What has changed on the screen; None for what has not."""

    dust: Dust | None
    stain: Spot | None

    def log_albedo(self, direction: Array) -> Array:
        """Log (n,) of the albedo over that before, at directions (n, 3)."""
        parts = [part.log_albedo(direction) for part in (self.dust, self.stain) if part]
        return np.asarray(sum(parts, np.zeros(len(direction))))


def find_dome_change(
    light: Mapping[str, WindowLight], change_of_scatter: float = 0.0
) -> DomeChange:
    """Dust and stains by the light of several projectors' windows; all channels count alike.

    `change_of_scatter` is that of the scattered light, relative, which was taken out of the windows to a
    share of itself.
    """
    parts = [part for each in light.values() if len((part := _one_value(each))[0])]
    if sum(len(value) for _, value in parts) < LEAST_WINDOWS:
        return DomeChange(None, None)
    direction = np.concatenate([where for where, _ in parts])
    value = np.concatenate([value for _, value in parts])
    owner = np.concatenate([np.full(len(v), i) for i, (_, v) in enumerate(parts)])
    dust, stain = None, None
    for _ in range(2):  # each is looked for without the other
        rest = value - (stain.log_albedo(direction) if stain else 0.0)
        dust = _find_dust(direction, rest, owner, LEAST_DUST + SCATTER_LEFT * change_of_scatter)
        rest = value - (dust.log_albedo(direction) if dust else 0.0)
        stain = _find_stain(direction, rest - _levels(rest, owner)[owner], owner)
    return DomeChange(dust, stain)


def _one_value(light: WindowLight) -> tuple[Array, Array]:
    """Directions (n, 3) and log ratios (n,) of the channels that shine, without windows that show nothing."""
    level, _ = light.level()
    lit = level > np.log(DEAD)
    value = light.log_ratio[:, lit].mean(axis=1) if lit.any() else np.zeros(0)
    good = value > (level[lit].mean() if lit.any() else 0.0) - OFF_PICTURE
    return light.direction[: len(value)][good], value[good]


def _levels(value: Array, owner: Array) -> Array:
    """Median of each projector's windows."""
    return np.array(
        [
            np.median(value[owner == i]) if (owner == i).any() else 0.0
            for i in range(owner.max() + 1)
        ]
    )


def _slow(direction: Array) -> Array:
    return harmonics(np.asarray(direction, float), LOWEST, HIGHEST)[0]


def _find_dust(direction: Array, value: Array, owner: Array, least: float) -> Dust | None:
    slow = _slow(direction)
    terms = slow.shape[1]
    levels = (owner[:, None] == np.arange(owner.max() + 1)).astype(float)
    basis = np.hstack([slow, levels])
    found, covariance = _robust(basis, value)
    change = slow @ found[:terms]
    at, clean = int(np.argmin(change)), int(np.argmax(change))
    loss = float(change[clean] - change[at])
    span = slow[clean] - slow[at]
    sigma = float(np.sqrt(span @ covariance[:terms, :terms] @ span))
    if loss < max(least, CERTAIN * sigma):
        return None
    return Dust(
        1 - float(np.exp(-loss)),
        float(np.hypot(sigma, SHAPE_SIGMA * loss) * np.exp(-loss)),
        direction[at],
        found[:terms],
        float(change[clean]),
    )


def _robust(basis: Array, value: Array) -> tuple[Array, Array]:
    """Coefficients (K,) and covariance (K, K), by iteratively reweighted least squares (Huber)."""
    weight = np.ones(len(value))
    for _ in range(ROUNDS):
        normal = (basis * weight[:, None]).T @ basis + 1e-9 * np.eye(basis.shape[1])
        found = np.linalg.solve(normal, basis.T @ (weight * value))
        residual = value - basis @ found
        sigma = max(robust_sigma(residual, 0.0), LEAST_SIGMA)
        weight = np.minimum(1, HUBER * sigma / np.maximum(np.abs(residual), 1e-12))
    return np.asarray(found, float), np.asarray(np.linalg.inv(normal) * sigma**2, float)


def _find_stain(direction: Array, residual: Array, owner: Array) -> Spot | None:
    """The darkest spot of residuals (n,), if it stands out."""
    closeness = np.exp(-0.5 * (np.arccos(np.clip(direction @ direction.T, -1, 1)) / SEARCH) ** 2)
    smooth = closeness @ residual / closeness.sum(axis=1)
    noise = max(robust_sigma(smooth), LEAST_SIGMA)
    at = int(np.argmin(smooth))
    if -smooth[at] < max(LEAST_STAIN / 2, CERTAIN * noise):
        return None
    return _fitted_spot(direction, residual, owner, at)


def _fitted_spot(direction: Array, residual: Array, owner: Array, at: int) -> Spot | None:
    middle = direction[at]
    aside = np.cross(middle, [0.0, 0.0, 1.0] if abs(middle[2]) < 0.9 else [1.0, 0.0, 0.0])
    axes = np.stack(
        [aside / np.linalg.norm(aside), np.cross(middle, aside) / np.linalg.norm(aside)]
    )
    near: BoolArray = direction @ middle > np.cos(WIDEST)

    def spot(x: Array) -> Array:
        centre = middle + x[2:4] @ axes
        return _spot(direction[near], centre / np.linalg.norm(centre), float(np.exp(x[1])), x[0])

    def off(x: Array) -> Array:
        rest = residual[near] - spot(x)
        return rest - x[4]

    start = np.array([-residual[at], np.log(SEARCH), 0.0, 0.0, 0.0])
    limits = ([0, np.log(0.02), -0.3, -0.3, -0.2], [0.99, np.log(WIDEST), 0.3, 0.3, 0.2])
    found = least_squares(
        off, np.clip(start, *limits), loss="soft_l1", f_scale=0.005, bounds=limits
    )
    sigma2, slopes = max(robust_sigma(found.fun, 0.0), LEAST_SIGMA) ** 2, np.asarray(found.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes) * sigma2
    width2, blur2 = float(np.exp(2 * found.x[1])), _window_variance(direction, owner)
    sharper = width2 / max(width2 - blur2, width2 / 2)  # windows are means over their area
    loss = float(found.x[0]) * sharper
    sigma = float(np.hypot(np.sqrt(covariance[0, 0]) * sharper, STAIN_SIGMA * loss))
    if loss < max(LEAST_STAIN, CERTAIN * sigma):
        return None
    centre = middle + found.x[2:4] @ axes
    return Spot(loss, sigma, centre / np.linalg.norm(centre), float(np.sqrt(width2 / sharper)))


def _window_variance(direction: Array, owner: Array) -> float:
    """Variance [rad^2] along one axis of the square that a window is."""
    apart = np.arccos(np.clip(direction @ direction.T, -1, 1))
    apart[(owner[:, None] != owner) | np.eye(len(owner), dtype=bool)] = np.inf
    return float(np.median(apart.min(axis=1))) ** 2 / 12


def _spot(direction: Array, centre: Array, width: float, loss: float) -> Array:
    angle = np.arccos(np.clip(direction @ centre, -1, 1))
    return np.asarray(np.log(np.maximum(1 - loss * np.exp(-0.5 * (angle / width) ** 2), 1e-3)))
