"""Whether the light held still while one projector's pictures were taken.

Pictures that share a panel out among them add up to white. What is missing in proportion to white is a
lamp (or a camera) that drifted; what is there whatever white is, is light of the room that changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import OutOfModelRange

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]
MOST_PIXELS = 20_000
ROUNDS = 4
SIGMAS = 3.0  # of the scatter, beyond which a pixel does not count: glints, moving people
NOTED_DRIFT, LARGEST_DRIFT = 0.005, 0.015  # of white
NOTED_ROOM, LARGEST_ROOM = 0.002, 0.01  # likewise; bounced light is 5 to 20 % of white
CERTAIN = 5.0  # sigmas
BOUNCED = 0.3  # of light that falls somewhere: the most that comes everywhere
GREEN = 1


@dataclass(frozen=True, slots=True)
class PatternSum:
    """What pictures that should add up to white leave over.

    `shots` as people know them; `drift`, `room` relative to white, with `sigma` of the worse one.
    """

    shots: str
    drift: float
    room: float
    sigma: float


class StabilityChecks:
    """Collects sums of one projector's pictures.

    Parameters
    ----------
    white : (H, W, 3) radiance of its white, black taken off. on_screen : (H, W).
    """

    def __init__(self, white: Image, on_screen: Mask) -> None:
        places = np.flatnonzero(on_screen & np.isfinite(white).all(axis=-1))
        self._places = places[:: max(1, len(places) // MOST_PIXELS)]
        self._white = self._picked(white)
        self._level = float(np.percentile(self._white, 95)) if len(self._white) else 0.0
        self.sums: list[PatternSum] = []

    def add(self, shots: str, pictures: Sequence[Image], numbers: float = 0.0) -> None:
        """Compare the sum of pictures (H, W, 3), black taken off each, with white.

        `numbers`: share of the panel that shows numbers more often in the pictures than in white; their
        light bounces too, and is no change of the room's.
        """
        if not self._level > 0 or not pictures:
            return
        left = np.sum([self._picked(p) for p in pictures], axis=0) - self._white
        use = np.isfinite(left)
        design = np.stack([self._white, np.full_like(self._white, self._level)], axis=1)
        for _ in range(ROUNDS):
            found = np.linalg.lstsq(design[use], left[use], rcond=None)[0]
            miss = left - design @ found
            scatter = 1.4826 * float(np.median(np.abs(miss[use])))
            use = np.isfinite(left) & (np.abs(miss) <= SIGMAS * scatter + 1e-12 * self._level)
        covariance = scatter**2 * np.linalg.inv(design[use].T @ design[use])
        sigma = float(np.sqrt(np.diag(covariance).max()))
        drift, room = float(found[0]), float(found[1])
        room = float(np.copysign(max(abs(room) - BOUNCED * numbers, 0.0), room))
        self.sums.append(PatternSum(shots, drift, room, sigma))

    def notes(self, projector: str) -> list[str]:
        """What people should know; refuses what would spoil the calibration.

        Raises
        ------
        OutOfModelRange
            If the room's light or the projector's changed too much for the separation of light.
        """
        told = []
        for kind, noted, largest, advice in (
            ("room", NOTED_ROOM, LARGEST_ROOM, ROOM_ADVICE),
            ("drift", NOTED_DRIFT, LARGEST_DRIFT, DRIFT_ADVICE),
        ):
            worst = max(self.sums, key=lambda s: abs(getattr(s, kind)), default=None)
            if worst is None:
                continue
            size = getattr(worst, kind)
            line = advice.format(projector, worst.shots, size)
            if abs(size) > CERTAIN * worst.sigma and abs(size) > largest:
                raise OutOfModelRange(
                    f"{line}, expected less than {largest:.1%}; photograph it again"
                )
            if abs(size) > CERTAIN * worst.sigma and abs(size) > noted:
                told.append(line)
        return told

    def _picked(self, picture: Image) -> Array:
        return picture.reshape(-1, picture.shape[-1])[self._places, GREEN].astype(float)


ROOM_ADVICE = (
    "projector {}: light of the room changed while it was photographed (a door, a lamp, dusk): the "
    "pictures {} together differ from white by {:+.2%} of it wherever the camera looks"
)
DRIFT_ADVICE = (
    "projector {}: its light, or the camera's gain, drifted while it was photographed (lamp warming up, "
    "automatic brightness or exposure): the pictures {} together give {:+.2%} of white too much"
)
