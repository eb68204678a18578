"""`procam lens pair`: a projector and a camera from photographs of a flat board; needs no venue."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from procam.errors import FileFormatError, InputError, NotEnoughData
from procam.estimate.boards.camera import rms
from procam.estimate.boards.planar_pair import (
    DEVICES,
    PairView,
    PlanarPair,
    fit_planar_pair,
    pair_view,
)
from procam.estimate.boards.robust_fit import MIN_VIEWS, determines_pose
from procam.estimate.boards.targets import Board, find_board
from procam.estimate.structured_light.codes import DEFAULT_CODE, Code
from procam.estimate.structured_light.gaps import count_fits
from procam.interfaces.cli._codes import chosen_code
from procam.interfaces.cli._options import CodeOption, Json, SizeOption, SquareOption, SquaresOption
from procam.interfaces.cli._output import Output, as_dicts, exit_if_missed
from procam.interfaces.cli._paths import (
    SUFFIXES,
    Picture,
    Size,
    one_size,
    panel_size,
    read_grey,
    some,
)
from procam.interfaces.cli.decode import decode_folder
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
from procam.maths.geometry.pose import rotation_vector
from procam.model.correspondence import CorrespondenceMap
from procam.model.quality import Figure
from procam.threads import ThreadPool

EXAMPLE = "procam lens pair --photos poses --squares 10x7 --square-mm 20 --size 1280x800"
LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
POSE_NAMES = (*(f"turn_{a}_deg" for a in "xyz"), *(f"shift_{a}_m" for a in "xyz"))
WORKERS = min(4, os.cpu_count() or 1)  # poses decoded at once; each holds a few pictures in memory
Parameters = dict[str, tuple[float, float]]  # value, standard error


def pair(
    *,
    photos: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder with a folder of photographs per pose.")
    ],
    squares: SquaresOption,
    square_mm: SquareOption,
    size: SizeOption,
    code: CodeOption = DEFAULT_CODE,
    into: IntoOption = None,
    camera: IntoCameraOption = "",
    json: Json = False,
) -> None:
    """Solve a projector and a camera from a flat chessboard; exit 1 if it fits badly.

    Three poses of the board or more, tilted to all sides; of each the photographs of a code on it,
    as `procam decode` takes them, in a folder of its own. Needs no venue. The lenses' distortion and
    the bend of the board are solved too, if that predicts poses left out of the fit better.
    """
    check_into(into, camera)
    board, output = make_board(squares, square_mm), Output(json)
    panel = panel_size(size)
    layout = chosen_code(code, panel)
    poses, stray = _poses(photos, layout, output)
    views, camera_size, skipped = _views(poses, layout, board, output)
    fit = fit_planar_pair(views, camera_size, panel)
    parameters, figures = _parameters(fit), _figures(fit)
    _print_fit(fit, parameters, figures, output)
    _print_dropped(fit, board, output)
    if any(figure.passed is False for figure in figures.values()):
        output.say("the lens of the camera is not given on: it fits badly")
    else:
        errors = [sigma for name, (_, sigma) in parameters.items() if name.startswith("camera.")]
        give(into, camera, lens_keys(fit.camera, camera_size, errors), output)
    output.finish(_document(fit, parameters, figures, [*stray, *skipped]))
    exit_if_missed(figures)


def _poses(folder: Path, code: Code, output: Output) -> tuple[list[Path], list[Path]]:
    """The folders of poses, and those that are none by the number of their photographs."""
    if not folder.is_dir():
        raise FileFormatError(
            f"{folder}: there is no such folder; give one with a folder for every pose of the board"
        )
    inside = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not inside:
        raise FileFormatError(
            f"{folder}: there are no folders in it; every pose of the board needs one, with the "
            "photographs of a code on the board"
        )
    names = {place: [path.name for path in _photographs(place)] for place in inside}
    stray = [place for place in inside if not count_fits(len(code.planes), names[place])]
    if len(inside) - len(stray) < MIN_VIEWS:
        return inside, []  # so that decoding refuses the first of them
    for place in stray:
        output.say(
            f"{place.name}: {len(names[place])} photographs, and the code {code.name} needs "
            f"{len(code.planes)}; this is no pose, skipped"
        )
    return [place for place in inside if place not in stray], stray


def _photographs(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())


def _views(
    poses: Sequence[Path], code: Code, board: Board, output: Output
) -> tuple[list[PairView], Size, list[Path]]:
    """Views of the board, the photographs' size, and the poses that are of no use."""
    with ThreadPool(min(len(poses), WORKERS)) as pool:
        decoded = list(pool.map(lambda place: _decoded_pose(place, code, board), poses))
    views, sizes, skipped = list[PairView](), dict[Path, Size](), list[Path]()
    for place, (view, sizes[place], notes) in zip(poses, decoded, strict=True):
        for note in notes:
            output.say(f"{place.name}: {note}")
        if view:
            views.append(view)
        else:
            output.say(f"{place.name}: no board is found that the projector lights; left out")
            skipped.append(place)
    if len(views) < MIN_VIEWS:
        raise NotEnoughData(_too_few(board, len(poses), skipped))
    return views, one_size(sizes), skipped


def _decoded_pose(place: Path, code: Code, board: Board) -> tuple[PairView | None, Size, list[str]]:
    """What a pose's photographs show, None without a board that is lit; their size, and notes."""
    found, notes = _decoded(place, code)
    height, width = found.valid.shape
    return _view(place, board, found), (width, height), notes


def _view(place: Path, board: Board, found: CorrespondenceMap) -> PairView | None:
    """The board as both see it; None if it is not there, or hardly lit."""
    seen = find_board(_white(place, found.valid.shape), board)
    if seen is None:
        return None
    view = pair_view(place.name, *seen, found)
    lit = np.isfinite(view.projector_px).all(axis=1)
    return view if determines_pose(view.points[lit]) else None


def _too_few(board: Board, poses: int, skipped: Sequence[Path]) -> str:
    return (
        f"poses: a board of {count_text(board.squares)} squares is found in {poses - len(skipped)} of "
        f"{poses} (none in {some(skipped) or '-'}), and at least {MIN_VIEWS} are needed; light all of "
        "it with the projector, and tilt it to all sides; is --squares right?"
    )


def _decoded(place: Path, code: Code) -> tuple[CorrespondenceMap, list[str]]:
    """The map of a pose and notes on it; errors carry its name."""
    try:
        found, _, notes = decode_folder(place, code, (None, None))
    except InputError as error:
        if str(place) in str(error):
            raise
        raise InputError(f"{place}: {error}; or leave this pose out") from error
    return found, notes


def _white(folder: Path, shape: tuple[int, ...]) -> Picture:
    """The brightest photograph of those that were decoded: the one of white, in any code."""
    fitting = (p for p in map(read_grey, _photographs(folder)) if p.shape == shape)
    return max(fitting, key=lambda picture: float(picture.mean(dtype=float)))


def _parameters(fit: PlanarPair) -> Parameters:
    """Values and standard errors by name, such as camera.fx."""
    count = (len(fit.covariance) - len(POSE_NAMES)) // len(DEVICES)
    pose = fit.projector_from_camera
    names = [f"{device}.{name}" for device in DEVICES for name in LENS_NAMES[:count]]
    lenses = [coefficients(lens)[:count] for lens in (fit.camera, fit.projector)]
    turn = np.degrees(rotation_vector(pose.rotation))
    sigma = np.sqrt(np.diag(fit.covariance))
    sigma[-6:-3] = np.degrees(sigma[-6:-3])
    values = np.concatenate([*lenses, turn, pose.translation])
    each = zip(values.tolist(), sigma.tolist(), strict=True)
    return dict(zip([*names, *POSE_NAMES], each, strict=True))


def _figures(fit: PlanarPair) -> dict[str, Figure]:
    """How well the fit explains the corners, and predicts those of poses left out of it."""
    figures = {"board_bend": bend_figure(fit.bend, len(fit.boards))}
    note = "in poses left out of the fit, the board's own pose apart"
    for device, left in fit.residual_px.items():
        count = sum(map(len, left.values()))
        figures[f"{device}_rms"] = Figure(rms(left), "px", WORST_RMS, count)
        held_out = rms(fit.held_out_px[device])
        figures[f"{device}_held_out_rms"] = Figure(held_out, "px", WORST_RMS, count, note)
    return figures


def _print_fit(
    fit: PlanarPair, parameters: Parameters, figures: Mapping[str, Figure], output: Output
) -> None:
    for view in fit.boards:
        each = (
            f"{device} RMS {rms({view: left[view]}):.3f} px, left out "
            f"{rms({view: fit.held_out_px[device][view]}):.3f} px"
            for device, left in fit.residual_px.items()
        )
        corners = len(fit.residual_px[DEVICES[1]][view])
        output.say(f"{view}: {corners} corners, {'; '.join(each)}")
    for view in fit.dropped_views:
        output.say(f"{view}: most corners fit no pose of this board; left out")
    for name, (value, sigma) in parameters.items():
        output.say(f"  {name:30} {value:>28.6g} +- {sigma:.2g}")
    output.table(figures)


def _print_dropped(fit: PlanarPair, board: Board, output: Output) -> None:
    for device, dropped in fit.dropped.items():
        for d in dropped:
            column, row = (round(x / board.square_m) + 1 for x in d.place_m)
            output.say(
                f"{d.view}: the corner in column {column}, row {row} is {d.miss_px:.1f} px off at "
                f"({d.pixel[0]:.1f}, {d.pixel[1]:.1f}) of the {device}; dropped"
            )
    curled = edge_note([d for of in fit.dropped.values() for d in of], fit.area)
    if curled:
        output.say(curled)


def _document(
    fit: PlanarPair,
    parameters: Parameters,
    figures: Mapping[str, Figure],
    skipped: Sequence[Path],
) -> dict[str, Any]:
    pose = fit.projector_from_camera
    return {
        "parameters": {n: {"value": v, "sigma": s} for n, (v, s) in parameters.items()},
        "rotation": pose.rotation.tolist(),
        "translation_m": pose.translation.tolist(),
        "covariance": fit.covariance.tolist(),
        "figures": as_dicts(figures),
        "poses": list(fit.boards),
        "left_out": [path.name for path in skipped],
        "dropped_poses": list(fit.dropped_views),
        "dropped_corners": {device: as_rows(found) for device, found in fit.dropped.items()},
    }
