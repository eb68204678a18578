"""Photographs of a set with another exposure than white: found, named, and scaled without loss."""

import numpy as np
import pytest
from foreign_sets import SIZE, Set, gray, photograph, steps

from procam.errors import InputError
from procam.estimate.structured_light.codes import Code, make_code
from procam.estimate.structured_light.consistency import probe_places
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.described import described_code, folder_order
from procam.estimate.structured_light.exposures import scaled
from procam.estimate.structured_light.set_checks import SetReport, examine
from procam.model.code_description import AxisDescription, CodeDescription
from procam.model.correspondence import CorrespondenceMap

LEVELS = [(np.ones(max(SIZE)), 0), (np.zeros(max(SIZE)), 0)]
FOUR_STEPS = AxisDescription((16.0, 18.5, 21.0), tuple(np.pi / 2 * np.arange(4)))
CELLS = AxisDescription((16.0, 18.0), tuple(2 * np.pi * np.arange(3) / 3), 16)


def described(one: AxisDescription) -> Code:
    return described_code(CodeDescription("theirs", one, one), SIZE)


def four_steps(axis: int) -> list[tuple[np.ndarray, int]]:
    return [(line, axis) for period in (16, 18.5, 21) for line in steps(period, 4)]


def cells(axis: int) -> list[tuple[np.ndarray, int]]:
    phases = [(line, axis) for period in (16, 18) for line in steps(period, 3)]
    return phases + [(line, axis) for line in gray(SIZE[axis], 16)]


def stripes(axis: int) -> list[tuple[np.ndarray, int]]:
    return [(each, axis) for line in gray(SIZE[axis], 1) for each in (line, 1 - line)]


SETS = {
    "four steps": (described(FOUR_STEPS), [*LEVELS, *four_steps(0), *four_steps(1)]),
    "cells": (described(CELLS), [*LEVELS, *cells(0), *cells(1)]),
    "stripes": (make_code("gray", SIZE), [*stripes(0), *stripes(1), *LEVELS]),
}


def names(count: int) -> list[str]:
    return [f"img_{i:03d}.png" for i in range(count)]


def examined(code: Code, taken: Set, *, anyway: bool = False) -> SetReport:
    places = probe_places(taken.photographs[0].shape)
    probes = [p[places] for p in taken.photographs]
    return examine(code, folder_order(code), probes, names(len(probes)), anyway=anyway)


def decoded(code: Code, taken: Set, report: SetReport) -> CorrespondenceMap:
    decoder = Decoder(code)
    black = report.order[1]
    assert black is not None
    for plane, photo in enumerate(report.order):
        if photo is not None:
            image, gain = taken.photographs[photo], report.gains.get(photo, 1.0)
            decoder.add(plane, scaled(image, taken.photographs[black], gain))
    return decoder.result().map


@pytest.mark.parametrize("name", SETS)
def test_a_sound_set_is_not_scaled(name: str) -> None:
    code, lines = SETS[name]
    report = examined(code, photograph(lines, np.random.default_rng(1)))
    assert (report.gains, report.notes) == ({}, [])


@pytest.mark.parametrize(("at", "factor"), [(4, 0.7), (7, 1.4), (13, 0.7)])
@pytest.mark.parametrize("name", SETS)
def test_a_jump_costs_nothing(name: str, at: int, factor: float) -> None:
    """Within the base, within an axis, and at its border; between a pattern and its inverse too."""
    code, lines = SETS[name]
    after = len(lines) - at
    taken = photograph(lines, np.random.default_rng(at), exposures=[1.0] * at + [factor] * after)
    report = examined(code, taken)
    levels_first = folder_order(code)[0] == 0
    last = names(len(lines))[-1] if levels_first else f"img_{at - 1:03d}.png"
    first = f"img_{at:03d}.png" if levels_first else "img_000.png"
    (note,) = report.notes
    assert note.startswith(f"{first} to {last}: exposed ")
    shown = factor if levels_first else 1 / factor
    assert np.allclose(list(report.gains.values()), shown, rtol=0.03)
    found = decoded(code, taken, report)
    use = taken.inside() & found.valid
    assert use.sum() > (0.85 if name == "stripes" else 0.97) * taken.inside().sum()
    score = ((found.projector_xy - taken.truth) / found.sigma_px)[use]
    assert np.mean(np.abs(score) < 2) > 0.93
    assert 0.7 < np.sqrt(np.mean(score**2)) < 1.15


def test_one_photograph_alone() -> None:
    code, lines = SETS["four steps"]
    exposures = [1.0] * len(lines)
    exposures[9] = 1.3
    report = examined(code, photograph(lines, np.random.default_rng(4), exposures=exposures))
    (note,) = report.notes
    assert note.startswith("img_009.png: exposed 1.3")
    assert "as much as white, img_000.png; scaled to it" in note


def test_a_check_that_is_overruled() -> None:
    """Black shows a pattern: the set is refused, or put in order without its white and black."""
    code, lines = SETS["four steps"]
    taken = photograph([lines[0], lines[5], *lines[2:]], np.random.default_rng(5))
    with pytest.raises(InputError, match=r"img_001\.png should show black"):
        examined(code, taken)
    report = examined(code, taken, anyway=True)
    (refusal,) = report.refused
    assert "img_001.png should show black" in refusal
    assert (report.levels, report.order) == (False, folder_order(code))
    assert report.notes == [
        "white and black are replaced by the brightest and darkest of all pictures"
    ]
