"""Manual masks and manual corrections of a projector's picture."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import BoolArray, FloatArray
from procam.errors import ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """A manual mask: pixels of a device or of a dome master.

    Attributes
    ----------
    name : of the camera or projector; "screen" for the dome.
    covered : (H, W) bool, True where marked.
    """

    name: str
    covered: BoolArray

    def __post_init__(self) -> None:
        if self.covered.ndim != 2 or self.covered.dtype != np.bool_:
            raise ShapeError(f"mask {self.name}", self.covered.shape, "(H, W) of bool")

    def at(self, xy: FloatArray) -> BoolArray:
        """Whether positions (..., 2) as (x, y) [px] are on a marked pixel; False for NaN and outside.

        >>> mask = Mask("south", np.array([[False, True]]))
        >>> mask.at(np.array([[0.6, 0.0], [0.4, 0.0], [np.nan, 0.0]])).tolist()
        [True, False, False]
        """
        height, width = self.covered.shape
        with np.errstate(invalid="ignore"):
            on_panel = (xy >= -0.5) & (xy < np.array([width, height]) - 0.5)
        inside = np.asarray(on_panel.all(axis=-1))
        index = np.floor(np.where(inside[..., None], xy, 0) + 0.5).astype(np.intp)
        return np.asarray(inside & self.covered[index[..., 1], index[..., 0]])


@dataclass(frozen=True, slots=True)
class Nudge:
    """A manual shift of the picture at one point of a projector's panel.

    Attributes
    ----------
    projector : its name. pixel : (x, y) on its panel [px].
    shift_px : (x, y) shift of the picture there [px]; right and down are positive.
    """

    projector: str
    pixel: tuple[float, float]
    shift_px: tuple[float, float]
