"""`procam compensate` and `procam warp`: pictures, numbered pictures, movies and pipes."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procam.errors import InputError
from procam.files.calibration import load_dome
from procam.interfaces.cli.memory import keep_large_buffers
from procam.interfaces.cli.output import Output
from procam.workflows.playout.compensate import compensate_clip, compensate_file, write_report
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.sources import PipeClip

if TYPE_CHECKING:
    from procam.workflows.events import Event

PIPE = Path("-")
SIZES_PX = (2, 16384)  # edges of frames on a pipe
Rows = dict[int, dict[str, Any]]


def run_compensate(
    calibration: Path,
    ends: tuple[Path, Path],
    how: FrameSettings,
    told: tuple[Path | None, Path | None],
    pipe: tuple[int, str],
    output: Output,
) -> None:
    """`procam compensate`: `ends` are IN and OUT.

    `told` are --explain and --report, `pipe` --size and --pixels.
    """
    explain, report = told
    _check_plots(explain, report)
    if PIPE in ends:
        _run_pipe(calibration, ends, how, told, pipe, output)
        return
    if pipe != (0, ""):
        raise InputError("--size, --pixels: got one for a file, expected IN and OUT to be -")
    source, out = ends
    rows: Rows = {}
    again = report is not None
    events = compensate_file(calibration, source, out, how, again, _beside(explain, report))
    _follow(_collected(events, rows), output, quiet=source.is_file())
    if report:
        _write_report(report, rows)
    if explain:
        _explain(calibration, source, how, explain)
    _tell(rows, ends, how, output)


def run_warp(
    calibration: Path, source: Path, out: Path, transfer: str | None, output: Output
) -> None:
    """`procam warp`."""
    from procam.workflows.playout.warp import warp_file  # not on the way of `compensate`

    events = warp_file(calibration, source, out, transfer)
    paths = _follow(events, output, quiet=source.is_file())["frames"]
    for path in paths:
        output.say(f"{path} written")
    output.finish({"frames": paths})


def _run_pipe(
    calibration: Path,
    ends: tuple[Path, Path],
    how: FrameSettings,
    told: tuple[Path | None, Path | None],
    pipe: tuple[int, str],
    output: Output,
) -> None:
    from procam.files.images.raw_frames import pixel_type, require_open
    from procam.files.system import widen_pipe

    (size, pixels), (explain, report) = pipe, told
    if ends != (PIPE, PIPE):
        raise InputError(f"IN, OUT: got {ends[0]} and {ends[1]}, expected - for both or for none")
    if output.as_json or explain:
        raise InputError("--json, --explain: got one for a pipe, expected none: stdout is frames")
    if size == 0 or not pixels:
        raise InputError(
            "IN: got - without --size and --pixels, expected both, such as --size 4096 --pixels rgb24"
        )
    if not SIZES_PX[0] <= size <= SIZES_PX[1]:
        raise InputError(
            f"--size: got {size} px, expected {SIZES_PX[0]} to {SIZES_PX[1]}, the edge of a frame; "
            "what does the sender give?"
        )
    keep_large_buffers()
    dtype, rows = pixel_type(pixels), Rows()
    for descriptor, name in enumerate(("IN", "OUT")):
        require_open(descriptor, name)
        widen_pipe(descriptor, size * size * 3 * dtype.itemsize)
    with (  # no buffers in between: a frame is sent when it is made
        os.fdopen(0, "rb", buffering=0, closefd=False) as stdin,
        os.fdopen(1, "wb", buffering=0, closefd=False) as stdout,
    ):
        clip = PipeClip((stdin, stdout), size, dtype)
        loaded = load_dome(calibration)  # while the first frame comes
        try:
            for event in compensate_clip(loaded, clip, how, certify=report is not None):
                rows |= event.data["rows"] if report else {}
        except BrokenPipeError as error:
            raise InputError(
                f"OUT: got no reader of stdout after {len(clip.latency_s)} frames, expected one to "
                "the end; why has it stopped?"
            ) from error
    sys.stderr.write(_latency(clip) + "\n")
    if report and rows:
        _write_report(report, rows)


def _latency(clip: PipeClip) -> str:
    """How long frames took, from the last byte that came to the last that was sent."""
    import numpy as np

    ms = 1000 * np.array(clip.latency_s)
    middle, late = np.quantile(ms, (0.5, 0.95))
    return (
        f"{len(ms)} frames; latency median {middle:.1f} ms, 95 % within {late:.1f} ms, "
        f"longest {ms.max():.1f} ms, first {ms[0]:.1f} ms"
    )


def _follow(events: "Iterator[Event]", output: Output, quiet: bool) -> dict[str, Any]:
    """Data of the last event; a bar for what takes long, on a terminal."""
    if sys.stderr.isatty() and not quiet:
        return output.follow(events)
    keep_large_buffers()
    data: dict[str, Any] = {}
    for event in events:
        data = event.data
    return data


def _collected(events: "Iterator[Event]", rows: Rows) -> "Iterator[Event]":
    for event in events:
        rows |= event.data["rows"]
        yield event


def _tell(rows: Rows, ends: tuple[Path, Path], how: FrameSettings, output: Output) -> None:
    frames = [rows[number] for number in sorted(rows)]
    document: dict[str, Any] = {
        "out": str(ends[1]),
        "method": how.method,
        "state": how.state,
        "strength": how.strength,
        "white": how.white,
        "frames": len(frames),
    }
    if not frames:
        output.say(f"{ends[1]} is there already, made of the same; remove it to make it again")
        output.finish(document)
        return
    clipped = [max(row[f"share_lo_{c}"] + row[f"share_hi_{c}"] for row in frames) for c in "rgb"]
    flux = [sum(row[f"flux_out_{c}"] for row in frames) / len(frames) for c in "rgb"]
    above = [row for row in frames if row["above_one"]]
    document |= {"clipped_share": clipped, "direct_flux_sr": flux, "frames_above_one": len(above)}
    worst = "" if len(frames) == 1 else f"; {len(frames)} frames, the worst one"
    shares = ", ".join(f"{share:.1%}" for share in clipped)
    output.say(f"{ends[1]} written{worst}; at a limit (R, G, B): {shares} of the lit picture")
    if above:
        most = max(above, key=lambda row: row["above_one"])
        output.say(
            f"note: {len(above)} frames ask for more than 1.0, frame {most['frame']} in "
            f"{most['above_one']} pixels; they get what the projectors can give"
        )
    output.finish(document)


def _check_plots(explain: Path | None, report: Path | None) -> None:
    if report and report.suffix != ".csv":
        raise InputError(f"--report: got {report}, expected a name that ends in .csv")
    if report or explain:
        from procam.interfaces.plots.charts import require_matplotlib

        require_matplotlib()


def _beside(explain: Path | None, report: Path | None) -> list[tuple[str, Path]]:
    """Files that are written beside OUT, and by which option."""
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


def _explain(calibration: Path, source: Path, how: FrameSettings, folder: Path) -> None:
    from procam.interfaces.plots.clip import write_explained
    from procam.workflows.playout.explain import explain, first_frame, write_pictures

    explained = explain(load_dome(calibration), first_frame(source), how)
    write_pictures(folder, explained)
    write_explained(_sheet(folder), explained, how.strength)
