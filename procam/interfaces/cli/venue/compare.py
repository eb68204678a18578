"""`procam venue compare`: the differences of two calibrations of the same rig."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap

import typer

from procam.errors import InputError
from procam.estimate.comparison.compare import Angles, Comparison, Difference
from procam.estimate.comparison.verdict import PictureStep
from procam.files.calibration import load_calibration
from procam.files.history.read import FigureDifference, figure_differences
from procam.interfaces.cli._options import CalibrationArgument, Json
from procam.interfaces.cli._output import Output
from procam.model.calibration import Calibration
from procam.workflows import comparison

EXAMPLE = "procam venue compare my-dome@1 my-dome@2"
ALL = "together"
COLUMNS = 100
SCREEN = {"radius_m": ("radius [m]", ".4f"), "degree": ("harmonics to degree", ".0f")}
LIGHT = {"feedback": "feedback m", "albedo": "albedo"}


def compare(first: CalibrationArgument, second: CalibrationArgument, json: Json = False) -> None:
    """Compare two calibrations of a rig; exit 1 if they differ by more than a rotation.

    They come from independent captures: another session, another camera, or the same camera turned
    by 90 degrees, which shows a wrong lens that no residual of one session shows. Prints how far
    apart directions, areas and light are, whether their error bars cover that, and if not, whether
    a projector moved, a lens is wrong, or two projectors are exchanged. Of two calibrations of one venue
    their figures are compared too.
    """
    a, b = load_calibration(first), load_calibration(second)
    _check(first, a, second, b)
    output, found = Output(json), comparison.compare(a, b)
    output.say(f"A {first}\nB {second}")
    for line in _lines(found):
        output.say(line)
    figures = _figures(first, second)
    for line in _figure_lines(figures):
        output.say(line)
    document = {"a": str(first), "b": str(second), **asdict(found)}
    output.finish(document | {"figures": [asdict(row) for row in figures]})
    if not found.verdict.sound:
        raise typer.Exit(1)


def _check(first: Path, a: Calibration, second: Path, b: Calibration) -> None:
    """Refuse calibrations of different rigs."""
    here, there = ({n: p.model.size for n, p in c.projectors.items()} for c in (a, b))
    if here != there:
        raise InputError(
            f"{second} has projectors {_listed(there)}, and {first} has {_listed(here)}; compare "
            "calibrations of the same rig"
        )


def _figures(first: Path, second: Path) -> list[FigureDifference]:
    """Differences of the figures that the history of one venue has of both."""
    folder, (a, b) = first.resolve().parent, (first.resolve().name, second.resolve().name)
    if folder.name != "calibrations" or second.resolve().parent != folder:
        return []
    return figure_differences(folder.parent, a, b)


def _figure_lines(rows: list[FigureDifference]) -> Iterator[str]:
    if rows:
        yield from ("", f"{'figures':34} {'A':>12} {'B':>12} {'B - A':>12}  in sigmas")
    for row in rows:
        values = " ".join(f"{_short(value):>12}" for value in (row.a, row.b, row.difference))
        mark = " *" if row.is_marked else ""
        yield f"  {row.name:32} {values}  {_short(row.sigmas, '+.1f')}{mark}".rstrip()


def _short(value: float | None, form: str = ".5g") -> str:
    return "" if value is None else format(value, form)


def _listed(sizes: dict[str, tuple[int, int]]) -> str:
    return ", ".join(f"{name} {width}x{height}" for name, (width, height) in sizes.items())


def _lines(found: Comparison) -> Iterator[str]:
    rows = {**found.projectors, ALL: found.together}
    wide = max(14, *(len(name) + 2 for name in rows))
    head = f"{'rms':>9} {'median':>9} {'95 %':>9} {'max':>9} {'error/sigma':>12}"
    yield ""
    yield f"{'as they are':{wide}} {'pixels':>9} {head}   [arcmin]"
    for name, row in rows.items():
        yield f"  {name:{wide - 2}} {row.pixels:9} {_angles(row.as_is)}"
    yield ""
    yield f"the common rotation from B to A: {_turn(found.turn_arcmin)}"
    yield f"{'after it':{wide}} {head} {'smooth':>9} {'rest':>9}"
    for name, row in rows.items():
        parts = f"{row.smooth_arcmin:9.3g} {row.rest_arcmin:9.3g}"
        yield f"  {name:{wide - 2}} {_angles(row.turned)} {parts}"
    yield ""
    yield from _areas(rows, wide)
    yield from _screen(found)
    yield from _light(found, wide)
    yield from _responses(found, wide)
    yield from _picture(found.picture, wide)
    yield ""
    yield from wrap(f"verdict: {found.verdict.text}", COLUMNS, subsequent_indent="  ")


def _angles(angles: Angles) -> str:
    lengths = (angles.rms, angles.median, angles.p95, angles.max)
    return " ".join(f"{v:9.3g}" for v in lengths) + f" {angles.error_over_sigma:12.3g}"


def _turn(turn: list[float]) -> str:
    size = sum(v * v for v in turn) ** 0.5
    x, y, z = turn
    return f"{size:.3g} arcmin (x {x:+.3g}, y {y:+.3g}, z {z:+.3g})"


def _areas(rows: dict[str, Difference], wide: int) -> Iterator[str]:
    yield (
        f"{'solid angles':{wide}} {'median':>9} {'rms':>9} {'sum':>9} {'in one only':>12}"
        "   [B / A - 1]"
    )
    for name, row in rows.items():
        steps = (row.areas.median, row.areas.rms, row.areas.sum)
        columns = " ".join(f"{v:9.2g}" for v in steps)
        yield f"  {name:{wide - 2}} {columns} {row.areas.alone:12.2%}"


def _screen(found: Comparison) -> Iterator[str]:
    """Differences between the screens, to the digits that are shown."""
    rows = {}
    for key, (label, digits) in SCREEN.items():
        a, b = (format(value, digits) for value in found.screen[key])
        if a != b:
            rows[label] = f"{a:21} {b}"
    if rows:
        wide = max(map(len, rows)) + 2
        yield from ("", f"{'screen':{wide}}   {'A':21} B")
        yield from (f"  {label:{wide}} {values}" for label, values in rows.items())


def _light(found: Comparison, wide: int) -> Iterator[str]:
    if not found.light:
        return
    yield ""
    yield f"{'light':{wide}} {'A':21} {'B':21} (B - A) in standard errors"
    for name, step in found.light.items():
        each = (_channels(values, 4) for values in (step.first, step.second))
        columns = " ".join(f"{text:21}" for text in each)
        yield f"  {LIGHT[name]:{wide - 2}} {columns} {_channels(step.sigmas, 1)}"


def _responses(found: Comparison, wide: int) -> Iterator[str]:
    """Responses that differ by more than their error bars."""
    changed = {name: step for name, step in found.responses.items() if step.excess > 1}
    if changed:
        yield from ("", f"{'responses':{wide}} B - A, where it is clearest")
        yield from (f"  {n:{wide - 2}} {s.text}, +- {s.sigma:.1g}" for n, s in changed.items())


def _picture(step: PictureStep | None, wide: int) -> Iterator[str]:
    """A uniform picture by the frames of B beside that by the frames of A."""
    if step is None:
        return
    yield from ("", f"{'uniform picture':{wide}} by B's frames, on A's dome, beside that by A's")
    yield f"  {'level':{wide - 2}} {step.level:.4f}, and {step.rms:.2%} rms beside it"
    for name, (a, b) in step.share_lit.items():
        yield f"  {name:{wide - 2}} light from {a:.1%} of its pixels by A, {b:.1%} by B"


def _channels(values: list[float], digits: int) -> str:
    return " ".join(f"{v:.{digits}f}" for v in values)
