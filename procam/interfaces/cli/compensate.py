"""`procam compensate`: pictures, numbered pictures, movies and pipes of dome masters.

A file, a folder or a movie is read, compensated and written frame by frame; a run that was stopped is
resumed. On a pipe, `_pipe` sends each frame at once. Nothing is imported here that the first pixel
would wait for: plots and reports are imported when they are asked for.
"""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from procam.compensate.perceptual.settings import PERCEPTUAL
from procam.errors import InputError
from procam.files.calibration import load_dome
from procam.interfaces.cli._options import (
    CalibrationArgument,
    DbOption,
    Json,
    StateOption,
    TransferOption,
    WhiteNitsOption,
    WhiteOption,
)
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._pipe import PIPE, check_pipe, compensate_pipe
from procam.workflows.playout.chunks import FrameRange
from procam.workflows.playout.compensate import certified, compensate_file, write_report
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.sources import FILE

EXAMPLE = "procam compensate my-dome sky.%04d.exr direct"
Rows = dict[int, dict[str, Any]]  # lines of the report by frame
SourceArgument = Annotated[
    Path,
    typer.Argument(
        metavar="IN",
        help="Dome masters: a PNG, TIFF or EXR; numbered ones as sky.%04d.exr, sky.####.exr or a "
        "folder; a movie; or - for bare frames from stdin.",
    ),
]
OutArgument = Annotated[
    Path,
    typer.Argument(
        metavar="OUT",
        help="A picture; a pattern or a folder; a .mov (ProRes 4444) or .mkv (FFV1, lossless); or "
        "- for stdout.",
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        help="exact; perceptual, which keeps contrast where exact would need negative light, or "
        "perceptual-video for movies; subtract, least-squares, paper-eq12 (for comparison) or none."
    ),
]
StrengthOption = Annotated[
    float, typer.Option(help="From 0, the content as it is, to 1, all of the correction.")
]
ExplainOption = Annotated[
    Path | None, typer.Option(help="Folder for pictures of what happens to the first frame.")
]
FramesOption = Annotated[
    str | None,
    typer.Option(
        metavar="A-B",
        help="Only frames A to B. Of numbered pictures several commands, on as many computers, may write "
        "into one OUT; together they make the same bytes as one.",
    ),
]
ToOption = Annotated[
    str,
    typer.Option(
        help="screen, for dome masters of direct light, or projectors: OUT is then a folder for the "
        "frames of each, warped and blended. IN that is direct light already needs --method none."
    ),
]
ReportOption = Annotated[
    Path | None,
    typer.Option(help="FILE.csv with a line per frame; FILE.plot.png is a plot of it."),
]
EdgeOption = Annotated[int, typer.Option(help="With -: edge of the frames, in px.")]
PixelsOption = Annotated[str, typer.Option(help="With -: rgb24, rgb48le, rgbf16le or rgbf32le.")]


def compensate(
    calibration: CalibrationArgument,
    source: SourceArgument,
    out: OutArgument,
    *,
    method: MethodOption = "exact",
    db: DbOption = None,
    white_nits: WhiteNitsOption = None,
    strength: StrengthOption = 1.0,
    white: WhiteOption = "summed",
    transfer: TransferOption = None,
    state: StateOption = None,
    explain: ExplainOption = None,
    frames: FramesOption = None,
    to: ToOption = "screen",
    report: ReportOption = None,
    edge: EdgeOption = 0,
    pixels: PixelsOption = "",
    json: Json = False,
) -> None:
    """Take the scattered light out of dome masters.

    1.0 (255 of 8 bits) is the calibration's reference white. OUT is the direct light to send, also
    dome masters; depth, alpha, attributes, frame numbers, timestamps and sound are kept. A run that
    was stopped is resumed. On a pipe each frame is sent at once, and stderr reports the latency at
    the end.
    """
    settings = FrameSettings(method, state, strength, white, transfer, db, white_nits)
    settings = settings.at(calibration)
    output = Output(json)
    _check_plots(explain, report)
    some = None if frames is None else FrameRange.parsed(frames)
    if some and explain:
        raise InputError("--explain shows the first frame of IN; leave out --frames")
    if (edge or pixels) and PIPE not in (source, out):
        raise InputError("--edge and --pixels are for pipes; use them with - as IN and OUT")
    if to != "screen":
        _check_to(to, [source, out], settings, plots=bool(explain or report))
        _to_projectors(calibration, (source, out), settings, some, output)
        return
    if PIPE in (source, out):
        if output.as_json or explain or some:
            raise InputError(
                "--json, --explain and --frames cannot be used on a pipe: stdout carries all frames"
            )
        check_pipe(source, out, edge, pixels)
        rows = compensate_pipe(calibration, edge, pixels, settings, certify=report is not None)
        if report and rows:
            _write_report(report, rows)
            sys.stderr.write(_certificate_text(certified(list(rows.values()))) + "\n")
        return
    beside, again = _beside(explain, report), report is not None
    steps = compensate_file(calibration, source, out, settings, again, beside, some)
    made = output.follow_frames(steps, quiet=source.is_file())
    if report:
        _write_report(report, made.rows)
    if explain:
        _write_explained(calibration, source, settings, explain)
    _summarise([made.rows[n] for n in sorted(made.rows)], out, settings, output, made.notes)


def _check_to(to: str, files: list[Path], settings: FrameSettings, *, plots: bool) -> None:
    """Refuse what frames of projectors cannot be made with."""
    if to != "projectors":
        raise InputError(f"--to {to}: is unknown; choose screen or projectors")
    if plots or PIPE in files or settings.strength != 1:
        raise InputError(
            "--to projectors writes files of each projector at full strength: leave out --strength, "
            "--report, --explain and pipes, or compensate to the screen and then "
            "take those frames with --method none"
        )


def _to_projectors(
    calibration: Path,
    files: tuple[Path, Path],
    settings: FrameSettings,
    frames: FrameRange | None,
    output: Output,
) -> None:
    from procam.workflows.playout.warp import warp_file

    source, out = files
    steps = warp_file(calibration, source, out, settings, frames)
    made = output.follow_frames(steps, quiet=source.is_file())
    for path in made.paths:
        output.say(f"{path} written")
    output.finish({"frames": made.paths})


def _summarise(
    frames: list[dict[str, Any]],
    out: Path,
    settings: FrameSettings,
    output: Output,
    notes: list[str],
) -> None:
    document: dict[str, Any] = {
        "out": str(out),
        "method": settings.method,
        "state": settings.state,
        "strength": settings.strength,
        "white": settings.white,
        "frames": len(frames),
        "notes": notes,
    }
    if not frames:
        output.say(f"{out} is complete and was made with the same settings; remove it to repeat")
        output.finish(document)
        return
    clipped = [max(row[f"share_lo_{c}"] + row[f"share_hi_{c}"] for row in frames) for c in "rgb"]
    flux = [sum(row[f"flux_out_{c}"] for row in frames) / len(frames) for c in "rgb"]
    above = [row for row in frames if row["above_one"]]
    document |= {"clipped_share": clipped, "direct_flux_sr": flux, "frames_above_one": len(above)}
    document["certificate"] = found = certified(frames)
    worst = "" if len(frames) == 1 else f"; {len(frames)} frames, the worst one"
    shares = ", ".join(f"{share:.1%}" for share in clipped)
    output.say(f"{out} written{worst}; at a limit (R, G, B): {shares} of the lit picture")
    chosen = settings.method in PERCEPTUAL
    output.say(_certificate_text(found, "light that the method chose" if chosen else "content"))
    if "luminance_loss_db" in frames[0]:
        document["luminance_loss_db"] = loss = max(row["luminance_loss_db"] for row in frames)
        output.say(_perceptual_text(frames, loss, settings))
    if above:
        most = max(above, key=lambda row: row["above_one"])
        output.say(
            f"note: {len(above)} frames ask for more than 1.0, frame {most['frame']} in "
            f"{most['above_one']} pixels; they get what the projectors can give"
        )
    output.finish(document)


def _perceptual_text(frames: list[dict[str, Any]], loss: float, settings: FrameSettings) -> str:
    changed = sum(row["from_exact"] > 0 for row in frames)
    said = f"{changed} of {len(frames)} frames differ from the exact method's"
    if not changed:
        return said
    white = PERCEPTUAL[settings.method].white_nits
    at = f"a white of {settings.white_nits or white:g} cd/m2"
    assumed = "" if settings.white_nits else ", assumed: state a darker dome's by --white-nits"
    compared = f"{abs(loss):.2f} dB {'larger' if loss > 0 else 'smaller'}"
    return f"{said}; errors of luminance are {compared}, at the most, for {at}{assumed}"


def _certificate_text(found: dict[str, Any], target: str = "content") -> str:
    """What `certified` found, in a sentence; `target` is what light is compared with."""
    where = "read back" if found["covers"] == FILE else "checked in memory only, not as received"
    frames = f"{found['frames']} frame{'s' * (found['frames'] != 1)} {where}"
    if found["error"] is None:
        return f"{frames}: limits hold everywhere, so there is nothing to compare"
    codes = "" if found["error_codes"] is None else f" ({found['error_codes']:.2g} codes)"
    sample = (
        f", the sampled scattered light by +- {sigma:.1g}"
        if (sigma := found["error_sigma"])
        else ""
    )
    return (
        f"{frames}: where no limit holds, direct and scattered light together differ from the "
        f"{target} by at most {found['error']:.1g} of white{codes}{sample}"
    )


def _check_plots(explain: Path | None, report: Path | None) -> None:
    if report and report.suffix != ".csv":
        raise InputError(f"--report {report}: the name must end in .csv")
    if report or explain:
        from procam.interfaces.plots.figure import require_matplotlib

        require_matplotlib()


def _beside(explain: Path | None, report: Path | None) -> list[tuple[str, Path]]:
    """Files that are written beside OUT, with the option that asks for them."""
    files = []
    if report:
        files += [("--report", report), ("--report", _plot(report))]
    if explain:
        from procam.workflows.playout.explain import picture_files

        pictures = [*picture_files(explain).values(), _sheet(explain)]
        files += [("--explain", path) for path in pictures]
    return files


def _plot(report: Path) -> Path:
    return report.with_suffix(".plot.png")


def _sheet(explain: Path) -> Path:
    return explain / "explained.png"


def _write_report(report: Path, rows: Rows) -> None:
    from procam.interfaces.plots.clip import write_clip_plot

    frames = [rows[number] for number in sorted(rows)]
    write_report(report, frames)
    write_clip_plot(_plot(report), frames)


def _write_explained(
    calibration: Path, source: Path, settings: FrameSettings, folder: Path
) -> None:
    from procam.interfaces.plots.clip import write_explained
    from procam.workflows.playout.explain import explain, write_pictures
    from procam.workflows.playout.sources import first_frame

    explained = explain(load_dome(calibration), first_frame(source), settings)
    write_pictures(folder, explained)
    write_explained(_sheet(folder), explained, settings.strength)
