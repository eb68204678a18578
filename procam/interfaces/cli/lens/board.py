"""`procam lens board`: a camera's lens from photographs of a board."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import typer

from procam.errors import InputError, NotEnoughData
from procam.estimate.boards.camera import BoardView, CameraFit, better_fit, fit_camera, rms
from procam.estimate.boards.robust_fit import MIN_VIEWS, determines_pose
from procam.estimate.boards.targets import Board, find_board, suggest_squares
from procam.interfaces.cli._options import Json, SquareOption, SquaresOption
from procam.interfaces.cli._output import Output, as_dicts, exit_if_missed
from procam.interfaces.cli._paths import one_size, photographs, read_grey, some
from procam.interfaces.cli.lens._boards import (
    WORST_RMS,
    as_rows,
    bend_figure,
    coefficients,
    count_text,
    edge_note,
    lens_keys,
    make_board,
)
from procam.interfaces.cli.lens._into import IntoCameraOption, IntoOption, check_into, give
from procam.maths.geometry.lenses import LensKind
from procam.model.quality import Figure, Goal

EXAMPLE = (
    "procam lens board --photos boards --squares 10x7 --square-mm 20 --into my-dome --camera zenith"
)
LEAST_COVERAGE = 0.25  # a fisheye circle fills 44 % of a 16:9 picture at most
SEARCHED = 3  # photographs in which a board of another count is searched for


def board(
    *,
    photos: Annotated[Path, typer.Option(metavar="DIR", help="Photographs of one board.")],
    squares: SquaresOption,
    square_mm: SquareOption,
    into: IntoOption = None,
    camera: IntoCameraOption = "",
    model: Annotated[str, typer.Option(help="brown, or kannala-brandt for fisheyes.")] = "brown",
    kind: Annotated[str, typer.Option("--board", help="checkerboard or charuco.")] = "checkerboard",
    marker_mm: Annotated[float, typer.Option(help="Charuco: edge of a marker, in mm.")] = 0.0,
    dictionary: Annotated[str, typer.Option(help="Charuco: set of markers.")] = "DICT_4X4_50",
    json: Json = False,
) -> None:
    """Solve a camera's lens from photographs of a flat board; exit 1 if it fits badly.

    Some 15 photographs, focus and zoom fixed, the board tilted to all sides and out to the corners
    of the picture. The bend of a board that is not quite flat is solved too.
    """
    check_into(into, camera)
    target, lens = make_board(squares, square_mm, kind, marker_mm, dictionary), _lens(model)
    output = Output(json)
    views, size, skipped = _find_boards(photographs(photos), target, output)
    fit = fit_camera(views, size, lens)
    figures = figures_of(fit)
    _print_fit(fit, figures, output)
    better = better_fit(fit, views)
    if better:
        output.say(_suggestion(fit, better))
    if any(figure.passed is False for figure in figures.values()):
        output.say("the lens is not given on: it fits badly")
    else:
        give(into, camera, lens_keys(fit.lens, fit.size, [*fit.sigma.values()]), output)
    document = _document(fit, figures, skipped)
    output.finish(document | {"better_model": better.lens.kind if better else None})
    exit_if_missed(figures)


def figures_of(fit: CameraFit) -> dict[str, Figure]:
    """How well the fit explains the corners."""
    lengths = np.linalg.norm(np.concatenate([*fit.residual_px.values()]), axis=1)
    views = len(fit.boards)
    figures = {
        "rms": Figure(rms(fit.residual_px), "px", WORST_RMS, len(lengths)),
        "median": Figure(float(np.median(lengths)), "px", None, len(lengths)),
        "coverage": Figure(fit.coverage, "-", Goal(">=", LEAST_COVERAGE), 1, "of the picture"),
        "reach": Figure(fit.reach_deg, "deg", None, 1, "largest angle off the axis with a corner"),
        "board_bend": bend_figure(fit.bend, views),
    }
    if fit.held_out_px:
        note = "in views left out of the fit, their poses apart"
        figures["held_out_rms"] = Figure(rms(fit.held_out_px), "px", WORST_RMS, views, note)
    return figures


def _lens(model: str) -> LensKind:
    if model == "brown":
        return "brown"
    if model == "kannala-brandt":
        return "kannala-brandt"
    raise InputError(f"--model {model!r} is unknown; choose {' or '.join(get_args(LensKind))}")


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
            output.say(f"{path}: no board of {count_text(board.squares)} squares found; left out")
            skipped.append(path)
        else:
            views.append(BoardView(str(path), *found))
    size = one_size(sizes)
    if len(views) < MIN_VIEWS:
        raise NotEnoughData(_too_few(files, skipped, board))
    return views, size, skipped


def _too_few(files: Sequence[Path], skipped: Sequence[Path], board: Board) -> str:
    hint = "photograph all of it, sharp, evenly lit and with its white margin"
    if board.kind == "charuco":
        hint += "; are --squares and --dictionary right?"
    for path in skipped[:SEARCHED] if board.kind == "checkerboard" else ():
        other = suggest_squares(read_grey(path), board.squares)
        if other:
            hint = f"{path} shows one of {count_text(other)}, so try --squares {count_text(other)}"
            break
    return (
        f"photographs: a board of {count_text(board.squares)} squares is found in "
        f"{len(files) - len(skipped)} of {len(files)} (none in {some(skipped)}), and at least "
        f"{MIN_VIEWS} are needed; {hint}"
    )


def _print_fit(fit: CameraFit, figures: Mapping[str, Figure], output: Output) -> None:
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
    curled = edge_note(fit.dropped, fit.area)
    if curled:
        output.say(curled)
    for view in fit.dropped_views:
        output.say(f"{view}: most corners fit no pose of this board; left out")
    for name, value, sigma in _parameters(fit):
        output.say(f"  {name:30} {value:>28.6g} +- {sigma:.2g}")
    output.table(figures)


def _suggestion(fit: CameraFit, better: CameraFit) -> str:
    return (
        f"{better.lens.kind} fits this lens better than {fit.lens.kind}: RMS "
        f"{rms(better.held_out_px):.3f} px against {rms(fit.held_out_px):.3f} px in views left out; "
        f"run again with --model {better.lens.kind}"
    )


def _parameters(fit: CameraFit) -> list[tuple[str, float, float]]:
    values = coefficients(fit.lens)
    return [(n, v, s) for (n, s), v in zip(fit.sigma.items(), values, strict=True)]


def _document(
    fit: CameraFit, figures: Mapping[str, Figure], skipped: Sequence[Path]
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
        "model": fit.lens.kind,
        "size": list(fit.size),
        "parameters": {n: {"value": v, "sigma": s} for n, v, s in _parameters(fit)},
        "covariance": fit.covariance.tolist(),
        "figures": as_dicts(figures),
        "views": views,
        "no_board": [str(path) for path in skipped],
        "dropped_views": list(fit.dropped_views),
        "dropped_corners": as_rows(fit.dropped),
    }
