"""A picture that a person moved at some points: a smooth shift, exact there and local."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
REACH = 1 / 6  # of a panel's longer side: how far from its point a shift is felt at all
NEAREST = 1e-24  # squared distance, in reaches, below which two places are one
STEPS = 32  # between a point and the rim of what is looked at round it for folds


@dataclass(frozen=True, slots=True)
class LocalShift:
    """How far a picture was moved, at any place where it is now.

    The shift is the mean of the points' shifts, each weighed by its nearness over the square of its
    distance (Shepard's interpolation, doi:10.1145/800186.810616), times a factor that fades from 1
    at the points to 0 at `reach_px` from all of them. A mean of shifts within reach, and of none at
    all, never exceeds them, however near to each other the points are.

    Attributes
    ----------
    there : (N, 2) places where the moved points are now, (x, y) [px].
    by : (N, 2) how far they were moved [px].
    reach_px : beyond it from every point nothing moves [px].
    """

    there: Array
    by: Array
    reach_px: float

    @classmethod
    def on_panel(cls, size: tuple[int, int], pixels: Array, by: Array) -> "LocalShift":
        """Points (N, 2) of a panel of `size` (width, height) that move by (N, 2) [px]."""
        return cls(pixels + by, by, REACH * max(size))

    def at(self, places: Array) -> Array:
        """Shift (..., 2) [px] of what is now at `places` (..., 2); it was at `places` less that.

        >>> moved = LocalShift(np.array([[50.0, 40]]), np.array([[3.0, -1]]), 20)
        >>> moved.at(np.array([[50.0, 40], [60, 40], [70, 40]])).round(9).tolist()
        [[3.0, -1.0], [1.5, -0.5], [0.0, 0.0]]
        """
        x, y = np.moveaxis(places, -1, 0)
        still, weight, total = np.ones(x.shape), np.zeros(x.shape), np.zeros(places.shape)
        for point, by in zip(self.there, self.by, strict=True):
            apart = ((x - point[0]) ** 2 + (y - point[1]) ** 2) / self.reach_px**2
            felt = apart < 1
            apart = apart[felt]
            near = 1 - apart * (3 - 2 * np.sqrt(apart))  # flat at the point and at its reach
            own = near / np.maximum(apart, NEAREST)
            still[felt] *= 1 - near
            weight[felt] += own
            total[felt] += own[:, None] * by
        return np.asarray(total * ((1 - still) / np.where(weight > 0, weight, 1))[..., None])

    def torn_at(self) -> int | None:
        """Index of the first point round which the moved picture would lie over itself; else None.

        Looked for on two grids round each point, as wide as the reach and as the next point is far.
        """
        steps = np.linspace(-1, 1, 2 * STEPS + 1)
        square = np.stack(np.meshgrid(steps, steps), axis=-1)
        for i, point in enumerate(self.there):
            others = np.linalg.norm(np.delete(self.there, i, axis=0) - point, axis=1)
            wide = (self.reach_px, float(others.min(initial=self.reach_px)))
            if any(self._overlaps(point + width * square) for width in wide):
                return i
        return None

    def _overlaps(self, places: Array) -> bool:
        """Whether any cell of a grid of places (H, W, 2) comes from one that is turned over."""
        before = places - self.at(places)
        start, end = before[:-1, :-1], before[1:, 1:]
        halves = (
            _cross(before[:-1, 1:] - start, end - start),
            _cross(end - start, before[1:, :-1] - start),
        )
        return bool(np.min(halves) <= 0)


def _cross(first: Array, second: Array) -> Array:
    """Twice the signed areas (...) of the triangles between edges (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
