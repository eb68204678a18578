"""`procam camera`: intrinsics from photographs of a board."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import typer

from procam.errors import FileFormatError, InputError, NotEnoughData
from procam.estimate.boards.camera import BoardView, CameraFit, fit_camera, rms
from procam.estimate.boards.robust_fit import MIN_VIEWS, determines_pose
from procam.estimate.boards.targets import Board, BoardKind, find_board, suggest_squares
from procam.files.atomic import write_text
from procam.interfaces.cli.decoding import SUFFIXES, read_grey
from procam.interfaces.cli.output import Output
from procam.maths.geometry.lenses import LensKind
from procam.model.quality import Figure, Goal

WORST_RMS_PX = 1.0
LEAST_COVERAGE = 0.25  # a fisheye circle fills 44 % of a 16:9 picture at most
SMALLEST_MM, LARGEST_MM = 0.01, 10_000.0  # edge of a square
LOOKED_AT = 3  # photographs in which another number of squares is looked for
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # as venue.toml wants them


def run_camera(
    images: Sequence[Path],
    board: Board,
    model: str,
    out: Path,
    output: Output,
) -> None:
    """Find the board in the photographs, solve the camera, write OUT, say what it is worth."""
    kind = _kind(model)
    check_out(out)
    views, size, skipped = _find_boards(_photographs(images), board, output)
    fit = fit_camera(views, size, kind)
    write_text(out, toml_of(fit, out.stem))
    figures = figures_of(fit)
    _say(fit, figures, output)
    output.say(f"{out} written; copy its lines into venue.toml")
    output.finish(_document(fit, figures, out, skipped))
    if any(figure.passed is False for figure in figures.values()):
        raise typer.Exit(1)


def make_board(
    kind: str, squares: str, square_mm: float, marker_mm: float, dictionary: str
) -> Board:
    """The board that the options of the command describe."""
    count = two_counts("--squares", squares, "COLUMNSxROWS such as 10x7, all squares counted")
    kinds = get_args(BoardKind)
    if kind not in kinds:
        raise InputError(f"--board: got {kind!r}, expected {' or '.join(kinds)}")
    if not SMALLEST_MM <= square_mm <= LARGEST_MM:  # also refuses NaN
        raise InputError(
            f"--square-mm: got {square_mm:g}, expected {SMALLEST_MM:g} to {LARGEST_MM:g} mm; measure "
            "several squares with a ruler and divide"
        )
    return Board(kind, count, square_mm / 1e3, marker_mm / 1e3, dictionary)  # type: ignore[arg-type]


def two_counts(option: str, text: str, expected: str) -> tuple[int, int]:
    """The numbers of an option such as 10x7."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match:
        raise InputError(f"{option}: got {text!r}, expected {expected}")
    return int(match[1]), int(match[2])


def check_out(out: Path) -> None:
    """Refuse a file that cannot be written before anything is worked out for it."""
    if out.suffix != ".toml":
        raise InputError(f"{out}: got the suffix {out.suffix!r}, expected .toml")
    if out.is_dir():
        raise InputError(f"{out}: got a folder, expected a file; choose another name for --out")
    above = next(path for path in out.absolute().parents if path.exists())
    if not above.is_dir():
        raise InputError(
            f"{out}: got the file {above} on its way, expected a folder; choose another --out"
        )
    if not os.access(above, os.W_OK | os.X_OK):
        raise InputError(
            f"{out}: got a folder {above} that may not be written, expected one that may; choose "
            "another --out, or change its permissions"
        )


def toml_of(fit: CameraFit, name: str) -> str:
    """The keys of a camera in venue.toml, with standard errors as comments."""
    if not NAME.fullmatch(name):
        name = "camera"
    sigma = [*fit.sigma.values()]
    corners = sum(map(len, fit.residual_px.values()))
    rows = {
        "f": (fit.lens.focal, sigma[:2], "px", 4),
        "c": (fit.lens.centre, sigma[2:4], "px; (0, 0) is the centre of the first pixel", 4),
        "k": (fit.lens.distortion, sigma[4:], "", 8),
    }
    return "\n".join(
        [
            f"# {corners} corners in {len(fit.boards)} photographs: RMS {rms(fit.residual_px):.3f} px"
            + (f", {rms(fit.held_out_px):.3f} px in views left out" if fit.held_out_px else "")
            + f"; seen to {fit.reach_deg:.0f} degrees off the axis",
            f"[cameras.{name}]",
            f'model = "{fit.lens.kind}"',
            f"size = [{fit.size[0]}, {fit.size[1]}]",
            *(
                f"{key} = [{', '.join(f'{v:.{digits}f}' for v in values)}]"
                f"  # +- {', '.join(f'{s:.2g}' for s in errors)} {unit}".rstrip()
                for key, (values, errors, unit, digits) in rows.items()
            ),
            "",
        ]
    )


def figures_of(fit: CameraFit) -> dict[str, Figure]:
    """What the fit is worth; the command fails if a goal is missed."""
    lengths = np.linalg.norm(np.concatenate([*fit.residual_px.values()]), axis=1)
    limit, views = Goal("<=", WORST_RMS_PX), len(fit.boards)
    u2, v2, uv = fit.bend
    sag = np.abs(np.linalg.eigvalsh([[u2, uv / 2], [uv / 2, v2]])).max()
    figures = {
        "rms": Figure(rms(fit.residual_px), "px", limit, len(lengths)),
        "median": Figure(float(np.median(lengths)), "px", None, len(lengths)),
        "coverage": Figure(fit.coverage, "-", Goal(">=", LEAST_COVERAGE), 1, "of the picture"),
        "reach": Figure(fit.reach_deg, "deg", None, 1, "largest angle off the axis with a corner"),
        "board_bend": Figure(float(sag) * 1e3, "mm", None, views, "at the board's rim"),
    }
    if fit.held_out_px:
        note = "in views left out of the fit, their poses apart"
        figures["held_out_rms"] = Figure(rms(fit.held_out_px), "px", limit, views, note)
    return figures


def _kind(model: str) -> LensKind:
    if model == "brown":
        return "brown"
    if model == "kannala-brandt":
        return "kannala-brandt"
    raise InputError(f"--model: got {model!r}, expected {' or '.join(get_args(LensKind))}")


def _photographs(images: Sequence[Path]) -> list[Path]:
    """The files; of a folder, the pictures in it by name."""
    files: list[Path] = []
    for path in images:
        inside = sorted(path.iterdir()) if path.is_dir() else [path]
        files += [p for p in inside if not path.is_dir() or p.suffix.lower() in SUFFIXES]
    if not files:
        raise FileFormatError(
            f"{', '.join(map(str, images))}: got no pictures, expected photographs of the board"
        )
    return list(dict.fromkeys(files))


def _find_boards(
    files: Sequence[Path], board: Board, output: Output
) -> tuple[list[BoardView], tuple[int, int], list[Path]]:
    """Views of the board, the pictures' size, and the photographs that do not show it."""
    views, sizes, skipped = [], {}, []
    for path in files:
        picture = read_grey(path)
        sizes[path] = (picture.shape[1], picture.shape[0])
        found = find_board(picture, board)
        if found is None or not determines_pose(found[0]):
            output.say(f"{path}: no board of {_count(board.squares)} squares found; left out")
            skipped.append(path)
        else:
            views.append(BoardView(str(path), *found))
    size = one_size(sizes)
    if len(views) < MIN_VIEWS:
        raise NotEnoughData(_too_few(files, skipped, board))
    return views, size, skipped


def one_size(sizes: Mapping[Path, tuple[int, int]]) -> tuple[int, int]:
    """The size of all pictures; refuses several, naming whose they are."""
    kinds = sorted(set(sizes.values()), key=[*sizes.values()].count, reverse=True)
    if len(kinds) > 1:
        each = (
            f"{_count(kind)} ({_some([p for p in sizes if sizes[p] == kind])})" for kind in kinds
        )
        raise InputError(
            f"photographs: got pictures of {' and '.join(each)}, expected one size; leave out those "
            "of another camera, zoom or crop, and turn off the automatic rotation"
        )
    return kinds[0]


def _too_few(files: Sequence[Path], skipped: Sequence[Path], board: Board) -> str:
    hint = "photograph all of it, sharp, evenly lit and with its white margin"
    if board.kind == "charuco":
        hint += "; are --squares and --dictionary right?"
    for path in skipped[:LOOKED_AT] if board.kind == "checkerboard" else ():
        other = suggest_squares(read_grey(path), board.squares)
        if other:
            hint = f"{path} shows one of {_count(other)}, so try --squares {_count(other)}"
            break
    return (
        f"photographs: got a board of {_count(board.squares)} squares in {len(files) - len(skipped)} of "
        f"{len(files)} (none in {_some(skipped)}), expected it in at least {MIN_VIEWS}; {hint}"
    )


def _some(paths: Sequence[Path]) -> str:
    names = [path.name for path in paths]
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _count(pair: tuple[int, int]) -> str:
    return f"{pair[0]}x{pair[1]}"


def _say(fit: CameraFit, figures: Mapping[str, Figure], output: Output) -> None:
    for view, residual in fit.residual_px.items():
        left = rms({view: fit.held_out_px[view]}) if fit.held_out_px else np.nan
        output.say(
            f"{view}: {len(residual)} corners, RMS {rms({view: residual}):.3f} px, left out {left:.3f} px"
        )
    for corner in fit.dropped:
        x, y = corner.pixel
        output.say(
            f"{corner.view}: corner {corner.index} at ({x:.1f}, {y:.1f}) is {corner.miss_px:.1f} px "
            "off; dropped"
        )
    for view in fit.dropped_views:
        output.say(f"{view}: most corners fit no pose of this board; left out")
    for name, value, sigma in _parameters(fit):
        output.say(f"  {name:30} {value:>28.6g} +- {sigma:.2g}")
    output.table(figures)


def _parameters(fit: CameraFit) -> list[tuple[str, float, float]]:
    values = np.concatenate([fit.lens.focal, fit.lens.centre, fit.lens.distortion]).tolist()
    return [(n, v, s) for (n, s), v in zip(fit.sigma.items(), values, strict=True)]


def _document(
    fit: CameraFit, figures: Mapping[str, Figure], out: Path, skipped: Sequence[Path]
) -> dict[str, Any]:
    views = {
        view: {
            "corners": len(residual),
            "rms_px": rms({view: residual}),
            "held_out_rms_px": rms({view: fit.held_out_px[view]}) if fit.held_out_px else None,
        }
        for view, residual in fit.residual_px.items()
    }
    return {
        "out": str(out),
        "model": fit.lens.kind,
        "size": list(fit.size),
        "parameters": {n: {"value": v, "sigma": s} for n, v, s in _parameters(fit)},
        "covariance": fit.covariance.tolist(),
        "figures": {name: figure.as_dict() for name, figure in figures.items()},
        "views": views,
        "no_board": [str(path) for path in skipped],
        "dropped_views": list(fit.dropped_views),
        "dropped_corners": [
            {"view": d.view, "corner": d.index, "pixel": list(d.pixel), "miss_px": d.miss_px}
            for d in fit.dropped
        ],
    }
