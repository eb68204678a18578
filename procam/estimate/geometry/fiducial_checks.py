"""Fiducials and distances that contradict each other, and what is still missing, by name."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procam.errors import CalibrationError
from procam.estimate.geometry.fiducials import best_turn, length_of, seen_point
from procam.estimate.geometry.model import RigGeometry
from procam.maths.geometry.sphere import normalise
from procam.model.optics import Distance, Fiducial

Array = NDArray[np.float64]
CONTRADICTION = 8.0  # sigmas
ROUGH = 1e-3  # how far an exact sphere may misplace a mark on a dome that is none [rad]
ROUGH_SHARE = 0.02  # of a distance in a rig that was solved without any


def check_marks(
    rig: RigGeometry,
    fiducials: Sequence[Fiducial],
    distances: Sequence[Distance],
    *,
    rough: bool,
    size_known: bool = True,
) -> None:
    """Complain of marks that contradict each other, and name the one that the others outvote.

    `rough`: the rig was solved without marks, or the screen is no sphere, so that marks may be
    arcminutes off without anybody's fault. The size of the rig is a guess unless known.

    Raises
    ------
    CalibrationError
        With the mark's name.
    """
    _check_fiducials(rig, fiducials, ROUGH if rough else 0.0)
    share = ROUGH_SHARE if rough else 0.0
    lengths = np.array([length_of(rig, fiducials, d) for d in distances])
    metres = np.array([d.metres for d in distances])
    if not len(lengths):
        return
    scale = 1.0 if size_known else float(np.median(metres / lengths))
    sigma = np.hypot([d.sigma_m for d in distances], share * scale * lengths)
    off = np.abs(metres - scale * lengths) / sigma
    if off.max() > CONTRADICTION:
        i = int(off.argmax())
        raise CalibrationError(
            f"distances: got {metres[i]:g} m from {distances[i].a} to {distances[i].b}, expected about "
            f"{scale * lengths[i]:.3g} m, which the rig is solved to"
            f"{'' if size_known else ' by the other distances'}; correct it, or [screen] radius_m"
        )


def _check_fiducials(rig: RigGeometry, fiducials: Sequence[Fiducial], slack: float) -> None:
    if len(fiducials) < 2:
        return
    soft = [replace(f, sigma=float(np.hypot(f.sigma, slack))) for f in fiducials]
    seen = normalise(np.array([seen_point(rig, f) for f in fiducials]))
    worst = _disagreement(soft, seen)
    if worst < CONTRADICTION:
        return
    names = list(dict.fromkeys(f.name for f in fiducials))  # several cameras may see one
    keep = {name: [f.name != name for f in fiducials] for name in names}
    without = {
        name: _disagreement([f for f, k in zip(soft, kept, strict=True) if k], seen[kept])
        for name, kept in keep.items()
    }
    guilty = [name for name in names if without[name] < CONTRADICTION]
    told = f"{', '.join(names)} do not fit together"
    if len(guilty) == 1:
        told = f"{guilty[0]} does not fit the others"
    elif 1 < len(guilty) < len(names):
        told += f" ({' or '.join(guilty)} is wrong)"
    off = np.degrees(worst * max(f.sigma for f in soft))
    raise CalibrationError(
        f"fiducials: {told}, off by up to {off:.2g} degrees; check azimuth_deg, elevation_deg and "
        "pixel, and that it is this mark the pixel shows"
    )


def _disagreement(fiducials: Sequence[Fiducial], seen: Array) -> float:
    """Largest part, in sigmas, that the best turn leaves of fiducials seen in directions (N, 3)."""
    if len(seen) < 2:
        return 0.0
    return max(float(np.linalg.norm(left)) for left in best_turn(fiducials, seen)[1])


def missing_marks(radius_known: bool, fiducials: Sequence[Fiducial], freedoms: int) -> list[str]:
    """What is not fixed in space, by name, and what would fix it; `freedoms` as a solution counts."""
    lines, turns = [], freedoms
    if not radius_known and freedoms in (1, 2, 4):
        turns -= 1
        lines.append(
            "the dome's size is not known, and no distance in metres is told: give [screen] radius_m "
            "or one [[distances]]; directions and the compensation do not need it"
        )
    if turns >= 3:
        lines.append(
            "nothing tells the dome's front and pole: list two or more [[fiducials]] in venue.toml, or a "
            "springline and a front; until then the main camera's own axes are taken"
        )
    elif turns:
        names = " and ".join(dict.fromkeys(f.name for f in fiducials)) or "the pole"
        lines.append(f"the dome may still turn about {names}: list another of [[fiducials]]")
    return lines
