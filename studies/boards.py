"""Standard errors of `camera` and `pair` on boards and lenses outside their models.

Truth must lie within two of them in nine of ten seeds, and they must not exceed twice the real error.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from procam.estimate.boards.camera import NAMES, BoardView, fit_camera
from procam.estimate.boards.planar_pair import PairView, fit_planar_pair
from procam.maths.geometry.lenses import lens_parameters
from studies import foreign_boards as foreign
from studies.measure import write

Array = NDArray[np.float64]
SEEDS, WORKERS = 100, 2
PICTURE = np.array([[0.0, 0.0], foreign.SIZE]) - [[0, 0], [1, 1]]  # first and last pixel
TURN = Rotation.from_rotvec([0.03, 0.36, 0.02]).as_matrix()  # the axes meet where the boards are
SHIFT_M = -TURN @ np.array([0.12, 0.01, 0.0])
PAIR_NAMES = (
    *(f"{device}.{n}" for device in ("camera", "projector") for n in ("fx", "fy", "cx", "cy")),
    *(f"turn_{a}" for a in "xyz"),
    *(f"shift_{a}" for a in "xyz"),
)


@dataclass(frozen=True)
class Case:
    """The command, what is outside its model, and how many views there are."""

    command: str
    name: str
    views: int
    curled: bool
    prism: bool


CASES = (
    Case("camera", "noise", 12, curled=False, prism=False),
    Case("camera", "curl", 12, curled=True, prism=False),
    Case("camera", "prism", 12, curled=False, prism=True),
    Case("camera", "both", 12, curled=True, prism=True),
    Case("pair", "noise", 8, curled=False, prism=False),
    Case("pair", "both", 8, curled=True, prism=True),
)


def main() -> None:
    """Run all cases and write studies/boards.json and .md."""
    jobs = [(case, seed) for case in CASES for seed in range(SEEDS)]
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        results = list(pool.map(errors, *zip(*jobs, strict=True), chunksize=5))
    rows = [
        summary(case, [r for (c, _), r in zip(jobs, results, strict=True) if c is case])
        for case in CASES
    ]
    write("boards", {"rows": rows}, _report(rows))


def errors(case: Case, seed: int) -> tuple[Array, Array]:
    """Errors (P,) of the parameters of a case, and their standard errors (P,)."""
    return (camera_errors if case.command == "camera" else pair_errors)(case, seed)


def camera_errors(case: Case, seed: int) -> tuple[Array, Array]:
    """Errors (9,) of a camera's parameters, and their standard errors (9,)."""
    rng = np.random.default_rng([case.views, case.curled, case.prism, seed])
    lens = foreign.draw_lens(rng, foreign.PRISM * case.prism, (650.0, 510.0))
    board = foreign.curled_board(rng, rng.uniform(*foreign.CURL) * case.curled)
    views: list[BoardView] = []
    while len(views) < case.views:
        rotation, shift = foreign.draw_pose(rng)
        seen = foreign.photograph(rng, lens, board @ rotation.T + shift, foreign.SIZE)
        if foreign.enough([seen]):
            shown = np.isfinite(seen[:, 0])
            views.append(BoardView(str(len(views)), foreign.flat_board()[shown], seen[shown]))
    fit = fit_camera(views, foreign.SIZE, "brown")
    truth, _ = lens.nearest([PICTURE])
    return lens_parameters(fit.lens) - truth, np.array([*fit.sigma.values()])


def pair_errors(case: Case, seed: int) -> tuple[Array, Array]:
    """Errors (14,) of fx, fy, cx, cy of both lenses, the turn and the shift between them."""
    rng = np.random.default_rng([case.views, case.curled, case.prism, seed])
    camera, projector = (
        foreign.draw_lens(rng, foreign.PRISM * case.prism, middle)
        for middle in ((650.0, 510.0), (640.0, 560.0))
    )
    board = foreign.curled_board(rng, rng.uniform(*foreign.CURL) * case.curled)
    views: list[PairView] = []
    while len(views) < case.views:
        rotation, shift = foreign.draw_pose(rng)
        points = board @ rotation.T + shift
        seen = foreign.photograph(rng, camera, points, foreign.SIZE)
        lit = foreign.photograph(rng, projector, points @ TURN.T + SHIFT_M, foreign.PANEL)
        if foreign.enough([seen, lit]):
            shown = np.isfinite(seen[:, 0])
            corners = foreign.flat_board()[shown], seen[shown], lit[shown]
            views.append(PairView(str(len(views)), *corners))
    fit = fit_planar_pair(views, foreign.SIZE, foreign.PANEL)
    terms = (len(fit.covariance) - 6) // 2
    kept = np.r_[0:4, terms : terms + 4, 2 * terms : 2 * terms + 6]
    (one, one_turn), (other, other_turn) = (
        lens.nearest(seen_at)
        for lens, seen_at in (
            (camera, [view.camera_px for view in views]),
            (projector, [view.projector_px for view in views]),
        )
    )
    pose = fit.projector_from_camera
    turn = Rotation.from_matrix(pose.rotation @ (other_turn @ TURN @ one_turn.T).T).as_rotvec()
    lenses = [
        lens_parameters(lens)[:4] - true[:4]
        for lens, true in ((fit.camera, one), (fit.projector, other))
    ]
    shift_error = pose.translation - other_turn @ SHIFT_M
    return np.concatenate([*lenses, turn, shift_error]), np.sqrt(np.diag(fit.covariance))[kept]


def summary(case: Case, results: list[tuple[Array, Array]]) -> dict[str, Any]:
    """Per parameter: rms error, share of seeds within two standard errors, their median over it."""
    error, sigma = (np.array(part) for part in zip(*results, strict=True))
    spread = np.sqrt(np.mean(error**2, axis=0))
    return {
        "command": case.command,
        "case": case.name,
        "views": case.views,
        "names": list(NAMES["brown"] if case.command == "camera" else PAIR_NAMES),
        "rms_error": spread.tolist(),
        "covered": np.mean(np.abs(error) <= 2 * sigma, axis=0).tolist(),
        "sigma_over_error": (np.median(sigma, axis=0) / spread).tolist(),
    }


def _report(rows: list[dict[str, Any]]) -> list[str]:
    lines = [
        "# Standard errors of lenses from boards",
        "",
        f"{SEEDS} seeds per line; noise of 0.03 to 0.3 px, another in each view. Curl: one side of the board "
        "rises by 0.5 to 1.5 % of its width. Prism: thin-prism terms of 0.0005. The truth of such a lens is "
        "that of the nearest lens of the fitted kind, over a camera's picture, and where a "
        "pair's corners are.",
        "",
        "Goals: truth within two standard errors in >= 90 % of the seeds, median standard error <= 2 times "
        "the rms error. Least and most over all parameters.",
        "",
        "| command | outside the model | views | rms error, f | c | within two sigmas | sigma over error |",
        "|---|---|---|---|---|---|---|",
    ]
    return lines + [_line(row) for row in rows]


def _line(row: dict[str, Any]) -> str:
    names, error = row["names"], row["rms_error"]
    focal, centre = (
        max(e for n, e in zip(names, error, strict=True) if n.split(".")[-1] in ends)
        for ends in (("fx", "fy"), ("cx", "cy"))
    )
    ratio = row["sigma_over_error"]
    return (
        f"| {row['command']} | {row['case']} | {row['views']} | {focal:.2f} px | {centre:.2f} px | "
        f"{min(row['covered']):.0%} .. {max(row['covered']):.0%} | {min(ratio):.2f} .. {max(ratio):.2f} |"
    )
