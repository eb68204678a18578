"""The structured-light codes, as lists of pictures; `decode` reads what comes back.

Every picture of a code varies along one axis only, so that a code is a list of lines.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.maths.codes.gray import (
    bit_count,
    long_run_codewords,
    plain_codewords,
    xor_codewords,
)
from procam.maths.codes.phase import (
    Waves,
    equal_steps,
    heterodyne_waves,
    micro_waves,
    period_scale,
    sine_line,
)

Picture = NDArray[np.uint8]
Axis = Literal["x", "y"]
AXES: tuple[Axis, Axis] = ("x", "y")
NOMINAL_GAMMA = 2.2  # of a projector's response, undone in sinusoidal pictures
ORDER_PERIOD, ORDER_STEPS = 64.0, 8  # of the N-step code whose fringes are numbered by Gray planes
COARSE_PLANES = 4
LARGEST_PX = 16384
SLACK = 0.1  # of a stripe: how far outside the coarse stripe it is seen in a wave may be
GOLDEN = 0.6180339887


@dataclass(frozen=True, slots=True)
class Plane:
    """One picture of a code.

    Attributes
    ----------
    kind : "white", "black", "binary" or "sine". axis : along which it varies, empty for the first two.
    bit, inverse : which plane of the codewords, 0 = least significant. period, shift : [px], [rad].
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
    """How one axis is coded.

    Attributes
    ----------
    length : columns or rows. waves : the sinusoidal pictures, if any.
    codewords : (M,) of M stripes, each `stripe` [px] wide, `bits` planes; None without binary planes.
    inverses : whether each binary plane is followed by its inverse.
    """

    length: int
    waves: Waves | None = None
    codewords: NDArray[np.integer] | None = None
    stripe: float = 1.0
    inverses: bool = True

    @property
    def bits(self) -> int:
        """Number of binary planes."""
        return 0 if self.codewords is None else bit_count(len(self.codewords))

    def numbered(
        self, x: NDArray[np.floating], stripe: NDArray[np.floating]
    ) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
        """Places x [px] of waves seen in stripes `stripe`: their fringes numbered, if they cannot.

        Also whether the two agree.
        """
        centre = (stripe + 0.5) * self.stripe - 0.5
        slack = SLACK * self.stripe
        if self.waves is not None and self.waves.single:
            period = x.dtype.type(self.waves.periods[0])
            x = x + period * np.rint((centre - x) / period)
            slack = 0.5 * self.stripe
        with np.errstate(invalid="ignore"):
            agree = np.abs(x - centre) <= 0.5 * self.stripe + slack
        return np.where(agree, x, np.nan), agree

    def planes(self, axis: Axis) -> list[Plane]:
        """The pictures of this axis in the order they are shown."""
        planes = []
        if self.waves is not None:
            for period, shift in zip(self.waves.periods, self.waves.shifts, strict=True):
                planes.append(Plane("sine", axis, period=float(period), shift=float(shift)))
        for bit in reversed(range(self.bits)):
            for inverse in (False, True) if self.inverses else (False,):
                planes.append(Plane("binary", axis, bit, inverse))
        return planes

    def line(self, plane: Plane) -> NDArray[np.float64]:
        """Values (length,) in 0..1, in linear light."""
        if plane.kind == "sine":
            return sine_line(self.length, plane.period, plane.shift)
        assert self.codewords is not None
        words = self.codewords[((np.arange(self.length) + 0.5) / self.stripe).astype(int)]
        return (((words >> plane.bit) & 1) ^ int(plane.inverse)).astype(float)


@dataclass(frozen=True)
class Code:
    """A structured-light code for a panel of `size` (width, height)."""

    name: str
    size: tuple[int, int]
    x: AxisCode
    y: AxisCode
    planes: tuple[Plane, ...] = field(init=False)

    def __post_init__(self) -> None:
        planes = [Plane("white"), Plane("black"), *self.x.planes("x"), *self.y.planes("y")]
        object.__setattr__(self, "planes", tuple(planes))

    def planes_of(self, axis: Axis) -> list[int]:
        """Numbers of the pictures that vary along one axis."""
        return [i for i, plane in enumerate(self.planes) if plane.axis == axis]

    def axis(self, name: Axis) -> AxisCode:
        """The coding of columns ("x") or rows ("y")."""
        return self.x if name == "x" else self.y

    @property
    def has_waves(self) -> bool:
        """Whether places between pixels are told."""
        return self.x.waves is not None


def make_code(name: str, size: tuple[int, int]) -> Code:
    """The code of a name in `CODES` for a panel of `size` (width, height)."""
    if name not in CODES:
        raise InputError(f"code: got {name!r}, expected one of {', '.join(CODES)}")
    if min(size) < 2 or max(size) > LARGEST_PX:
        raise InputError(
            f"size: got {size[0]}x{size[1]}, expected at least 2x2 and at most "
            f"{LARGEST_PX}x{LARGEST_PX} px"
        )
    build = CODES[name]
    return Code(name, size, build(size[0], size), build(size[1], size))


def wave_code(size: tuple[int, int], periods: tuple[float, float], steps: int = 8) -> Code:
    """N-step waves of one period per axis [px] and nothing to number them: for one fringe."""
    waves = [Waves(np.full(steps, float(p)), equal_steps(steps), steps) for p in periods]
    return Code("wave", size, AxisCode(size[0], waves[0]), AxisCode(size[1], waves[1]))


def generate(code: Code, gamma: float = NOMINAL_GAMMA) -> list[Picture]:
    """The pictures (H, W, 1) of a code, in the order of `code.planes`.

    Sinusoids are encoded for a projector of response `gamma`. Their rounding to 8 bits is spread
    differently over neighbouring lines, so that a camera pixel averages it away.
    """
    return [picture(code, plane, gamma) for plane in code.planes]


def picture(code: Code, plane: Plane, gamma: float = NOMINAL_GAMMA) -> Picture:
    """One picture (H, W, 1) of a code."""
    width, height = code.size
    if plane.axis == "":
        return np.full((height, width, 1), 255 if plane.kind == "white" else 0, np.uint8)
    drive = 255 * code.axis(plane.axis).line(plane) ** (1 / gamma)
    across = height if plane.axis == "x" else width
    spread = (np.arange(across) * GOLDEN) % 1.0
    lines = np.floor(drive[None, :] + spread[:, None]).clip(0, 255).astype(np.uint8)
    return np.ascontiguousarray(lines if plane.axis == "x" else lines.T)[..., None]


def _binary(codewords: Callable[[int], NDArray[np.integer]]) -> Callable[..., AxisCode]:
    return lambda length, size: AxisCode(length, codewords=codewords(length))


def _micro(length: int, size: tuple[int, int]) -> AxisCode:
    return AxisCode(length, micro_waves(size))


def _micro_checked(length: int, size: tuple[int, int]) -> AxisCode:
    """Micro phase shifting and coarse stripes that must agree with it."""
    stripes = min(2**COARSE_PLANES, length)
    return AxisCode(length, micro_waves(size), long_run_codewords(stripes), length / stripes)


def _heterodyne(length: int, size: tuple[int, int]) -> AxisCode:
    return AxisCode(length, heterodyne_waves(size))


def _phase_gray(length: int, size: tuple[int, int]) -> AxisCode:
    """N-step waves, fringes numbered in half periods by Gray planes."""
    period = ORDER_PERIOD * period_scale(size)
    waves = Waves(np.full(ORDER_STEPS, period), equal_steps(ORDER_STEPS), ORDER_STEPS)
    halves = max(2, int(np.ceil(2 * length / period)))
    return AxisCode(length, waves, plain_codewords(halves), period / 2, inverses=False)


DEFAULT_CODE = "micro-phase"
CODES: dict[str, Callable[[int, tuple[int, int]], AxisCode]] = {
    "micro-phase": _micro,
    "micro-phase-checked": _micro_checked,
    "gray": _binary(plain_codewords),
    "gray-wide": _binary(long_run_codewords),
    "xor-02": _binary(lambda length: xor_codewords(length, 0)),
    "xor-04": _binary(lambda length: xor_codewords(length, 1)),
    "phase-gray": _phase_gray,
    "phase-heterodyne": _heterodyne,
}
