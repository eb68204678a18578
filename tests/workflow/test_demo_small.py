"""The whole chain at a quarter of its size: capture, solve, refine, and only then the truth."""

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tiny_venue import Ran, contents, procam

from procam.estimate.closed_loop.patches import MAX_CORRECTIONS
from procam.files.calibration import load_calibration
from procam.interfaces.cli import demo
from procam.model.quality import Figure, Goal
from simulators import devices, truth
from simulators.scene import SceneSize
from simulators.template import venue_text

MASTER = 256  # of dome maps, content and truth
SMALL = SceneSize(
    projectors=2, projector_size=(320, 200), camera_size=(480, 480), rays=64, map_size=MASTER
)
FIGURES = {
    "direction_error_relative_rms_arcmin",
    "direction_error_rms_arcmin",
    "direction_error_max_arcmin",
    "solid_angle_sum_error",
    "feedback_error",
    "albedo_error",
    "albedo_interval_covers",
    "interreflection_left",
    "picture_error_jnd",
    "scatter_left_exact",
    "scatter_left_paper_eq12",
    "loop_residual_by_iteration",
    "loop_noise_floor",
    "simulated_run_s",
    "peak_memory_mib",
    "shots",
}


@dataclass(frozen=True)
class SmallRun:
    """A demo that was watched: `truths` holds, for every step, whether a truth/ was there."""

    out: Path
    ran: Ran
    truths: dict[str, list[bool]]

    @property
    def figures(self) -> dict[str, dict[str, Any]]:
        return dict(json.loads((self.out / "summary.json").read_text())["figures"])


def watched_demo(folder: Path) -> SmallRun:
    """`procam demo` at the small size, with a check for any truth at every step."""
    out = folder / "run"
    truths: dict[str, list[bool]] = {}

    def spied(step: str, real: Any) -> Any:
        def call(*arguments: Any, **named: Any) -> Any:
            truths.setdefault(step, []).append(any(out.parent.rglob("truth*")))
            return real(*arguments, **named)

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "template_text", lambda name: venue_text("standard", SMALL))
        patch.setattr(truth, "MASTER", MASTER)
        for step in ("load_calibration", "keep_pictures", "keep_loop", "keep_refined"):
            patch.setattr(demo, step, spied(step, getattr(demo, step)))
        for step in ("solve", "refine", "judge", "judge_pictures"):
            patch.setattr(demo, step, spied(step, getattr(demo, step)))
        capture = devices.SimulatedCamera.capture
        patch.setattr(devices.SimulatedCamera, "capture", spied("capture", capture))
        patch.setattr(os, "replace", spied("rename", os.replace))
        ran = procam("demo", "--out", out, "--json")
    return SmallRun(out, ran, truths)


def check_no_truth_exists_before_the_run_has_ended(run: SmallRun) -> None:
    judged = {"judge", "judge_pictures"}
    assert judged < run.truths.keys()
    for step in judged:
        assert all(run.truths[step])
    for step in run.truths.keys() - judged - {"rename"}:
        assert not any(run.truths[step]), step
    renames = run.truths["rename"]  # of every file; those of summary and report come last
    assert renames == sorted(renames)
    assert len(run.truths["capture"]) == run.figures["shots"]["value"]
    assert not any(renames[: len(run.truths["capture"])])


def check_json_is_all_there_is_on_stdout_and_it_is_the_summary(run: SmallRun) -> None:
    assert json.loads(run.ran.out) == json.loads((run.out / "summary.json").read_text())
    failed = [name for name, figure in run.figures.items() if figure["pass"] is False]
    assert run.ran.code == (1 if failed else 0)
    assert not run.ran.err


def check_the_summary_holds_every_figure_and_all_are_finite(run: SmallRun) -> None:
    assert run.figures.keys() >= FIGURES
    fields = {"value", "unit", "goal", "pass", "samples", "seed", "command"}
    for name, figure in run.figures.items():
        assert figure.keys() >= fields, name
        values = figure["value"] if isinstance(figure["value"], list) else [figure["value"]]
        assert all(math.isfinite(value) for value in values), name


def check_the_computer_has_no_goals(run: SmallRun) -> None:
    for name in ("simulated_run_s", "peak_memory_mib"):
        assert (run.figures[name]["goal"], run.figures[name]["pass"]) == (None, None)


def check_the_figures_make_sense(run: SmallRun) -> None:
    value = {name: figure["value"] for name, figure in run.figures.items()}
    assert abs(value["feedback_error"]) < 0.05
    assert abs(value["albedo_error"]) < 0.10
    assert abs(value["solid_angle_sum_error"]) < 0.005
    # a projector pixel is 10 arcmin wide here
    relative = value["direction_error_relative_rms_arcmin"]
    # and its pictures of marks are clicked within 0.3 px of a camera whose pixels are 40 arcmin wide
    assert 0 < relative < 2 and relative < value["direction_error_rms_arcmin"] < 12
    assert value["direction_error_rms_arcmin"] < value["direction_error_max_arcmin"] < 30
    # coarse pixels blur every edge of the content, so more is left than at full size
    # and cells of the loop's size show no gain that is wrong
    assert 0 < value["scatter_left_refined"] < 1.02 * value["scatter_left_exact"] < 0.15
    assert 0 < value["interreflection_left"] < 0.02 < value["scatter_left_exact"]
    assert value["picture_error_jnd"] < 0.7 * value["picture_error_jnd_before"]
    assert value["picture_error_jnd_interreflection"] < value["picture_error_jnd"]
    assert value["scatter_left_exact"] < 0.75 * value["scatter_left_paper_eq12"]
    paper_mean = value["scatter_left_paper_eq12_mean"]
    assert abs(value["scatter_left_exact_mean"]) < 0.25 * paper_mean < 0.25
    assert value["shots"] > 80


def check_the_loop_falls_towards_the_noise(run: SmallRun) -> None:
    residual = run.figures["loop_residual_by_iteration"]["value"]
    floor = run.figures["loop_noise_floor"]["value"]
    assert 2 <= len(residual) <= MAX_CORRECTIONS + 1
    assert residual == sorted(residual, reverse=True)
    assert residual[-1] < 0.65 * residual[0]
    assert 0 < floor < residual[-1] < 3 * floor


def check_what_a_demo_leaves_behind(run: SmallRun) -> None:
    calibration = load_calibration(run.out / "calibrations" / "0001")
    assert list(calibration.projectors) == ["south", "north"]
    assert len(list((run.out / "frames" / "refined").glob("*.png"))) == 2
    there = contents(run.out).keys()
    assert {"venue.toml", "summary.json", "report.html", "truth/calibration.json"} <= there
    assert not [name for name in there if ".tmp" in name]


def check_a_demo_replaces_an_earlier_one(run: SmallRun) -> None:
    (run.out / "summary.json").write_text("old")
    demo._make_venue(run.out, "standard")
    assert contents(run.out).keys() == {"venue.toml", demo.MARKER}


@pytest.mark.parametrize(("preset", "code"), [("standard", 1), ("realistic", 0)])
def test_a_loop_that_made_something_worse_fails_the_easy_presets(
    preset: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refined = SimpleNamespace(
        worse="light is off by more", corrections=1, better=False, calibration=None, figures=dict
    )
    monkeypatch.setattr(demo, "_run", lambda *_: (1, tmp_path / "0001", refined))
    for step in ("load_calibration", "keep_pictures", "keep_loop", "_write_truth", "_print"):
        monkeypatch.setattr(demo, step, lambda *_: None)
    for step in ("judge", "judge_pictures"):
        monkeypatch.setattr(demo, step, lambda *_: {})
    ran = procam("demo", "--out", tmp_path / "run", "--preset", preset)
    assert (ran.code, ran.err) == (code, "")
    assert f"nothing written, {tmp_path / '0001'} stays newest: light is off" in ran.out
    assert not (tmp_path / "run" / "calibrations").exists()


@pytest.mark.parametrize("asked", [False, True])
def test_the_table_of_figures_is_printed_when_asked(
    asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refined = SimpleNamespace(worse="", corrections=0, better=False, figures=dict)
    monkeypatch.setattr(demo, "_run", lambda *_: (130, tmp_path / "0001", refined))
    for step in ("load_calibration", "keep_pictures", "keep_loop", "_write_truth", "read_material"):
        monkeypatch.setattr(demo, step, lambda *_: None)
    missed = {"feedback_error": Figure(0.03, "-", Goal("abs<=", 0.02))}
    monkeypatch.setattr(demo, "judge", lambda *_: missed)
    monkeypatch.setattr(demo, "judge_pictures", lambda *_: {})
    monkeypatch.setattr(demo, "write_report", lambda out: out / "report.html")
    monkeypatch.setattr(demo, "result_lines", lambda _: ["Screen: a sphere."])
    ran = procam("demo", "--out", tmp_path / "run", *(["--figures"] if asked else []))
    assert ran.code == 1
    assert "Screen: a sphere." in ran.out and "report.html" in ran.out
    assert ("simulated_run_s" in ran.out, "FAIL" in ran.out) == (asked, asked)


def test_small_demo(tmp_path: Path, subtests: pytest.Subtests) -> None:
    run = watched_demo(tmp_path)
    for check in (
        check_no_truth_exists_before_the_run_has_ended,
        check_json_is_all_there_is_on_stdout_and_it_is_the_summary,
        check_the_summary_holds_every_figure_and_all_are_finite,
        check_the_computer_has_no_goals,
        check_the_figures_make_sense,
        check_the_loop_falls_towards_the_noise,
        check_what_a_demo_leaves_behind,
        check_a_demo_replaces_an_earlier_one,
    ):
        with subtests.test(check.__name__):
            check(run)
