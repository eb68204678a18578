"""The report of a venue as one HTML file.

What a venue's folder holds is read into a `Material`; each section makes its blocks from that, and
the template `report_template.html` lays them out.
"""

from collections.abc import Iterator, Mapping
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from procam.errors import InputError
from procam.files import atomic
from procam.interfaces.plots.figure import EXTRA, require_matplotlib
from procam.interfaces.report import acceptance, cover, drift, hand, light, other_seat, rig
from procam.interfaces.report.blocks import Section
from procam.interfaces.report.cover import date_text
from procam.interfaces.report.data import Material, read_material
from procam.interfaces.report.stored_loop import StoredLoop
from procam.interfaces.report.words import (
    goal_text,
    miss_text,
    number,
    percent,
    value_text,
    words_for,
)
from procam.model.screen import RoomScreen

OF_DOMES = ("other-seat",)  # sections
Entries = Mapping[str, Mapping[str, Any]]


def write_report(venue_dir: Path, out: Path | None = None) -> Path:
    """Write a venue's report, one self-contained HTML file; returns its path.

    What the venue does not have yet is named, with the command that adds it.

    Parameters
    ----------
    venue_dir : with venue.toml, calibrations/, and what `procam demo`, `calibrate` and `refine`
        leave there: summary.json, pictures/, loop/, truth/.
    out : where to; VENUE/report.html by default.

    Raises
    ------
    InputError
        matplotlib or jinja2 is not installed, or the folder is no venue.
    FileFormatError
        a file is there but damaged.
    """
    require_matplotlib()  # before anything is read
    return write_page(read_material(venue_dir), out or venue_dir / "report.html")


def write_page(material: Material, path: Path) -> Path:
    """The same from what was read of a venue."""
    require_matplotlib()
    template = html_template("report_template.html")
    atomic.write_text(path, template.render(**_context(material)))
    return path


def html_template(name: str) -> Any:
    """A page of this package as a template of jinja2: values are escaped, and none may be missing."""
    try:
        from jinja2 import Environment, StrictUndefined  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            f"report: jinja2 is not installed, which writes reports; run: {EXTRA}"
        ) from error
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = resources.files(__package__).joinpath(name).read_text("utf-8")
    return environment.from_string(text)


def _context(material: Material) -> dict[str, Any]:
    entries, judged = _entries(material), acceptance.found(material)
    return {
        "venue": material.name,
        "written": date_text(datetime.now().astimezone()),
        "calibrated": date_text(material.calibrated_at) if material.calibrated_at else "",
        "number_of": material.used.name if material.used else "",
        "simulated": material.is_simulated,
        "screen": material.word,
        "layout": _layout(material),
        "facts": list(cover.facts(material)),
        "method": cover.method(material),
        "acceptance": [acceptance.row(finding) for finding in judged],
        "accepted": acceptance.verdict(judged),
        "verdict": _verdict(entries),
        "good": any(e["pass"] for e in entries.values()),
        "missed": [miss_text(n, e) for n, e in entries.items() if e["pass"] is False],
        "cards": list(_cards(material)),
        "sections": list(_sections(material)),
        "figures": [_figure_row(n, e) for n, e in entries.items()],
        "judged": bool(material.figures),
        "commands": sorted({_command(e) for e in entries.values()} - {("", "")}),
        "provenance": list(cover.provenance(material)),
        "contrast": cover.contrast(material.calibration),
    }


def _layout(material: Material) -> dict[str, Any] | None:
    """Height of a room's canvas and the boxes of its parts, in units of a hundredth of its width."""
    if not isinstance(material.screen, RoomScreen):
        return None
    room = material.screen.room
    scale = 100 / room.size_m[0]
    boxes = {name: [scale * side for side in box] for name, box in room.layout().items()}
    return {"height": scale * room.size_m[1], "parts": boxes}


def _entries(material: Material) -> dict[str, Mapping[str, Any]]:
    """All figures: those of the run, those of the calibration, and those of its check from another seat."""
    solved = material.calibration.quality if material.calibration else {}
    checked = material.other_seat.figures() if material.other_seat else {}
    return {**material.figures, **{n: f.as_dict() for n, f in {**solved, **checked}.items()}}


def _verdict(entries: Entries) -> str:
    judged = [e for e in entries.values() if e["pass"] is not None]
    missed = [e for e in judged if e["pass"] is False]
    if not judged:
        return "No figure of this venue has a goal yet."
    if not missed:
        many = f"All {len(judged)} figures that have a goal meet it."
        return many if len(judged) > 1 else "The one figure that has a goal meets it."
    verb = "misses its goal" if len(missed) == 1 else "miss their goals"
    return f"{len(missed)} of {len(judged)} figures {verb}; see below."


def _cards(material: Material) -> Iterator[dict[str, str]]:
    """The main figures: title, value, explanation, goal."""
    yield from _left_card(material.figures)
    if material.loop:
        yield _loop_card(material.loop)
    yield from _direction_card(material)
    yield from _picture_card(material)


def _left_card(figures: Entries) -> Iterator[dict[str, str]]:
    title = "Bounced light that remains"
    drawn = next((n for n in ("scatter_left_refined", "scatter_left_exact") if n in figures), None)
    if "interreflection_left" in figures and drawn:
        left = value_text(drawn, figures[drawn])
        note = f"of it, where projectors draw exactly what they are asked for; {left} as they draw"
        yield _figure_card(figures, "interreflection_left", title, note)
    elif drawn:
        yield _figure_card(figures, drawn, title, "of the bounced light remains, worst colour")


def _loop_card(loop: StoredLoop) -> dict[str, str]:
    left = loop.unseen[1] if loop.unseen else loop.residual[-1]
    floor = percent(loop.noise_floor, 2)
    note = f"of white between camera and prediction; camera noise {floor}"
    if loop.unseen:
        note = (
            "of white between camera and prediction, in a picture that the loop did not learn from"
        )
    return _card("Difference after the loop", percent(left, 2), note)


def _direction_card(material: Material) -> Iterator[dict[str, str]]:
    name = "direction_error_relative_rms_arcmin"
    if name in material.figures:
        note = "of projector pixels relative to each other, against the truth"
        yield _figure_card(material.figures, name, "Direction error", note)
    elif material.calibration:
        surfaces = [p.surface for p in material.calibration.projectors.values()]
        sigma = np.concatenate([s.sigma_arcmin[s.valid] for s in surfaces])
        middle = f"{number(float(np.median(sigma)))} arcmin"
        yield _card("Expected direction error", middle, "one standard error, median")


def _picture_card(material: Material) -> Iterator[dict[str, str]]:
    names = ("picture_error_jnd_before", "picture_error_jnd")
    if material.figures.keys() >= set(names):
        both = (number(material.figures[name]["value"], 2) for name in names)
        note = "just noticeable differences, which 95 % of all that is lit stay within, before and after"
        yield _card("Error of the picture", " \N{RIGHTWARDS ARROW} ".join(both), note)
        return
    seen = material.before_after()
    if seen is None:
        return
    before, after = (percent(error, 2) for error in seen.error_rms())
    if seen.source == "prediction":
        note = "of white without compensation, as predicted; root mean square"
        yield _card("Error of the picture, before", before, note)
    else:
        note = "of white, before and after; root mean square where no limit holds"
        yield _card("Error of the picture", f"{before} \N{RIGHTWARDS ARROW} {after}", note)


def _figure_card(figures: Entries, name: str, title: str, note: str) -> dict[str, str]:
    return _card(title, value_text(name, figures[name]), note, goal_text(name, figures[name]))


def _card(title: str, value: str, note: str, goal: str = "") -> dict[str, str]:
    return {"title": title, "value": value, "note": note, "goal": goal}


def _sections(material: Material) -> Iterator[Section]:
    parts = [
        ("pictures", "Before and after", light.pictures),
        ("coverage", "Who lights what", rig.coverage),
        ("mapping", "Where the pixels land", rig.mapping),
        ("response", "How the projectors respond", rig.response),
        ("bounces", f"Light that bounces round the {material.word}", light.pollution),
        ("loop", "Photographed and corrected: the closed loop", light.loop),
        ("clipped", "What could not be reproduced, and why", light.clipped),
        ("levels", "Brightest white and darkest black", rig.levels),
        ("feedback", f"How strongly the {material.word} bounces light", rig.feedback),
        ("other-seat", "Checked from another seat", other_seat.other_seat),
        ("drift", "Drift since the last calibration", drift.drift),
        ("by-hand", "Done by hand", hand.by_hand),
    ]
    if not material.is_dome:
        parts = [part for part in parts if part[0] not in OF_DOMES]
    for key, title, make in parts:
        if blocks := list(make(material)):
            yield Section(key, title, blocks)


def _figure_row(name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    words, note = words_for(name), str(entry.get("note", ""))
    return {
        "name": name,
        "title": words.title,
        "gloss": words.gloss,
        "value": value_text(name, entry),
        "goal": goal_text(name, entry),
        "pass": entry["pass"],
        "samples": number(entry["samples"]),
        "note": "" if note in words.title + words.gloss else note,
    }


def _command(entry: Mapping[str, Any]) -> tuple[str, str]:
    """The command that made a figure, and its seed in words."""
    if not entry.get("command"):
        return "", ""
    seed = entry.get("seed")
    return str(entry["command"]), "" if seed is None else f"with seed {seed}"
