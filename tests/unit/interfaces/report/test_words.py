"""Figures in words."""

from dataclasses import replace

import numpy as np

from procam.interfaces.report.words import NAMES, goal_text, number, percent, value_text
from procam.model.quality import Figure, Goal
from procam.workflows.refine.refine import Refined

MINUS, THIN = "\N{MINUS SIGN}", "\N{NARROW NO-BREAK SPACE}"


def test_words_for_numbers():
    entry = Figure(-0.0061, "-", Goal("abs<=", 0.02)).as_dict()
    assert value_text("feedback_error", entry) == f"{MINUS}0.61{THIN}%"
    assert goal_text("feedback_error", entry) == f"within \N{PLUS-MINUS SIGN}2{THIN}%"
    assert value_text("shots", Figure(12345, "-").as_dict()) == f"12{THIN}345"
    assert goal_text("x", Figure(True, "-", Goal("==", True)).as_dict()) == "yes"
    assert percent(0.15678, 2) == f"16{THIN}%"
    assert [number(value, 2) for value in (152.0, 0.0123, 12.34)] == ["150", "0.012", "12"]


def test_every_figure_of_the_loop_has_words():
    same = np.zeros((2, 2, 3))
    refined = Refined(
        calibration=None,
        residual=[0.01, 0.0042],
        own_residual=0.004,
        noise_floor=0.003,
        left_jnd=[9.0, 0.81],
        own_jnd=0.9,
        unseen=(0.02, 0.003),
        photographs={},
        target=same,
        free=same == 0,
        scatter_factor=np.array([1.0, 1.1, 0.95]),
        level=0.79,
        shots=9,
        per_picture=4,
        worse="",
        better=True,
    )
    (note,) = refined.notes()
    assert note.startswith("photographs are 79% as bright as predicted")
    assert not replace(refined, level=0.95).notes()
    figures = refined.figures()
    assert figures.keys() <= NAMES.keys()
    text = {name: value_text(name, figure.as_dict()) for name, figure in figures.items()}
    assert text["loop_residual_own"] == f"0.4{THIN}%"
    assert (
        text["loop_left_jnd_by_iteration"] == "9\N{NO-BREAK SPACE}JND / 0.81\N{NO-BREAK SPACE}JND"
    )
    assert text["loop_own_jnd"] == "0.9\N{NO-BREAK SPACE}JND"
    assert text["loop_unseen_residual"] == f"2{THIN}% / 0.3{THIN}%"
    assert text["loop_scatter_factor"] == "1 / 1.1 / 0.95"
