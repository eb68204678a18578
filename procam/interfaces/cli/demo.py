"""`procam demo`: a simulated venue from the first pattern to a report that is compared with the truth.

The demo runs what a real venue would run: capture, solve, compensate, closed loop. Only when the last
photograph is stored does the simulator write the truth, and `interfaces.judge` compares the
calibration and its pictures with it. What is printed is for people; summary.json has every figure.
"""

import shutil
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from importlib.util import find_spec
from json import dumps
from pathlib import Path
from textwrap import wrap
from typing import Annotated, Any

import typer

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import load_calibration
from procam.files.system import peak_memory_mib
from procam.files.venue.load import Venue, load_venue, template_names, template_text
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output, exit_if_missed
from procam.interfaces.cli._sessions import keep_refined
from procam.interfaces.judge import judge, judge_pictures
from procam.interfaces.report import write_report
from procam.interfaces.report.data import Material, read_material
from procam.interfaces.report.words import limits_text, miss_text, number, percent
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
COLUMNS, LABEL = 100, 16
MASTER_PX = 4096  # edge of the dome master that errors are compared with
MASTER_PIXEL_ARCMIN = 180 * 60 / MASTER_PX
# a terminal may lack what the report's texts use
ASCII = str.maketrans(
    {
        "\N{NARROW NO-BREAK SPACE}": " ",
        "\N{NO-BREAK SPACE}": " ",
        "\N{MINUS SIGN}": "-",
        "\N{PLUS-MINUS SIGN}": "+-",
    }
)
Entries = Mapping[str, Mapping[str, Any]]


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
    judged = half_sky(venue.table.screen.map_size)
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
        content = interior(calibration.maps.size)  # it is judged on another
        refined = output.follow(refine(photographer, venue, calibration, content))
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


def result_lines(material: Material) -> Iterator[str]:
    """What was measured and what compensation achieved, a short paragraph each."""
    parts = {
        "Geometry": _geometry(material.figures, material.preset == "server"),
        "Screen": _screen(material),
        "Bounced light": _bounced_light(material.figures),
        "Picture": _picture(material.figures),
        "Not removed": _not_removed(material),
        "Time": _time(material.figures),
        "Goals missed": " ".join(
            miss_text(n, e) for n, e in material.figures.items() if e["pass"] is False
        ),
    }
    for label, text in parts.items():
        if text:
            lines = wrap(labelled(label, text), COLUMNS, subsequent_indent=" " * LABEL)
            yield from (line.translate(ASCII) for line in lines)


def labelled(label: str, text: object) -> str:
    """A line with its label in front."""
    return f"{label + ':':{LABEL}}{text}"


def _geometry(figures: Entries, through_server: bool) -> str:
    if "direction_error_rms_arcmin" not in figures:
        return ""
    relative, absolute = (
        figures[f"direction_error_{x}rms_arcmin"]["value"] for x in ("relative_", "")
    )
    who = "the media server's pixels" if through_server else "projector pixels"
    return (
        f"{who} are {number(relative, 2)} arcmin off relative to each other (root mean square), or "
        f"{number(relative / MASTER_PIXEL_ARCMIN, 2)} pixels of a dome master of {MASTER_PX} px; with the "
        f"survey of the marks {number(absolute, 2)} arcmin. A sharp eye resolves 1 arcmin."
    )


def _screen(material: Material) -> str:
    sphere = material.figures.get("dome_is_sphere")
    if sphere is None or material.calibration is None:
        return ""
    if sphere["value"]:
        return "a sphere, as far as the cameras can measure."
    degree = material.calibration.screen.shape.degree
    solved = f"its shape was solved up to harmonics of degree {degree}"
    return f"not a sphere; {solved if degree else 'its shape could not be solved'}."


def _bounced_light(figures: Entries) -> str:
    names = ("scatter_left_refined", "scatter_left_exact")
    left = next((figures[name] for name in names if name in figures), None)
    if left is None or "scatter_before" not in figures:
        return ""
    before, after = figures["scatter_before"]["value"], left["value"]
    text = f"it adds {percent(before, 2)} of white to the picture before compensation; "
    alone = figures.get("interreflection_left")
    if alone is None:
        return f"{text}{percent(after, 2)} of it remains after compensation."
    return (
        f"{text}{percent(alone['value'], 2)} of it remains where projectors draw exactly what they are asked "
        f"for, {percent(after, 2)} as they draw."
    )


def _picture(figures: Entries) -> str:
    if "picture_error_jnd" not in figures:
        return ""
    after, before = (number(figures[f"picture_error_jnd{x}"]["value"], 2) for x in ("", "_before"))
    return (
        f"95 % of all that is lit is within {after} just noticeable differences of what was meant; "
        f"uncompensated within {before}."
    )


def _not_removed(material: Material) -> str:
    limits = material.limits()
    if limits is None:
        return ""
    return limits_text(float(limits.too_bright.mean()), float(limits.too_dark.mean()))


def _time(figures: Entries) -> str:
    seconds, shots = (figures.get(name) for name in ("simulated_run_s", "shots"))
    if seconds is None or shots is None:
        return ""
    return f"{seconds['value']:.0f} s on this computer, with {shots['value']} photographs."
