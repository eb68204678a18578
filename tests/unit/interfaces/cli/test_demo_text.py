"""What `procam demo` prints for people."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from procam.interfaces.cli.demo import COLUMNS, result_lines
from procam.model.quality import Figure, Goal

FIGURES = {
    "simulated_run_s": Figure(300.4, "s"),
    "shots": Figure(89, "-", Goal("<=", 120.0)),
    "direction_error_relative_rms_arcmin": Figure(0.1318, "arcmin", Goal("<=", 0.5)),
    "direction_error_rms_arcmin": Figure(0.742, "arcmin", Goal("<=", 2.0)),
    "dome_is_sphere": Figure(True, "-"),
    "scatter_before": Figure(0.18, "rel"),
    "scatter_left_exact": Figure(0.009, "-", Goal("<=", 0.02)),
    "scatter_left_refined": Figure(0.004, "-", Goal("<=", 0.02)),
}


def _text(figures: dict[str, Figure], dark: float = 0.0, preset: str = "standard") -> str:
    limits = SimpleNamespace(too_bright=np.array([0.05, 0.06, 0.07]), too_dark=np.full(3, dark))
    material: Any = SimpleNamespace(
        figures={name: figure.as_dict() for name, figure in figures.items()},
        preset=preset,
        calibration=SimpleNamespace(screen=SimpleNamespace(shape=SimpleNamespace(degree=4))),
        limits=lambda: limits,
    )
    lines = list(result_lines(material))
    assert all(line.isascii() for line in lines)
    assert len(lines) <= 12 and max(map(len, lines)) <= COLUMNS
    return " ".join(" ".join(lines).split())


def test_a_result_in_words() -> None:
    text = _text(FIGURES)
    assert "projector pixels are 0.13 arcmin off relative to each other" in text
    assert "with the survey of the marks 0.74 arcmin" in text
    assert "0.05 pixels of a dome master of 4096 px" in text  # of 2.637 arcmin
    assert "Screen: a sphere" in text
    assert "adds 18 % of white" in text
    assert "0.4 % of it remains after compensation" in text
    assert "6 % of the lit picture asks for less light" in text
    assert "negative light" in text
    assert "300 s on this computer, with 89 photographs" in text
    assert "more light than" not in text and "missed" not in text


def test_what_compensation_leaves_is_apart_from_what_projectors_draw() -> None:
    judged = {
        "interreflection_left": Figure(0.0029, "-", Goal("<=", 0.01)),
        "picture_error_jnd": Figure(2.345, "JND"),
        "picture_error_jnd_before": Figure(31.2, "JND"),
    }
    text = _text(FIGURES | judged)
    assert "0.29 % of it remains where projectors draw exactly what they are asked" in text
    assert "for, 0.4 % as they draw." in text
    assert "lit is within 2.3 just noticeable differences of what was meant" in text
    assert "uncompensated within 31." in text


def test_a_slow_computer_misses_no_goal() -> None:
    text = _text(FIGURES | {"simulated_run_s": Figure(1e5, "s")})
    assert "FAIL" not in text and "missed" not in text


def test_what_is_wrong_is_named() -> None:
    missed = replace(FIGURES["scatter_left_refined"], value=0.03)
    wrong = {"dome_is_sphere": Figure(False, "-"), "scatter_left_refined": missed}
    text = _text(FIGURES | wrong, dark=0.02)
    assert "not a sphere; its shape was solved up to harmonics of degree 4" in text
    assert "2 % asks for more light than the projectors have" in text
    assert (
        "Goals missed: Bounced light that remains after the loop: 3 %, should be at most 2 %"
        in text
    )


def test_a_server_aligns_its_own_pixels() -> None:
    assert "the media server's pixels are 0.13 arcmin off" in _text(FIGURES, preset="server")


def test_figures_that_a_preset_lacks_are_left_out() -> None:
    assert "Geometry" not in _text({"shots": FIGURES["shots"]})
