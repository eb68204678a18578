"""Least squares for the matrix from content light to XYZ, from readings of a hand meter.

The residuals are of x, y and Y, whose errors a meter's data sheet gives, so the problem is not linear in
the matrix. A linear fit of XYZ is the start; Levenberg-Marquardt with analytic derivatives refines it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc

from procam.arrays import Array, BoolArray
from procam.estimate.light.colour_spaces import xyy_from_xyz
from procam.estimate.light.panel_light import PanelLight
from procam.model.reading import MeterReading, Spot

METER_SIGMA = np.array([0.002, 0.002, 0.02])  # of x, y and, relative, Y: data sheets of hand meters
TIGHT = 1e-12  # relative tolerance of the solver
IMPROBABLE = 0.01  # probability of the residuals below which the sigmas are scaled up


@dataclass(frozen=True, slots=True)
class MeterSamples:
    """Readings as arrays; xyz = content @ matrix.T + offset, up to the meter's errors.

    `name`, `patch` (n,); `content`, `offset`, `xyz` (n, 3); `sigma` (n, 3) of x, y and, relative, Y;
    `level` (n,) the Y to which it is relative.
    """

    name: NDArray[np.str_]
    patch: NDArray[np.str_]
    content: Array
    offset: Array
    xyz: Array
    sigma: Array
    level: Array

    @classmethod
    def of(
        cls,
        lit: Sequence[MeterReading],
        light: PanelLight,
        blacks: dict[Spot, Array],
        dark: dict[Spot, Array],
    ) -> "MeterSamples":
        """From readings `lit`; black by spot as read [cd/m2], or else from the calibration [rel]."""
        nothing = np.zeros(3)
        added = [nothing if r.spot in blacks else dark[r.spot] for r in lit]
        return cls(
            np.array([r.projector for r in lit]),
            np.array([r.patch for r in lit]),
            np.array([light.patch(r) for r in lit]) + added,
            np.array([blacks.get(r.spot, nothing) for r in lit]),
            np.array([r.xyz for r in lit]),
            METER_SIGMA / np.sqrt([[r.count] for r in lit]),
            np.array([r.xyz[1] for r in lit]),
        )

    def only(self, use: BoolArray) -> "MeterSamples":
        """A subset of the readings."""
        return MeterSamples(*(getattr(self, field.name)[use] for field in fields(self)))

    def predicted(self, matrix: Array) -> Array:
        """Predicted XYZ (n, 3) [cd/m2]."""
        return self.content @ matrix.T + self.offset

    def residual(self, matrix: Array) -> Array:
        """Residual (n, 3) of x, y and Y in the meter's sigmas."""
        read, predicted = xyy_from_xyz(self.xyz), xyy_from_xyz(self.predicted(matrix))
        return (read - predicted) / self._sigmas

    def slopes(self, matrix: Array) -> Array:
        """Derivatives (n, 3, 9) of the residual by the matrix, row by row."""
        xyz = self.predicted(matrix)
        total = xyz.sum(axis=1)[:, None, None]
        by_xyz = np.zeros((len(xyz), 3, 3))
        by_xyz[:, :2] = np.eye(3)[:2] / total - xyz[:, :2, None] / total**2
        by_xyz[:, 2, 1] = 1
        by_xyz /= self._sigmas[..., None]
        return -np.einsum("nab,nc->nabc", by_xyz, self.content).reshape(-1, 3, 9)

    def solve(self) -> tuple[Array, Array]:
        """The matrix (3, 3) and the covariance (9, 9) of its entries."""
        weight = 1 / self.xyz[:, 1:2]
        light = (self.xyz - self.offset) * weight
        start = np.asarray(np.linalg.lstsq(self.content * weight, light, rcond=None)[0].T, float)
        # weights from the readings themselves would favour those that are low by chance
        expected = np.clip(self.predicted(start)[:, 1], self.level / 2, self.level * 2)
        return replace(self, level=expected)._refined(start)

    def _refined(self, start: Array) -> tuple[Array, Array]:
        def residual(entries: Array) -> Array:
            return self.residual(entries.reshape(3, 3)).ravel()

        def slopes(entries: Array) -> Array:
            return self.slopes(entries.reshape(3, 3)).reshape(-1, 9)

        found = least_squares(residual, start.ravel(), slopes, method="lm", xtol=TIGHT, ftol=TIGHT)
        final = slopes(found.x)
        return found.x.reshape(3, 3), np.asarray(np.linalg.inv(final.T @ final))

    @property
    def _sigmas(self) -> Array:
        ones = np.ones_like(self.level)
        return self.sigma * np.stack([ones, ones, self.level], axis=1)


def reduced_chi2(samples: MeterSamples, matrix: Array) -> float:
    """Chi squared per degree of freedom if it is improbably large, else 1."""
    freedom = samples.xyz.size - matrix.size
    square = float(np.sum(samples.residual(matrix) ** 2))
    return square / freedom if freedom > 0 and chdtrc(freedom, square) < IMPROBABLE else 1.0


def probability(samples: MeterSamples, matrix: Array, covariance: Array, scale: float) -> float:
    """Probability of readings as far from their prediction, with all variances times `scale`."""
    slopes = samples.slopes(matrix).reshape(-1, 9)
    residual = samples.residual(matrix).ravel()
    variance = np.eye(len(residual)) + slopes @ covariance @ slopes.T
    return float(chdtrc(len(residual), residual @ np.linalg.solve(variance, residual) / scale))
