"""`procam demo`: a simulated venue from the first pattern to a report that is compared with the truth.

The demo runs what a real venue would run: capture, solve, compensate, closed loop. Only when the last
photograph is stored does the simulator write the truth, and `interfaces.judge` compares the
calibration and its pictures with it. What is printed is for people; summary.json has every figure.
"""

import shutil
import time
from dataclasses import replace
from importlib.metadata import entry_points
from importlib.util import find_spec
from json import dumps
from pathlib import Path
from typing import Annotated, Any

import typer

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import load_calibration
from procam.files.system import peak_memory_mib
from procam.files.venue.load import Venue, load_venue, template_names, template_text
from procam.interfaces.cli._demo_text import labelled, result_lines
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output, exit_if_missed
from procam.interfaces.cli._sessions import CONTENT_SIZE, keep_refined
from procam.interfaces.judge import judge, judge_pictures
from procam.interfaces.report import write_report
from procam.interfaces.report.data import read_material
from procam.model.quality import Figure, Goal
from procam.workflows.capture import capture as capturing
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.refine.refine import Refined, refine
from procam.workflows.refine.stored_pictures import keep_loop, keep_pictures, read_frames
from procam.workflows.sample_content import half_sky, interior
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig

EXAMPLE = "procam demo --out demo-run --preset standard"
MARKER = "made-by-procam-demo.txt"
# presets that must meet the goals; the others are reported without
JUDGED_PRESETS = ("ideal", "standard", "server")
# the server decides where a master's pixels land; procam only measures how far off they are
ALIGNED_BY_OTHERS = {
    "server": ("direction_error_relative_rms_arcmin", "direction_error_rms_arcmin")
}
JUDGES = ("rays", "mitsuba")
SIMULATED = "simulated-"


def demo(
    out: Annotated[Path, typer.Option(help="Folder to make; an earlier demo is replaced.")] = Path(
        "demo-run"
    ),
    preset: Annotated[
        str, typer.Option(help="ideal, standard, realistic, faulty or server.")
    ] = "standard",
    judge: Annotated[
        str,
        typer.Option(help="What traces the light of the truth: rays, or mitsuba, a path tracer."),
    ] = "rays",
    figures: Annotated[
        bool, typer.Option("--figures", help="Print all figures with their goals.")
    ] = False,
    json: Json = False,
) -> None:
    """Calibrate a simulated dome, compensate a picture, and compare both with the truth.

    Exit 1 if a figure of the calibration misses its goal.
    """
    _check(preset, judge)
    run_demo(out, preset, judge, Output(json), figures)


def run_demo(out: Path, preset: str, judged_by: str, output: Output, table: bool) -> None:
    """Run everything; prints the figures as a `table` if asked."""
    venue = _make_venue(out, preset)
    output.say(f"Simulated dome, preset {preset}: capture, solve, compensate, refine.")
    started = time.monotonic()
    shots, first, refined = _run(venue, output)
    figures = {
        "simulated_run_s": Figure(time.monotonic() - started, "s"),
        "peak_memory_mib": Figure(peak_memory_mib(), "MiB"),
        "shots": Figure(shots, "-"),
        "session_gb": Figure(_gigabytes(out / "sessions"), "GB", Goal("<=", 1.5)),
    }
    judged = half_sky(CONTENT_SIZE)
    keep_pictures(out, load_calibration(first), judged)
    keep_loop(out, refined, judged)
    keep_refined(out, first, refined, output)
    output.say("The run has ended; now the simulator writes the truth, and procam compares.")
    _write_truth(venue, judged_by)
    figures |= judge(first, out / "truth")
    figures |= judge_pictures(out, first, out / "truth")
    figures |= refined.figures()
    unjudged = ALIGNED_BY_OTHERS.get(preset, ()) if preset in JUDGED_PRESETS else tuple(figures)
    figures |= {name: replace(figures[name], goal=None) for name in unjudged}
    document = _write_summary(out, preset, venue, figures)
    _print(out, figures if table else {}, output)
    output.finish(document)
    if refined.worse and preset in JUDGED_PRESETS:
        raise typer.Exit(1)
    exit_if_missed(figures)


def _check(preset: str, judged_by: str) -> None:
    """Refuse a preset or a judge that does not exist before anything is run."""
    presets = [n.removeprefix(SIMULATED) for n in template_names() if n.startswith(SIMULATED)]
    if preset not in presets:
        raise InputError(f"--preset {preset!r} is unknown; choose one of {', '.join(presets)}")
    if judged_by not in JUDGES:
        raise InputError(f"--judge {judged_by!r} is unknown; choose {' or '.join(JUDGES)}")
    if judged_by == "mitsuba" and find_spec("mitsuba") is None:
        raise InputError(
            "--judge mitsuba needs Mitsuba, which is not installed; run: pip install 'procam[sim]'"
        )


def _make_venue(out: Path, preset: str) -> Venue:
    text = template_text(f"simulated-{preset}")
    if out.exists():
        if any(out.iterdir()) and not (out / MARKER).is_file():
            raise InputError(
                f"--out: {out} holds files that no demo made; give a new folder or that of an earlier "
                "demo. Nothing was touched"
            )
        shutil.rmtree(out)
    out.mkdir(parents=True)
    (out / MARKER).write_text("procam demo may replace this folder.\n")
    atomic.write_text(out / "venue.toml", text)
    return load_venue(out)


def _run(venue: Venue, output: Output) -> tuple[int, Path, Refined]:
    """Run what a real venue would run: number of exposures, calibration, result of the loop."""
    with open_rig(venue) as rig:
        session = capturing.prepare_session(venue, venue.directory / "sessions" / "0001")
        output.follow(capturing.capture(rig, venue, session))
        solved = output.follow(solve(venue, session))
        calibration = load_calibration(solved.directory)
        photographer = DrivenPhotographer(rig, calibration)
        loop = refine(photographer, venue, calibration, interior(CONTENT_SIZE))  # judged on another
        refined = output.follow(loop)
    return session.read_plan().exposures + refined.shots, solved.directory, refined


def _write_truth(venue: Venue, judged_by: str) -> None:
    """Make the backend write its venue's truth; only now, when nothing is solved any more."""
    name = next(iter(venue.table.cameras.values())).backend
    writer: Any = entry_points(group="procam.truth")[name].load()
    frames = venue.directory / "frames"
    pictures = {p.name: read_frames(p) for p in sorted(frames.iterdir())}
    settings, truth = venue.backends.get(name, {}), venue.directory / "truth"
    writer(settings, venue.directory, truth, pictures, judged_by)


def _write_summary(
    out: Path, preset: str, venue: Venue, figures: dict[str, Figure]
) -> dict[str, Any]:
    origin = {
        "seed": venue.backends["simulated"].get("seed"),
        "command": f"procam demo --preset {preset}",
    }
    entries = {name: figure.as_dict() | origin for name, figure in figures.items()}
    document = {"preset": preset, "figures": entries}
    atomic.write_text(out / "summary.json", dumps(document, indent=1))
    return document


def _print(out: Path, table: dict[str, Figure], output: Output) -> None:
    """Write the report and print the result in plain words, or as a table."""
    report = write_report(out)
    output.table(table)
    if not output.as_json:
        for line in result_lines(read_material(out)):
            output.say(line)
    output.say(labelled("Report", f"{report} (open it in a browser)"))
    output.say(labelled("All figures", f"{out / 'summary.json'}; --figures prints them as a table"))


def _gigabytes(folder: Path) -> float:
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e9
