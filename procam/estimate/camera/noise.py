"""The variance of a camera's samples as a function of their level."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Variance of a sample of level I: `floor` + `per_level` I [image unit^2]."""

    floor: float
    per_level: float

    def variance(self, level: Any) -> Any:
        """Variance at `level`; never negative."""
        return np.maximum(self.floor + self.per_level * level, 1e-12)


NO_NOISE = NoiseLaw(0.0, 0.0)
