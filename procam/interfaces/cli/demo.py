"""`procam demo`: a simulated venue from the first pattern to the judged report."""

import json
import shutil
import time
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import load_calibration
from procam.files.system import peak_memory_mib
from procam.files.venue.load import Venue, load_venue, template_names, template_text
from procam.interfaces.cli.output import Output
from procam.interfaces.cli.venues import keep_refined
from procam.interfaces.judge import failed, judge, judge_pictures
from procam.model.quality import Figure, Goal
from procam.workflows.capture import capture as capturing
from procam.workflows.refine.refine import Refined, refine
from procam.workflows.refine.shown import keep_loop, keep_pictures, read_frames
from procam.workflows.sample_content import half_sky
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig

CONTENT_SIZE = 1024
MARKER = "made-by-procam-demo.txt"
# goals that the easy presets must meet; the others are reported without
JUDGED_PRESETS = ("ideal", "standard", "server")
# where a master's pixels land is the server's own doing: procam only says how far off it is
ALIGNED_BY_OTHERS = {"server": ("direction_error_rms_arcmin",)}
MACHINE_FIGURES = {"simulated_run_s"}
JUDGES = ("rays", "mitsuba")
SIMULATED = "simulated-"


def run_demo(out: Path, preset: str, judged_by: str, output: Output) -> None:
    """Run everything; exit 1 if a figure misses its goal, unless it only says the machine is slow."""
    _check(preset, judged_by)
    venue = _make_venue(out, preset)
    output.say(f"Simulated dome, preset {preset}: capture, solve, compensate, refine.")
    started = time.monotonic()
    shots, first, refined = _run(venue, output)
    figures = {
        "simulated_run_s": Figure(time.monotonic() - started, "s", Goal("<=", 60.0)),
        "peak_memory_mib": Figure(peak_memory_mib(), "MiB"),
        "shots": Figure(shots, "-", Goal("<=", 120.0)),
        "session_gb": Figure(_gigabytes(out / "sessions"), "GB", Goal("<=", 1.5)),
    }
    keep_pictures(out, load_calibration(first), half_sky(CONTENT_SIZE))
    keep_loop(out, refined)
    keep_refined(out, first, refined, output)
    output.say("The run has ended; the simulator now tells the truth, and the judge compares.")
    _tell_truth(venue, judged_by)
    figures |= judge(first, out / "truth")
    figures |= judge_pictures(out, first, out / "truth")
    figures |= refined.figures()
    unjudged = ALIGNED_BY_OTHERS.get(preset, ()) if preset in JUDGED_PRESETS else tuple(figures)
    figures |= {name: _without_goal(figures[name]) for name in unjudged}
    _write_summary(out, preset, venue, figures)
    _report(out, output, figures)
    if refined.worse and preset in JUDGED_PRESETS:
        raise typer.Exit(1)


def _check(preset: str, judged_by: str) -> None:
    """Refuse a preset or a judge that is not there before anything is run."""
    presets = [n.removeprefix(SIMULATED) for n in template_names() if n.startswith(SIMULATED)]
    if preset not in presets:
        raise InputError(f"--preset: got {preset!r}, expected one of {', '.join(presets)}")
    if judged_by not in JUDGES:
        raise InputError(f"--judge: got {judged_by!r}, expected {' or '.join(JUDGES)}")
    if judged_by == "mitsuba" and find_spec("mitsuba") is None:
        raise InputError(
            "--judge mitsuba: got no Mitsuba, expected the extra sim; pip install 'procam[sim]'"
        )


def _make_venue(out: Path, preset: str) -> Venue:
    text = template_text(f"simulated-{preset}")
    if out.exists():
        if any(out.iterdir()) and not (out / MARKER).is_file():
            raise InputError(
                f"--out: got {out}, which holds files of yours, expected a new folder or an "
                "earlier demo; nothing was touched"
            )
        shutil.rmtree(out)
    out.mkdir(parents=True)
    (out / MARKER).write_text("procam demo may replace this folder.\n")
    atomic.write_text(out / "venue.toml", text)
    return load_venue(out)


def _run(venue: Venue, output: Output) -> tuple[int, Path, Refined]:
    """Everything a venue would see: the exposures taken, the calibration, the loop's outcome."""
    with open_rig(venue) as rig:
        session = capturing.prepare_session(venue, venue.directory / "sessions" / "0001")
        output.follow(capturing.capture(rig, venue, session))
        solved = output.follow(solve(venue, session))
        first = Path(solved["calibration"])
        loop = refine(rig, load_calibration(first), half_sky(CONTENT_SIZE))
        refined: Refined = output.follow(loop)["refined"]
    return session.read_plan().exposures + refined.shots, first, refined


def _tell_truth(venue: Venue, judged_by: str) -> None:
    """Have the backend write what its venue really is; only now, when nothing is left to solve."""
    name = next(iter(venue.table.cameras.values())).backend
    writer: Any = entry_points(group="procam.truth")[name].load()
    frames = venue.directory / "frames"
    pictures = {p.name: read_frames(p) for p in sorted(frames.iterdir())}
    settings, truth = venue.backends.get(name, {}), venue.directory / "truth"
    writer(settings, venue.directory, truth, pictures, judged_by)


def _write_summary(out: Path, preset: str, venue: Venue, figures: dict[str, Figure]) -> None:
    seed = venue.backends["simulated"].get("seed")
    command = f"procam demo --preset {preset}"
    document = {
        "preset": preset,
        "figures": {
            name: figure.as_dict() | {"seed": seed, "command": command}
            for name, figure in figures.items()
        },
    }
    atomic.write_text(out / "summary.json", json.dumps(document, indent=1))


def _report(out: Path, output: Output, figures: dict[str, Figure]) -> None:
    from procam.interfaces.report import write_report

    report = write_report(out)
    output.table(figures)
    output.say(f"Open {report} in a browser; all figures are in {out / 'summary.json'}.")
    output.finish(json.loads((out / "summary.json").read_text("utf-8")))
    if missed := failed(figures):
        output.say("Missed: " + ", ".join(missed))
    if set(missed) - MACHINE_FIGURES:
        raise typer.Exit(1)


def _without_goal(figure: Figure) -> Figure:
    return Figure(figure.value, figure.unit, None, figure.samples, figure.note)


def _gigabytes(folder: Path) -> float:
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e9
