"""The structured-light codes as lists of patterns; `decode` reads the photographs of them.

A code is white, black, then the patterns of the columns, then those of the rows. Each pattern varies
along one axis only, so it is computed as one line and repeated. Stripes (Gray) identify whole
columns; sinusoids also give the position within a column. `CODES` holds the codes by name; to add
one, write the function that builds one of its axes and enter it there.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array
from procam.errors import InputError
from procam.maths.codes.gray import encode_gray
from procam.maths.codes.phase import Waves, heterodyne_waves, micro_waves, sine_line

Picture = NDArray[np.uint8]
Axis = Literal["x", "y"]
AXES: tuple[Axis, Axis] = ("x", "y")
NAMES: dict[Axis | str, str] = {"x": "columns", "y": "rows"}
NOMINAL_GAMMA = 2.2  # of a projector's response; sinusoidal patterns are encoded for it
LARGEST_PX = 16384  # of a panel's side: codewords have at most 14 bits
GOLDEN_RATIO = 0.6180339887


@dataclass(frozen=True, slots=True)
class Plane:
    """One pattern of a code.

    Attributes
    ----------
    kind : "white", "black", "binary" or "sine". axis : along which it varies, empty for the first two.
    bit, inverse : which bit of the codewords, 0 = least significant. period, shift : [px], [rad].
    """

    kind: Literal["white", "black", "binary", "sine"]
    axis: Literal["x", "y", ""] = ""
    bit: int = 0
    inverse: bool = False
    period: float = 0.0
    shift: float = 0.0

    def __str__(self) -> str:
        axis = {"x": "column", "y": "row", "": ""}[self.axis]
        if self.kind == "binary":
            return f"{axis} bit {self.bit}{' inverse' if self.inverse else ''}"
        if self.kind == "sine":
            return f"{axis} wave {self.period:.4g} px at {np.degrees(self.shift):.0f} deg"
        return self.kind


@dataclass(frozen=True)
class AxisCode:
    """How the columns or the rows are coded: by sinusoids, by codewords, or by both.

    Attributes
    ----------
    length : number of columns or rows. waves : the sinusoidal patterns, or None.
    codewords : (length,) of the stripe patterns, or None. With sinusoids they count the cells in
        which a phase lies.
    inverses : whether each stripe pattern is also shown with black and white exchanged.
    periods_shown : the periods in the order they are shown; as in `waves` if empty.
    """

    length: int
    waves: Waves | None = None
    codewords: NDArray[np.integer] | None = None
    inverses: bool = True
    periods_shown: tuple[float, ...] = ()

    def planes(self, axis: Axis) -> list[Plane]:
        """The patterns of this axis in the order they are shown: sinusoids, stripes from coarse to fine."""
        sines, shown = self.sines(axis), self.periods_shown
        if shown:
            sines.sort(key=lambda plane: shown.index(plane.period))
        both = (False, True) if self.inverses else (False,)
        bits = reversed(range(self.bits))
        return sines + [Plane("binary", axis, bit, inverse) for bit in bits for inverse in both]

    def sines(self, axis: Axis) -> list[Plane]:
        """The sinusoidal patterns in the order of `waves`."""
        if self.waves is None:
            return []
        each = zip(self.waves.periods.tolist(), self.waves.shifts.tolist(), strict=True)
        return [Plane("sine", axis, period=period, shift=shift) for period, shift in each]

    @property
    def resolution_px(self) -> int:
        """Columns that share a codeword, where stripes alone give the column; else 1."""
        if self.codewords is None or self.waves is not None:
            return 1
        return int(np.bincount(self.codewords).max())

    @property
    def bits(self) -> int:
        """Number of stripe patterns, inverses not counted."""
        return 0 if self.codewords is None else max(1, int(self.codewords.max()).bit_length())

    def line(self, plane: Plane) -> Array:
        """Values (length,) in 0..1, in linear light."""
        if plane.kind == "sine":
            return sine_line(self.length, plane.period, plane.shift)
        assert self.codewords is not None
        return (((self.codewords >> plane.bit) & 1) ^ int(plane.inverse)).astype(float)


@dataclass(frozen=True)
class Code:
    """A structured-light code for a panel of `size` (width, height).

    `blocks` is the order of its patterns in a folder, as `described.folder_order` takes it; empty for the
    usual order.
    """

    name: str
    size: tuple[int, int]
    x: AxisCode
    y: AxisCode
    blocks: tuple[str, ...] = ()
    planes: tuple[Plane, ...] = field(init=False)

    def __post_init__(self) -> None:
        planes = [Plane("white"), Plane("black"), *self.x.planes("x"), *self.y.planes("y")]
        object.__setattr__(self, "planes", tuple(planes))

    def planes_of(self, axis: Axis) -> list[int]:
        """Indices of the patterns that vary along one axis."""
        return [i for i, plane in enumerate(self.planes) if plane.axis == axis]

    def axis(self, name: Axis) -> AxisCode:
        """The coding of columns ("x") or rows ("y")."""
        return self.x if name == "x" else self.y

    @property
    def has_waves(self) -> bool:
        """Whether patterns of an axis are sinusoids, which give positions within a pixel."""
        return self.x.waves is not None or self.y.waves is not None


def make_code(name: str, size: tuple[int, int]) -> Code:
    """The code of a name in `CODES` for a panel of `size` (width, height) [px].

    Raises
    ------
    InputError : no code has this name, or the panel is too small or too large.
    """
    if name not in CODES:
        raise InputError(
            f"code: {name!r} is not a structured-light code of this version; choose "
            f"{', '.join(CODES)}. A session captured with another code must be captured again."
        )
    check_size(size)
    build = CODES[name]
    return Code(name, size, build(size[0], size), build(size[1], size))


def check_size(size: tuple[int, int]) -> None:
    """Refuse a panel of `size` (width, height) [px] that is too small or too large."""
    if min(size) < 2 or max(size) > LARGEST_PX:
        raise InputError(
            f"size: {size[0]}x{size[1]} px is not a panel that codes are made for; both sides must be "
            f"2 to {LARGEST_PX} px"
        )


def generate(code: Code, gamma: float = NOMINAL_GAMMA) -> list[Picture]:
    """The patterns (H, W, 1) of a code, in the order of `code.planes`.

    Sinusoids are encoded for a projector of response `gamma`. Their rounding to 8 bits differs
    between neighbouring lines, so that a camera pixel averages it away.
    """
    return [picture(code, plane, gamma) for plane in code.planes]


def picture(code: Code, plane: Plane, gamma: float = NOMINAL_GAMMA) -> Picture:
    """One pattern (H, W, 1) of a code."""
    width, height = code.size
    if plane.axis == "":
        return np.full((height, width, 1), 255 if plane.kind == "white" else 0, np.uint8)
    drive = 255 * code.axis(plane.axis).line(plane) ** (1 / gamma)
    across = height if plane.axis == "x" else width
    dither = (np.arange(across) * GOLDEN_RATIO) % 1.0
    lines = np.floor(drive[None, :] + dither[:, None]).clip(0, 255).astype(np.uint8)
    return np.ascontiguousarray(lines if plane.axis == "x" else lines.T)[..., None]


DEFAULT_CODE = "micro-phase"
CODES: dict[str, Callable[[int, tuple[int, int]], AxisCode]] = {
    "micro-phase": lambda length, size: AxisCode(length, micro_waves(size)),
    "gray": lambda length, _: AxisCode(length, codewords=encode_gray(np.arange(length))),
    "phase-heterodyne": lambda length, size: AxisCode(length, heterodyne_waves(size)),
}
