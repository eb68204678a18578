"""What a dome does to a picture, as the frame kernels take it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.kernels.frame.grid import CHANNELS, Grid, Plane
from procam.kernels.native.arrays import least_colour

TERMS = 9
SPARE = 64  # floats that a vector may read past the end of a field
EVERYWHERE = 2  # as in native/kernels.h


@dataclass(frozen=True, eq=False)
class FrameModel:
    """What a dome does to a picture of `size`, on a dome master of M x M nodes, M <= size.

    Light to send is clip(gain t - b, lo, hi), t the content in linear light and b what bounces, a
    field like the others (`bounced_light`). Fields are bilinear between nodes; in sums directions are so
    between every few node rows (`Grid.edges`), and solid angles too where they lie on such lines.

    Attributes
    ----------
    spread, lo : (M, M, 3) [1/sr], [rel]. hi, ambient : (M, M, 3) [rel], None where they change
        nothing. gain : (M, M) or None. coverage : (M, M), 0 where no light is sent.
    solid_angle_sr : (M, M) of a pixel of the picture, more than 0 just where light is sent.
    direction : (3, M, M) unit vectors. terms : 1, 4 or 9, of the polynomial.
    """

    size: int
    spread: Plane
    lo: Plane
    hi: Plane | None
    ambient: Plane | None
    gain: Plane | None
    coverage: Plane
    solid_angle_sr: Plane
    direction: Plane
    terms: int = 1

    def __post_init__(self) -> None:
        nodes = self.coverage.shape[0]
        plane: tuple[int, ...] = (nodes, nodes)
        colours: tuple[int, ...] = (nodes, nodes, CHANNELS)
        shapes = dict.fromkeys(("coverage", "gain", "solid_angle_sr"), plane)
        shapes.update(dict.fromkeys(("spread", "lo", "hi", "ambient"), colours))
        shapes["direction"] = (CHANNELS, nodes, nodes)
        for name, shape in shapes.items():
            field = getattr(self, name)
            if field is not None and field.shape != shape:
                raise ShapeError(f"field {name}", field.shape, f"{shape}")
        if nodes > self.size:
            raise InputError(f"fields: got {nodes} nodes, expected at most the size, {self.size}")
        if self.terms not in (1, 4, TERMS):
            raise InputError(f"terms: got {self.terms}, expected 1, 4 or {TERMS}")
        odd = int(((self.coverage > 0) != (self.solid_angle_sr > 0)).sum())
        if odd:
            raise InputError(
                f"solid_angle_sr: got {odd} nodes where either it or coverage is 0, expected both or none; "
                "multiply solid angles by the coverage"
            )

    @property
    def nodes(self) -> int:
        """Edge of the fields."""
        return int(self.coverage.shape[0])

    @cached_property
    def grid(self) -> Grid:
        """Places of the picture's pixels among the nodes."""
        return Grid(self.size, self.nodes)

    @cached_property
    def at_edges(self) -> dict[str, Plane]:
        """At edges of bands: `weight`, solid angle of a pixel (E, M) [sr]; `paint`, spread; `direction`.

        The latter two (E, 3, M).
        """
        at_edges = self.grid.at_edges
        found = {
            "weight": at_edges(self.solid_angle_sr),
            "paint": at_edges(np.moveaxis(self.spread, -1, 1)),
            "direction": at_edges(np.moveaxis(self.direction, 0, 1)),
        }
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in found.items()}

    @cached_property
    def lit(self) -> NDArray[np.uint8]:
        """Where blocks of the picture are lit, for each interval: see `Grid.lit`."""
        return self.grid.lit(self.solid_angle_sr)

    def ways(self, top: float) -> NDArray[np.uint8]:
        """How blocks are done (enum lit) where no more than `top` is sent: upper limits above it are none."""
        if self._ways.get("top") != top:
            held = self.hi is not None and self.grid.least(least_colour(self.hi)) < top
            found = self.lit + ((self.lit == EVERYWHERE) & held)
            self._ways.update(top=top, found=np.ascontiguousarray(found, np.uint8))
        return np.asarray(self._ways["found"])

    @cached_property
    def _ways(self) -> dict[str, Any]:
        return {}  # of the last `top`

    def brief(self, dtype: np.dtype[Any], top: float) -> bool:
        """Whether light may be summed together with what bounces, which is taken off again.

        Not where lamps may outshine the picture, of whose sum little would be left; not for single content,
        whose looks must agree with what is written to 2e-9; and not where `top` can be the limit.
        """
        asked = max(self._greatest_lo, np.inf if dtype == np.float16 else 1.0)
        return dtype != np.float32 and self.ambient is None and top >= asked

    @cached_property
    def _greatest_lo(self) -> float:
        return float(self.lo.max())

    @cached_property
    def in_c(self) -> dict[str, NDArray[Any] | None]:
        """Arrays that every call takes, with room behind what vectors read."""
        grid = self.grid
        fields = {
            **{"least": self.lo, "most": self.hi, "gain": self.gain},
            **{"area": self.solid_angle_sr, **self.at_edges},
        }
        found: dict[str, NDArray[Any] | None] = {n: spared(f) for n, f in fields.items()}
        for name, places in grid.places.items():
            found |= {f"{name}_{part}": numbers for part, numbers in places.items()}
        return found | {"down": grid.down, "rows": grid.rows}


def spared(plane: Plane | None) -> Plane | None:
    """A copy with room for vectors to read past its end, or None."""
    if plane is None:
        return None
    return np.concatenate([plane.astype(np.float32).ravel(), np.zeros(SPARE, np.float32)])
