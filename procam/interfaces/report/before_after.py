"""A picture before and after compensation, and where limits of the projectors hold."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, Image
from procam.maths.warp import block_mean

JUDGED = 256  # patches that errors are averaged over, along the width
WHOLE = 0.999  # share from which a patch counts as lit, or as free of limits


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """A picture before and after compensation and its target, all (H, W, 3) [rel].

    `free` (H, W, 3) is the share of each patch where no limit holds; `coverage`, `weight` (H, W). `source` of
    `before` and `after`: simulator, camera or prediction.
    """

    before: Image
    after: Image
    target: Image
    free: Image
    coverage: Image
    weight: Array
    source: str

    def error_rms(self) -> tuple[float, float]:
        """Difference from the target before and after, where no limit holds [rel]."""
        size = max(1, self.target.shape[1] // JUDGED)
        small = [block_mean(p, size) for p in (self.before, self.after, self.target, self.free)]
        whole = (small[3] > WHOLE) & (block_mean(self.coverage, size) > WHOLE)[..., None]
        weight = block_mean(self.weight, size)[..., None] * whole
        total = max(float(weight.sum()), 1e-12)
        before, after = (np.sum(weight * (p - small[2]) ** 2) / total for p in small[:2])
        return float(np.sqrt(before)), float(np.sqrt(after))


@dataclass(frozen=True, slots=True)
class Limits:
    """Where the compensated picture meets a limit of the projectors.

    `codes` (H, W, 3): 0 exact, 1 too bright, 2 too dark, 3 not lit or protected. `too_bright` and
    `too_dark` (3,) are shares of what is lit and not protected.
    """

    codes: NDArray[np.integer]
    too_bright: Array
    too_dark: Array
