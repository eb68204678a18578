"""Venue states: feedback and ambient light of the venue with a given audience and its own lamps."""

import re
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Map
from procam.errors import InputError, ShapeError
from procam.model.transport import Measured

STATE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # part of a file name


@dataclass(frozen=True, slots=True)
class VenueState:
    """The venue with a given audience and its own lamps, as opposed to the calibrated state.

    Attributes
    ----------
    name : chosen by the user, such as "full". feedback : m in this state.
    scatter_ratio : (3,) scattered light per direct light, over that of the calibration [-].
    ambient : (N, N, 3) light of the venue's own lamps on the dome, inter-reflections included
        [rel]; None for none.
    """

    name: str
    feedback: Measured
    scatter_ratio: Array
    ambient: Map | None = None

    def __post_init__(self) -> None:
        if not STATE_NAME.fullmatch(self.name):
            raise InputError(
                f"venue state {self.name!r}: its name needs letters, digits, - and _, such as full"
            )
        if self.scatter_ratio.shape != (3,):
            raise ShapeError(f"scatter_ratio of {self.name}", self.scatter_ratio.shape, "(3,)")
        if not ((self.scatter_ratio > 0) & (self.scatter_ratio < np.inf)).all():  # nor NaN
            raise InputError(
                f"scatter_ratio of venue state {self.name} is {self.scatter_ratio.tolist()}; it needs "
                "finite values above 0"
            )
        if self.ambient is not None and not ((self.ambient >= 0) & (self.ambient < np.inf)).all():
            raise InputError(
                f"ambient of venue state {self.name} contains negative light or NaN; it needs 0 or more"
            )
