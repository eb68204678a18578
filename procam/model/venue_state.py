"""States of the house: what an audience changes about the light that bounces, and the room's own lamps."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.model.transport import Map, Measured

STATE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # it becomes part of a file's name


@dataclass(frozen=True, slots=True)
class VenueState:
    """A house as it is in a show, beside the one that was calibrated: full, say, with exit signs on.

    Attributes
    ----------
    name : what people call it. feedback : m in this state.
    scatter_ratio : (3,) bounced light per direct light, over the calibration's own [-].
    ambient : (N, N, 3) light of the room's own lamps on the dome, all its bounces included [rel];
        None where there is none.
    """

    name: str
    feedback: Measured
    scatter_ratio: NDArray[np.float64]
    ambient: Map | None = None

    def __post_init__(self) -> None:
        if not STATE_NAME.fullmatch(self.name):
            raise InputError(
                f"house state: got the name {self.name!r}, expected letters, digits, - and _, such "
                "as full"
            )
        if self.scatter_ratio.shape != (3,):
            raise ShapeError(f"scatter_ratio of {self.name}", self.scatter_ratio.shape, "(3,)")
        if not ((self.scatter_ratio > 0) & (self.scatter_ratio < np.inf)).all():  # nor NaN
            raise InputError(
                f"scatter_ratio of house state {self.name}: got {self.scatter_ratio.tolist()}, "
                "expected more than 0"
            )
        if self.ambient is not None and not ((self.ambient >= 0) & (self.ambient < np.inf)).all():
            raise InputError(
                f"ambient of house state {self.name}: got light below 0 or NaN, expected 0 or more"
            )
