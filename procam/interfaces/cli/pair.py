"""`procam pair`: a projector and a camera that look at a flat board; needs no venue."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

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
from procam.estimate.structured_light.codes import Code, make_code
from procam.files.atomic import write_text
from procam.interfaces.cli.camera import check_out, one_size, two_counts
from procam.interfaces.cli.decoding import SUFFIXES, Picture, decode_folder, read_grey
from procam.interfaces.cli.output import Output
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import rotation_vector
from procam.model.correspondence import CorrespondenceMap
from procam.model.quality import Figure, Goal

WORST_RMS_PX = 1.0
LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
POSE_NAMES = (*(f"turn_{a}_deg" for a in "xyz"), *(f"shift_{a}_m" for a in "xyz"))
Size = tuple[int, int]
Parameters = dict[str, tuple[float, float]]


def run_pair(
    folder: Path,
    board: Board,
    shown: tuple[str, str],
    distortion: bool,
    out: Path,
    output: Output,
) -> None:
    """Decode every pose in FOLDER, solve the pair, write OUT; `shown` are size and code."""
    check_out(out)
    size = two_counts("--size", shown[0], "WIDTHxHEIGHT such as 1280x800")
    views, camera_size, skipped = _views(_poses(folder), make_code(shown[1], size), board, output)
    pair = fit_planar_pair(views, camera_size, size, distortion=distortion)
    told, figures = _parameters(pair), _figures(pair)
    sizes = dict(zip(DEVICES, (camera_size, size), strict=True))
    write_text(out, _toml(pair, told, sizes))
    _say(pair, told, figures, output)
    output.say(f"{out} written")
    output.finish(_document(pair, told, figures, out, skipped))
    if any(figure.passed is False for figure in figures.values()):
        raise typer.Exit(1)


def _poses(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: got no such folder, expected one with a folder per pose")
    poses = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    if not poses:
        raise FileFormatError(
            f"{folder}: got no folders in it, expected one for every pose of the board, each with the "
            "photographs of a code on it"
        )
    return poses


def _views(
    poses: Sequence[Path], code: Code, board: Board, output: Output
) -> tuple[list[PairView], Size, list[str]]:
    """Views of the board, the photographs' size, and the poses that are of no use."""
    views, sizes, skipped = [], {}, []
    for place in poses:
        found = _decoded(place, code, output)
        height, width = found.valid.shape
        sizes[place] = (width, height)
        view = _view(place, board, found)
        if view is None:
            output.say(f"{place.name}: no board is seen that the projector lights; left out")
            skipped.append(place.name)
        else:
            views.append(view)
    if len(views) < MIN_VIEWS:
        raise NotEnoughData(_too_few(board, len(poses), skipped))
    return views, one_size(sizes), skipped


def _view(place: Path, board: Board, found: CorrespondenceMap) -> PairView | None:
    """The board as both see it; None if it is not there, or hardly lit."""
    seen = find_board(_white(place, found.valid.shape), board)
    if seen is None:
        return None
    view = pair_view(place.name, *seen, found)
    lit = np.isfinite(view.projector_px).all(axis=1)
    return view if determines_pose(view.points[lit]) else None


def _too_few(board: Board, poses: int, skipped: Sequence[str]) -> str:
    columns, rows = board.squares
    missing = ", ".join(skipped[:4]) + (f" and {len(skipped) - 4} more" if skipped[4:] else "")
    return (
        f"poses: got a board of {columns}x{rows} squares in {poses - len(skipped)} of {poses} "
        f"(none in {missing or '-'}), expected it in at least {MIN_VIEWS}; light all of it with the "
        "projector, tilt it to all sides; is --squares right?"
    )


def _decoded(place: Path, code: Code, output: Output) -> CorrespondenceMap:
    """The map of a pose; what is wrong or odd is told with its name."""
    try:
        found, _, notes = decode_folder(place, code, (None, None))
    except InputError as error:
        if str(place) in str(error):
            raise
        raise InputError(f"{place}: {error}; or leave this pose out") from error
    for note in notes:
        output.say(f"{place.name}: {note}")
    return found


def _white(folder: Path, shape: tuple[int, ...]) -> Picture:
    """The brightest photograph of those that were decoded: the one of white, in any code."""
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    fitting = (picture for picture in map(read_grey, files) if picture.shape == shape)
    return max(fitting, key=lambda picture: float(picture.mean(dtype=float)))


def _parameters(pair: PlanarPair) -> Parameters:
    """Values and standard errors by name, such as camera.fx."""
    count = (len(pair.covariance) - len(POSE_NAMES)) // len(DEVICES)
    lenses = dict(zip(DEVICES, (pair.camera, pair.projector), strict=True))
    pose = pair.projector_from_camera
    names = [f"{device}.{name}" for device in DEVICES for name in LENS_NAMES[:count]]
    values = [_numbers(lens)[:count] for lens in lenses.values()]
    turn = np.degrees(rotation_vector(pose.rotation))
    sigma = np.sqrt(np.diag(pair.covariance))
    sigma[-6:-3] = np.degrees(sigma[-6:-3])
    told = np.concatenate([*values, turn, pose.translation])
    each = zip(told.tolist(), sigma.tolist(), strict=True)
    return dict(zip([*names, *POSE_NAMES], each, strict=True))


def _numbers(lens: Lens) -> Any:
    return np.concatenate([lens.focal, lens.centre, lens.distortion])


def _figures(pair: PlanarPair) -> dict[str, Figure]:
    """What the fit is worth; the command fails if a goal is missed."""
    goal = Goal("<=", WORST_RMS_PX)
    return {
        f"{device}_rms": Figure(rms(left), "px", goal, sum(map(len, left.values())))
        for device, left in pair.residual_px.items()
    }


def _toml(pair: PlanarPair, told: Parameters, sizes: Mapping[str, Size]) -> str:
    """Both lenses as in venue.toml, and the pose between them; standard errors as comments."""
    views = len(pair.boards)
    fits = ", ".join(f"{device} {rms(left):.3f} px" for device, left in pair.residual_px.items())
    pose = pair.projector_from_camera
    rows = ", ".join(_listed(row, 8) for row in pose.rotation)
    turns, shifts = (_sigmas(told, POSE_NAMES[part]) for part in (slice(3), slice(3, 6)))
    lenses = zip(DEVICES, (pair.camera, pair.projector), strict=True)
    return "\n".join(
        [
            f"# a projector and a camera from {views} poses of a flat board; RMS: {fits}",
            "# standard errors tell how corners scatter; the board's own size adds its share to every length",
            *(line for name, lens in lenses for line in _lens_lines(name, lens, sizes[name], told)),
            "[projector_from_camera]",
            f"rotation = [{rows}]  # by rows; +- {turns} degrees about x, y, z",
            f"translation_m = {_listed(pose.translation, 6)}  # +- {shifts} m",
            "",
        ]
    )


def _lens_lines(device: str, lens: Lens, size: Size, told: Parameters) -> Iterator[str]:
    names = [f"{device}.{name}" for name in LENS_NAMES]
    yield f"[{device}]"
    yield f'model = "{lens.kind}"'
    yield f"size = [{size[0]}, {size[1]}]"
    yield f"f = {_listed(lens.focal, 4)}  # +- {_sigmas(told, names[:2])} px"
    yield (
        f"c = {_listed(lens.centre, 4)}  # +- {_sigmas(told, names[2:4])} px; (0, 0) is the centre of "
        "the first pixel"
    )
    solved = names[4] in told
    yield f"k = {_listed(lens.distortion, 8)}" + (
        f"  # +- {_sigmas(told, names[4:])}" if solved else "  # not solved for"
    )
    yield ""


def _listed(values: Any, digits: int) -> str:
    return f"[{', '.join(f'{v:.{digits}f}' for v in values)}]"


def _sigmas(told: Parameters, names: Sequence[str]) -> str:
    return ", ".join(f"{told[name][1]:.2g}" for name in names)


def _say(pair: PlanarPair, told: Parameters, figures: Mapping[str, Figure], output: Output) -> None:
    for view in pair.boards:
        each = (f"{d} RMS {rms({view: left[view]}):.3f} px" for d, left in pair.residual_px.items())
        corners = len(pair.residual_px[DEVICES[1]][view])
        output.say(f"{view}: {corners} corners, {', '.join(each)}")
    for device, dropped in pair.dropped.items():
        if dropped:
            output.say(f"{device}: {len(dropped)} corners that fit nothing are dropped")
    for name, (value, sigma) in told.items():
        output.say(f"  {name:30} {value:>28.6g} +- {sigma:.2g}")
    output.table(figures)


def _document(
    pair: PlanarPair,
    told: Parameters,
    figures: Mapping[str, Figure],
    out: Path,
    skipped: Sequence[str],
) -> dict[str, Any]:
    pose = pair.projector_from_camera
    return {
        "out": str(out),
        "parameters": {n: {"value": v, "sigma": s} for n, (v, s) in told.items()},
        "rotation": pose.rotation.tolist(),
        "translation_m": pose.translation.tolist(),
        "covariance": pair.covariance.tolist(),
        "figures": {name: figure.as_dict() for name, figure in figures.items()},
        "poses": list(pair.boards),
        "left_out": list(skipped),
        "dropped_corners": {device: len(found) for device, found in pair.dropped.items()},
    }
