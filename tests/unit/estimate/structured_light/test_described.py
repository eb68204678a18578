"""Codes of other programs: patterns and photographs of `foreign_sets`, which shares nothing with decoders."""

import re

import numpy as np
import pytest
from foreign_sets import SIZE, Set, gray, photograph, steps

from procam.errors import InputError
from procam.estimate.structured_light.codes import Code, generate, make_code
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.described import described_code, folder_order
from procam.estimate.structured_light.sinusoids import unseen_harmonic_px
from procam.maths.codes.phase import Waves, equal_steps
from procam.model.code_description import AxisDescription, CodeDescription
from procam.model.correspondence import CorrespondenceMap

LEVELS = [(np.ones(max(SIZE)), 0), (np.zeros(max(SIZE)), 0)]
GRAY_CELLS = AxisDescription((16.0, 18.0), tuple(2 * np.pi * np.arange(3) / 3), 16)
ONE_PERIOD = AxisDescription((16.0,), tuple(2 * np.pi * np.arange(3) / 3), 16, inverses=True)
WIDE_STRIPES = AxisDescription(cell_px=2, inverses=True)
FREQUENCIES = AxisDescription((192.0, 48.0, 12.0), tuple(np.pi / 2 * np.arange(4)))
UNSEEN_PX = unseen_harmonic_px(Waves(np.full(3, 16.0), equal_steps(3), 3))
CASES = {
    "two periods and Gray cells": GRAY_CELLS,
    "one period and Gray cells": ONE_PERIOD,
    "wide stripes": WIDE_STRIPES,
    "three frequencies": FREQUENCIES,
}


def described(axis: AxisDescription, order: tuple[str, ...] = ()) -> Code:
    return described_code(CodeDescription("theirs", axis, axis, order), SIZE)


def drawn(one: AxisDescription) -> list[tuple[np.ndarray, int]]:
    """The patterns of both axes, each period's steps, then each Gray pattern and its inverse."""
    lines: list[tuple[np.ndarray, int]] = []
    for axis in (0, 1):
        for period in one.periods_px:
            lines += [(line, axis) for line in steps(period, len(one.shifts_rad))]
        if one.cell_px:
            for line in gray(SIZE[axis], one.cell_px):
                lines += [(line, axis), (1 - line, axis)] if one.inverses else [(line, axis)]
    return lines


def decoded(code: Code, taken: Set) -> CorrespondenceMap:
    decoder = Decoder(code)
    by_plane = dict(zip(folder_order(code), taken.photographs, strict=True))
    for plane in sorted(by_plane):
        decoder.add(plane, by_plane[plane])
    return decoder.result().map


def check(
    found: CorrespondenceMap, taken: Set, coverage: float = 0.97, unseen_px: float = 0.0
) -> None:
    """Most pixels are known, 95 % of them within two standard errors, which are as large as the errors.

    `unseen_px` is the part of the standard error for a wrong gamma, which these pictures do not have.
    """
    use = taken.inside() & found.valid
    assert use.sum() > coverage * taken.inside().sum()
    error = (found.projector_xy - taken.truth)[use]
    score = error / np.sqrt(found.sigma_px[use] ** 2 - unseen_px**2)
    assert np.mean(np.abs(score) < 2) > 0.93
    assert 0.7 < np.sqrt(np.mean(score**2)) < 1.15
    assert np.abs(score).max() < 6


@pytest.mark.parametrize("case", CASES)
def test_columns_lie_within_their_sigmas(case: str) -> None:
    taken = photograph(LEVELS + drawn(CASES[case]), np.random.default_rng(11))
    check(
        decoded(described(CASES[case]), taken), taken, unseen_px=UNSEEN_PX * ("one period" in case)
    )


def test_patterns_then_inverses_white_and_black_last() -> None:
    """The order of the sets of gsoup."""
    lines = [(line, axis) for axis in (0, 1) for line in gray(SIZE[axis], 1)]
    lines += [(1 - line, axis) for line, axis in lines]
    taken = photograph(lines + LEVELS, np.random.default_rng(12))
    blocks = ("columns", "rows", "columns-inverses", "rows-inverses", "white", "black")
    check(decoded(described(AxisDescription(cell_px=1, inverses=True), blocks), taken), taken, 0.85)


def test_each_axis_has_its_own_code() -> None:
    both = CodeDescription("mixed", FREQUENCIES, WIDE_STRIPES)
    lines = [p for p in drawn(FREQUENCIES) if p[1] == 0] + [p for p in drawn(WIDE_STRIPES) if p[1]]
    taken = photograph(LEVELS + lines, np.random.default_rng(13))
    check(decoded(described_code(both, SIZE), taken), taken)


def test_cells_at_their_edges() -> None:
    """Where a stripe pattern is grey, no column is off by a period, even three pixels out of focus."""
    taken = photograph(LEVELS + drawn(ONE_PERIOD), np.random.default_rng(14), blur_px=3.0)
    found = decoded(described(ONE_PERIOD), taken)
    use = taken.inside() & found.valid
    assert use.sum() > 0.97 * taken.inside().sum()
    assert np.abs(found.projector_xy - taken.truth)[use].max() < 1.5


@pytest.mark.parametrize(
    ("one", "turn_deg"),
    [(GRAY_CELLS, 30.0), (ONE_PERIOD, -75.0)],
    ids=["two periods", "one period"],
)
def test_shifts_wrong_by_one_angle_are_refused(one: AxisDescription, turn_deg: float) -> None:
    turned = AxisDescription(
        one.periods_px, tuple(np.array(one.shifts_rad) + np.radians(turn_deg)), 16, one.inverses
    )
    taken = photograph(LEVELS + drawn(one), np.random.default_rng(16))
    decoder = Decoder(described(turned))
    for plane, picture in enumerate(taken.photographs):
        decoder.add(plane, picture)
    for name, why in zip(("columns", "rows"), decoder.result().refused, strict=True):
        stated = re.search(rf"{name}: the edges of the Gray cells lie ([0-9.]+) px", why)
        assert stated is not None
        assert float(stated[1]) == pytest.approx(16 * abs(turn_deg) / 360, abs=0.25)


def test_a_lost_gray_pattern_is_computed_from_its_inverse() -> None:
    code = described(ONE_PERIOD)
    taken = photograph(LEVELS + drawn(ONE_PERIOD), np.random.default_rng(15))
    decoder = Decoder(code)
    for plane, picture in enumerate(taken.photographs):
        if str(code.planes[plane]) != "column bit 2":
            decoder.add(plane, picture)
    check(decoder.result().map, taken, unseen_px=UNSEEN_PX)


def test_patterns_are_those_that_are_described() -> None:
    code = described(GRAY_CELLS)
    for plane, picture in zip(code.planes[2:], generate(code, gamma=1.0)[2:], strict=True):
        axis = 0 if plane.axis == "x" else 1
        shown = picture[..., 0].mean(axis=axis) / 255
        expected = (
            steps(plane.period, 3)[round(plane.shift / (2 * np.pi / 3))]
            if plane.kind == "sine"
            else gray(SIZE[axis], 16)[-1 - plane.bit]
        )
        np.testing.assert_allclose(shown, expected[: SIZE[axis]], atol=0.004)


class TestOrder:
    def test_periods_as_described(self) -> None:
        turned = AxisDescription((18.0, 16.0), GRAY_CELLS.shifts_rad, 16)
        code = described(turned)
        names = [str(code.planes[i]) for i in folder_order(code)]
        assert names[:3] == ["white", "black", "column wave 18 px at 0 deg"]
        assert names[5] == "column wave 16 px at 0 deg"

    def test_usual_orders(self) -> None:
        stripes = make_code("gray", (64, 32))
        assert folder_order(stripes)[-2:] == [0, 1]
        assert folder_order(make_code("micro-phase", (64, 32)))[:2] == [0, 1]

    @pytest.mark.parametrize(
        ("blocks", "message"),
        [
            (("white", "black", "columns", "diagonals"), "'diagonals' names no patterns"),
            (("white", "black", "columns"), "rows-phase must be named once"),
            (("white", "white", "black", "columns", "rows"), "must be named once"),
            (("white", "black", "columns", "rows-inverses", "rows"), "'rows-inverses' names no"),
        ],
    )
    def test_refusals(self, blocks: tuple[str, ...], message: str) -> None:
        with pytest.raises(InputError, match=message):
            folder_order(described(GRAY_CELLS, blocks))


class TestRefusals:
    def test_columns_that_look_alike(self) -> None:
        wide = AxisDescription((16.0,), GRAY_CELLS.shifts_rad, 32)
        with pytest.raises(InputError, match="columns: 0 and 16 get the same pictures"):
            described(wide)

    @pytest.mark.parametrize(
        "axis",
        [
            AxisDescription((16.0,), (0.0, 1.0), 16),
            AxisDescription((16.0,), (0.0, 1.0, 2 * np.pi), 16),
            AxisDescription((16.0, 16.0), GRAY_CELLS.shifts_rad, 16),
        ],
    )
    def test_steps_that_give_no_phase(self, axis: AxisDescription) -> None:
        with pytest.raises(InputError, match="columns: periods and shifts must differ"):
            described(axis)

    def test_too_many_patterns(self) -> None:
        many = AxisDescription(tuple(np.linspace(12, 60, 11)), GRAY_CELLS.shifts_rad)
        with pytest.raises(InputError, match="columns: at most 32 sinusoidal patterns"):
            described(many)
