"""The model of a dome for the frame kernels: fields at nodes, derived arrays, how blocks are summed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, Map
from procam.errors import InputError, ShapeError
from procam.kernels.frame.grid import CHANNELS, Grid
from procam.kernels.native.arrays import check_numbers

TERMS = 9
SPARE = 64  # floats that vectors may read past the end of a field
EVERYWHERE = 2  # as in native/kernels.h


@dataclass(frozen=True, eq=False)
class FrameModel:
    """The fields that compensate pictures of `size`, on a dome master of M x M nodes, M <= size.

    Light to send is clip(gain t - b, lo, hi), t the content in linear light and b the scattered light,
    a field like the others (`scattered_light`). Fields are bilinear between nodes. In sums, directions
    are interpolated between every few node rows only (`Grid.edges`), and solid angles too where they
    are linear there.

    Attributes
    ----------
    spread : (M, M, 3) scattered light per flux [1/sr]. lo : (M, M, 3) [rel]. hi, ambient : (M, M, 3)
        [rel], or None. gain : (M, M) or None. coverage : (M, M), 0 where no light is sent.
    solid_angle_sr : (M, M) of a pixel of the picture, above 0 exactly where coverage is.
    direction : (3, M, M) unit vectors. terms : 1, 4 or 9, of the polynomial.

    What is derived from the fields is kept, so they must not be changed.
    """

    size: int
    spread: Map
    lo: Map
    hi: Map | None
    ambient: Map | None
    gain: Map | None
    coverage: Map
    solid_angle_sr: Map
    direction: Map
    terms: int = 1

    def __post_init__(self) -> None:
        if self.coverage.ndim != 2:
            raise ShapeError("field coverage", self.coverage.shape, "(M, M)")
        nodes = self.coverage.shape[0]
        plane: tuple[int, ...] = (nodes, nodes)
        colours: tuple[int, ...] = (nodes, nodes, CHANNELS)
        shapes = dict.fromkeys(("coverage", "gain", "solid_angle_sr"), plane)
        shapes.update(dict.fromkeys(("spread", "lo", "hi", "ambient"), colours))
        shapes["direction"] = (CHANNELS, nodes, nodes)
        for name, shape in shapes.items():
            field = getattr(self, name)
            if field is not None:
                check_numbers(field, shape, f"field {name}")
        if nodes > self.size:
            raise InputError(
                f"fields: {nodes} nodes are more than the picture's {self.size} px; sample them coarser"
            )
        if self.terms not in (1, 4, TERMS):
            raise InputError(f"terms: {self.terms} are not supported, only 1, 4 and {TERMS}")
        odd = int(((self.coverage > 0) != (self.solid_angle_sr > 0)).sum())
        if odd:
            raise InputError(
                f"solid_angle_sr: at {odd} nodes it or the coverage is 0, but not both; multiply the solid "
                "angles by the coverage"
            )

    @property
    def nodes(self) -> int:
        """Edge of the fields."""
        return int(self.coverage.shape[0])

    @cached_property
    def grid(self) -> Grid:
        """Positions of the picture's pixels among the nodes."""
        return Grid(self.size, self.nodes)

    @cached_property
    def at_edges(self) -> dict[str, Map]:
        """Fields at the edges of bands.

        `weight` (E, M), solid angle of a pixel [sr]; `edge_spread` (E, M, 3); `direction` (E, 3, M).
        """
        at_edges = self.grid.at_edges
        found = {
            "weight": at_edges(self.solid_angle_sr),
            "edge_spread": at_edges(self.spread),
            "direction": at_edges(np.moveaxis(self.direction, 0, 1)),
        }
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in found.items()}

    @cached_property
    def lit(self) -> NDArray[np.uint8]:
        """How blocks of the picture are lit, for each interval: see `Grid.lit`."""
        return self.grid.lit(self.solid_angle_sr)

    def variants(self, top: float) -> NDArray[np.uint8]:
        """`lit`, and where upper limits lie below `top`, the most light to send (enum lit)."""
        if top not in self._variants:
            limited = (self.lit == EVERYWHERE) & (self._least_hi < top)
            self._variants[top] = np.ascontiguousarray(self.lit + limited, np.uint8)
        return self._variants[top]

    @cached_property
    def _variants(self) -> dict[float, NDArray[np.uint8]]:
        return {}

    @cached_property
    def _least_hi(self) -> Map:
        """Least upper limit of each block (M + 1, blocks), infinite without limits."""
        if self.hi is None:
            return np.full(self.lit.shape, np.inf, np.float32)
        return self.grid.least(self.hi)

    @cached_property
    def in_c(self) -> dict[str, AnyArray | None]:
        """Arrays of the C struct that do not change from call to call, padded for vectors."""
        fields = {
            **{"least": self.lo, "most": self.hi, "gain": self.gain},
            **{"area": self.solid_angle_sr, **self.at_edges},
        }
        found: dict[str, AnyArray | None] = {n: padded(f) for n, f in fields.items()}
        return found | {name: getattr(self.grid, name) for name in ("down", "along", "rows")}


def zeros_to_pad(shape: tuple[int, ...]) -> Map:
    """A field of zeros that `padded` need not copy."""
    size = int(np.prod(shape))
    return np.zeros(size + SPARE, np.float32)[:size].reshape(shape)


def padded(plane: Map | None) -> Map | None:
    """A flat array of a field and zeros after it, which vectors may read; or None.

    The field's own memory if it has that, as of `zeros_to_pad`; else a copy.
    """
    if plane is None:
        return None
    buffer = plane.base
    if isinstance(buffer, np.ndarray) and _padded_alone(buffer, plane):
        return buffer
    return np.concatenate([plane.ravel(), np.zeros(SPARE, np.float32)], dtype=np.float32)


def _padded_alone(buffer: AnyArray, plane: Map) -> bool:
    """Whether a flat array is a field and zeros: a node without weight may lie there, and must not be NaN."""
    return (
        buffer.shape == (plane.size + SPARE,)
        and buffer.dtype == np.float32 == plane.dtype
        and buffer.ctypes.data == plane.ctypes.data
        and plane.flags.c_contiguous
        and plane.flags.aligned
        and not buffer[plane.size :].any()
    )
