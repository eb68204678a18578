"""Check that the light held still while one projector's pictures were taken.

Pictures that share out a panel add up to white. A regression of what is missing on white and on a
constant separates two causes: a part proportional to white is drift of the lamp or the camera, a
constant part is light of the room that changed (docs/theory/photometry.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.errors import OutOfModelRange
from procam.maths.statistics import robust_sigma

MAX_PIXELS = 20_000
ROUNDS = 4  # of the regression; each leaves outliers out
OUTLIER_SIGMAS = 3.0  # glints, moving people
NOTED_DRIFT, MAX_DRIFT = 0.005, 0.015  # of white
NOTED_ROOM, MAX_ROOM = 0.002, 0.01  # of white; scattered light is 5 to 20 % of white
SIGNIFICANT_SIGMAS = 5.0
MAX_SCATTER = 0.3  # of the direct light: the most that scatters to any place
GREEN = 1


@dataclass(frozen=True, slots=True)
class PatternSum:
    """Departure of a sum of pictures from white.

    `shots` : the pictures, for messages. `drift`, `room` relative to white; `sigma` of the worse one.
    """

    shots: str
    drift: float
    room: float
    sigma: float


class StabilityChecks:
    """Collects sums of one projector's pictures.

    Parameters
    ----------
    white : (H, W, 3) radiance of its white, black subtracted. on_screen : (H, W).
    """

    def __init__(self, white: Image, on_screen: BoolArray) -> None:
        pixels = np.flatnonzero(on_screen & np.isfinite(white).all(axis=-1))
        self._pixels = pixels[:: max(1, len(pixels) // MAX_PIXELS)]
        self._white = self._picked(white)
        self._level = float(np.percentile(self._white, 95)) if len(self._white) else 0.0
        self.sums: list[PatternSum] = []

    def add(self, shots: str, pictures: Sequence[Image], mark_share: float = 0.0) -> None:
        """Compare the sum of pictures (H, W, 3), black subtracted from each, with white.

        `mark_share`: share of the panel that shows shot marks more often in the pictures than in
        white. Their light scatters too, and is no change of the room's light.
        """
        if not self._level > 0 or not pictures:
            return
        surplus = np.sum([self._picked(p) for p in pictures], axis=0) - self._white
        use = np.isfinite(surplus)
        design = np.stack([self._white, np.full_like(self._white, self._level)], axis=1)
        for _ in range(ROUNDS):
            found = np.linalg.lstsq(design[use], surplus[use], rcond=None)[0]
            residual = surplus - design @ found
            scale = robust_sigma(residual[use], 0.0)
            limit = OUTLIER_SIGMAS * scale + 1e-12 * self._level
            use = np.isfinite(surplus) & (np.abs(residual) <= limit)
        covariance = scale**2 * np.linalg.inv(design[use].T @ design[use])
        sigma = float(np.sqrt(np.diag(covariance).max()))
        drift, room = float(found[0]), float(found[1])
        room = float(np.copysign(max(abs(room) - MAX_SCATTER * mark_share, 0.0), room))
        self.sums.append(PatternSum(shots, drift, room, sigma))

    def notes(self, projector: str) -> list[str]:
        """Notes for the report on changes that the calibration tolerates.

        Raises
        ------
        OutOfModelRange
            If the room's light or the projector's changed too much for the separation of light.
        """
        notes = []
        for kind, noted, largest, advice in (
            ("room", NOTED_ROOM, MAX_ROOM, ROOM_ADVICE),
            ("drift", NOTED_DRIFT, MAX_DRIFT, DRIFT_ADVICE),
        ):
            worst = max(self.sums, key=lambda s: abs(getattr(s, kind)), default=None)
            if worst is None:
                continue
            size = getattr(worst, kind)
            if abs(size) <= max(SIGNIFICANT_SIGMAS * worst.sigma, noted):
                continue
            note = advice.format(projector, worst.shots, size)
            if abs(size) > largest:
                raise OutOfModelRange(
                    f"{note}; at most {largest:.1%} is usable, photograph it again"
                )
            notes.append(note)
        return notes

    def _picked(self, picture: Image) -> Array:
        return picture.reshape(-1, picture.shape[-1])[self._pixels, GREEN].astype(float)


ROOM_ADVICE = (
    "projector {}: light of the room changed while it was photographed (a door, a lamp, dusk): the "
    "pictures {} together differ from white by {:+.2%} of it over the whole picture"
)
DRIFT_ADVICE = (
    "projector {}: its light, or the camera's gain, drifted while it was photographed (lamp warming up, "
    "automatic brightness or exposure): the pictures {} together differ from white by {:+.2%} of it"
)
