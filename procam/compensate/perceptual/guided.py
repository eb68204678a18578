"""Applies the change of a small picture to a large one.

In each window of a few pixels total light is a line over the target's, y = a t + b, so that the large
picture keeps its detail: He, Sun and Tang (2013), "Guided image filtering" (doi:10.1109/TPAMI.2012.213),
drawn towards the plain ratio of the means where the target has little contrast.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array32, Image
from procam.maths.warp import enlarged, window_mean

WINDOW = 5  # px
TOWARDS_RATIO = (
    0.03  # variance of the target, relative to its mean squared, at which both count alike
)
BLACK = np.float32(1e-3)  # light [rel] below which a ratio has no meaning
MOST = np.float32(4.0)  # gain


@dataclass(frozen=True, eq=False, slots=True)
class Change:
    """Total light y = gain t + offset of a target t: (3, h, w) each."""

    gain: Array32
    offset: Array32

    @classmethod
    def fitted(cls, target: Array32, total: Array32) -> "Change":
        """The change that turns a target into total light, (3, h, w) each."""
        t, y = _mean(target), _mean(total)
        variance, covariance = _mean(target * target) - t * t, _mean(target * total) - t * y
        pull = TOWARDS_RATIO * t * t + BLACK**2
        ratio = np.minimum(y / np.maximum(t, BLACK), MOST)
        gain = np.clip((covariance + pull * ratio) / (variance + pull), 0, MOST)
        return cls(_mean(gain), _mean(y - gain * t))

    def moved_to(self, other: "Change", share: Array32) -> "Change":
        """A change between this one and another, by its share (h, w)."""
        return Change(
            self.gain + share * (other.gain - self.gain),
            self.offset + share * (other.offset - self.offset),
        )

    def of(self, target: Image) -> Image:
        """The change of a large target (N, N, 3)."""
        shape = target.shape[:2]
        changed = enlarged(np.moveaxis(self.gain, 0, -1), shape)
        changed *= target
        changed += enlarged(np.moveaxis(self.offset, 0, -1), shape)
        return changed


def _mean(planes: Array32) -> Array32:
    return np.array([window_mean(p, WINDOW) for p in planes])
