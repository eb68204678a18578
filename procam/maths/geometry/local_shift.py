"""A smooth, local shift of a picture that is exact at some points, where a person moved it."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array

REACH = 1 / 6  # of a panel's longer side: radius around a point within which its shift acts
NEAREST = 1e-24  # squared distance over `reach_px` squared, below which two positions coincide
STEPS = 32  # of the grid that is searched for folds, from its middle to its edge


@dataclass(frozen=True, slots=True)
class LocalShift:
    """The shift of a moved picture as a function of position.

    The shift is a weighted mean of the points' shifts, with weights that fall with the square of the
    distance (Shepard's interpolation, doi:10.1145/800186.810616), times a factor that falls from 1
    at the points to 0 at `reach_px` from all of them. A weighted mean never exceeds the largest
    shift, however close the points are.

    Attributes
    ----------
    there : (N, 2) positions (x, y) of the points after the move [px].
    by : (N, 2) their shifts [px].
    reach_px : distance from every point beyond which the shift is 0 [px].
    """

    there: Array
    by: Array
    reach_px: float

    @classmethod
    def on_panel(cls, size: tuple[int, int], pixels: Array, by: Array) -> "LocalShift":
        """The shift of a panel of `size` (width, height) whose points (N, 2) move by (N, 2) [px]."""
        return cls(pixels + by, by, REACH * max(size))

    def at(self, places: Array) -> Array:
        """Shift (..., 2) [px] of what is now at `places` (..., 2); before the move it was at places - shift.

        >>> moved = LocalShift(np.array([[50.0, 40]]), np.array([[3.0, -1]]), 20)
        >>> moved.at(np.array([[50.0, 40], [60, 40], [70, 40]])).round(9).tolist()
        [[3.0, -1.0], [1.5, -0.5], [0.0, 0.0]]
        """
        x, y = np.moveaxis(places, -1, 0)
        still, weight, total = np.ones(x.shape), np.zeros(x.shape), np.zeros(places.shape)
        for point, by in zip(self.there, self.by, strict=True):
            apart = ((x - point[0]) ** 2 + (y - point[1]) ** 2) / self.reach_px**2
            within = apart < 1
            apart = apart[within]
            near = 1 - apart * (3 - 2 * np.sqrt(apart))  # slope 0 at the point and at `reach_px`
            own = near / np.maximum(apart, NEAREST)
            still[within] *= 1 - near
            weight[within] += own
            total[within] += own[:, None] * by
        return np.asarray(total * ((1 - still) / np.where(weight > 0, weight, 1))[..., None])

    def first_fold(self) -> int | None:
        """Index of the first point around which the moved picture folds over itself; None if none does.

        Two grids around each point are tested: one as wide as `reach_px`, one as wide as the
        distance to the next point.
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
        """Whether the shift inverts any cell of a grid of positions (H, W, 2)."""
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
