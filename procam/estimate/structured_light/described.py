"""Codes of other programs from their description, and the order in which folders hold patterns."""

from collections.abc import Sequence

import numpy as np

from procam.errors import InputError
from procam.estimate.structured_light.cells import predicted, stripe_lines
from procam.estimate.structured_light.codes import AXES, NAMES, AxisCode, Code, check_size
from procam.kernels.search.api import MOST_FRAMES
from procam.maths.codes.gray import encode_gray
from procam.maths.codes.phase import WaveDistortion, Waves
from procam.model.code_description import AxisDescription, CodeDescription

USUAL_BLOCKS = ("white", "black", "columns", "rows")
STRIPE_BLOCKS = ("columns", "rows", "white", "black")  # as OpenCV's
MIN_STEPS = 3
ALIKE = 1e-3  # squared difference of two columns, in amplitudes: no camera separates fewer


def described_code(description: CodeDescription, size: tuple[int, int]) -> Code:
    """The code of a description on a panel of `size` (width, height) [px].

    Raises
    ------
    InputError : steps that do not determine a phase, too many patterns, or columns that look alike.
    """
    check_size(size)
    axes = zip(AXES, (description.columns, description.rows), size, strict=True)
    built = {axis: _axis(NAMES[axis], one, length) for axis, one, length in axes}
    return Code(description.name, size, built["x"], built["y"], description.order or USUAL_BLOCKS)


def unseen_errors(code: Code) -> list[str]:
    """A note for each axis whose patterns cannot show an error that they have."""
    axes = {NAMES[axis]: code.axis(axis).waves for axis in AXES}
    return [
        f"{name}: three steps of one period do not show whether projector and camera are linear; the "
        "standard error allows for a gamma 15 % off; four steps or two periods show it"
        for name, waves in axes.items()
        if waves is not None and len(waves.periods) == MIN_STEPS
    ]


def folder_order(code: Code) -> list[int]:
    """Planes of a code in the order of a folder, from its `blocks`.

    A block is "white", "black", "columns", "rows", or a part of an axis: "columns-phase", "columns-gray",
    "columns-inverses". An axis alone means its parts that are not named, each inverse after its pattern.
    Without blocks white and black come first; last for plain stripes.

    Raises
    ------
    InputError : an unknown block, or patterns that no block or two blocks name.
    """
    given = code.blocks or (USUAL_BLOCKS if code.has_waves else STRIPE_BLOCKS)
    names = [_part(code, number) for number in range(len(code.planes))]
    order: list[int] = []
    for block in given:
        found = [i for i, name in enumerate(names) if _shows(block, name, given)]
        if not found:
            raise InputError(
                f"order: {block!r} names no patterns of the code {code.name}; its blocks are "
                f"{', '.join(dict.fromkeys(names))}, and columns or rows for what remains"
            )
        order += found
    missing = [name for i, name in enumerate(names) if i not in order]
    if missing or len(order) > len(names):
        raise InputError(
            f"order: {missing[0] if missing else 'a block'} must be named once; name white, black, "
            "columns and rows, or their parts"
        )
    return order


def _part(code: Code, number: int) -> str:
    plane = code.planes[number]
    if plane.axis == "":
        return plane.kind
    kind = "phase" if plane.kind == "sine" else "inverses" if plane.inverse else "gray"
    return f"{NAMES[plane.axis]}-{kind}"


def _shows(block: str, name: str, given: Sequence[str]) -> bool:
    """Whether a block contains the patterns of this name."""
    return block == name or (name.startswith(f"{block}-") and name not in given)


def _axis(name: str, one: AxisDescription, length: int) -> AxisCode:
    words = encode_gray(np.arange(length) // one.cell_px) if one.cell_px else None
    coding = AxisCode(length, _waves(name, one), words, one.inverses, one.periods_px)
    alike = _alike(coding)
    if alike:
        raise InputError(
            f"{name}: {alike[0]} and {alike[1]} get the same pictures in this description; it needs "
            "another period, or Gray cells no wider than the shortest period"
        )
    return coding


def _waves(name: str, one: AxisDescription) -> Waves | None:
    """The sinusoids, with the shortest period first, from which a decoder starts."""
    if not one.periods_px:
        return None
    shifts = np.array(one.shifts_rad)
    circle = np.exp(1j * shifts)
    apart = np.abs(circle[:, None] - circle[None, :]) + np.eye(len(shifts))
    if (
        len(shifts) < MIN_STEPS
        or apart.min() < 1e-3
        or len(set(one.periods_px)) < len(one.periods_px)
    ):
        raise InputError(
            f"{name}: periods and shifts must differ from each other, and {MIN_STEPS} shifts or more are "
            "needed to determine a phase"
        )
    if len(shifts) * len(one.periods_px) > MOST_FRAMES:
        raise InputError(
            f"{name}: at most {MOST_FRAMES} sinusoidal patterns can be decoded per axis"
        )
    periods = np.sort(np.array(one.periods_px, float))
    each = len(shifts)
    return Waves(np.repeat(periods, each), np.tile(shifts, len(periods)), each)


def _alike(coding: AxisCode) -> tuple[int, int] | None:
    """Two columns whose patterns hardly differ, if there are any."""
    if coding.waves is None:
        return None
    period = float(coding.waves.periods[0])
    lines = stripe_lines(coding)
    columns = np.arange(coding.length, dtype=float)
    values = predicted(columns, coding.waves, WaveDistortion(), lines)
    for turn in range(1, int(coding.length / period) + 1):
        first = columns[columns + turn * period <= coding.length - 1]
        other = predicted(first + turn * period, coding.waves, WaveDistortion(), lines)
        apart = np.sum((other - values[: len(first)]) ** 2, axis=1)
        if apart.size and apart.min() < ALIKE:
            worst = int(apart.argmin())
            return worst, round(worst + turn * period)
    return None
