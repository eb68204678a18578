"""Fiducials and distances that contradict each other, and gauge freedoms that none of them fixes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.errors import CalibrationError
from procam.estimate.geometry.fiducials import best_rotation, distance_in_rig, fiducial_points
from procam.estimate.geometry.model import RigGeometry
from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import Distance, Fiducial
from procam.model.provenance import Note

CONTRADICTION = 8.0  # sigmas of a residual that is an error, not noise
NOTED = 4.0  # sigmas of one that is noted: by chance one mark in three thousand
ROUGH = 1e-3  # error of a fiducial on a dome that is solved as an exact sphere [rad]
ROUGH_SHARE = 0.02  # relative error of a distance in such a rig


def check_fiducials(
    rig: RigGeometry,
    fiducials: Sequence[Fiducial],
    distances: Sequence[Distance],
    *,
    rough: bool,
    size_known: bool = True,
) -> None:
    """Refuse fiducials and distances that contradict each other.

    Parameters
    ----------
    rig, fiducials, distances : the solved rig and what was measured.
    rough : the rig was solved without fiducials, or the screen is not a sphere, so that correct
        fiducials may be arcminutes off.
    size_known : whether the size of the rig is determined without the distances.

    Raises
    ------
    CalibrationError
        With the name of the fiducial that disagrees with all others, if there is one.
    """
    _check_fiducials(rig, fiducials, ROUGH if rough else 0.0)
    share = ROUGH_SHARE if rough else 0.0
    lengths = np.array([distance_in_rig(rig, fiducials, d) for d in distances])
    metres = np.array([d.metres for d in distances])
    if not len(lengths):
        return
    scale = 1.0 if size_known else float(np.median(metres / lengths))
    sigma = np.hypot([d.sigma_m for d in distances], share * scale * lengths)
    off = np.abs(metres - scale * lengths) / sigma
    if off.max() > CONTRADICTION:
        i = int(off.argmax())
        raise CalibrationError(
            f"distances: {distances[i].a} to {distances[i].b} is given as {metres[i]:g} m, but "
            f"{'the rig makes' if size_known else 'the other distances make'} it about "
            f"{scale * lengths[i]:.3g} m. Correct it, or [screen] radius_m."
        )


def _check_fiducials(rig: RigGeometry, fiducials: Sequence[Fiducial], slack: float) -> None:
    if len(fiducials) < 2:
        return
    soft, seen = _softened(fiducials, slack), _seen(rig, fiducials)
    worst = _disagreement(soft, seen)
    if worst < CONTRADICTION:
        return
    names = list(dict.fromkeys(f.name for f in fiducials))  # several cameras may see one
    keep = {name: [f.name != name for f in fiducials] for name in names}
    without = {
        name: _disagreement([f for f, k in zip(soft, kept, strict=True) if k], seen[kept])
        for name, kept in keep.items()
    }
    suspects = [name for name in names if without[name] < CONTRADICTION]
    cause = f"{', '.join(names)} do not fit together"
    if len(suspects) == 1:
        cause = f"{suspects[0]} does not fit the others"
    elif 1 < len(suspects) < len(names):
        cause += f" ({' or '.join(suspects)} is wrong)"
    off = np.degrees(worst * max(f.sigma for f in soft))
    places = "azimuth_deg and elevation_deg"
    if isinstance(rig.shape, MeshShape):
        places = "the dimensions of the room in [screen], canvas_m"
    raise CalibrationError(
        f"fiducials: {cause}, off by up to {off:.2g} degrees. Check {places}, pixel, that the pixel shows "
        "this fiducial, and f, c and k of the camera."
    )


def fiducial_notes(rig: RigGeometry, fiducials: Sequence[Fiducial], *, rough: bool) -> list[Note]:
    """A note if fiducials fit together so badly that one of them may be wrong."""
    if len(fiducials) < 2:
        return []
    soft = _softened(fiducials, ROUGH if rough else 0.0)
    sigmas = _disagreement(soft, _seen(rig, fiducials))
    if sigmas < NOTED:
        return []
    text = (
        f"the fiducials are up to {sigmas:.1f} standard errors from where they fit together best, so that "
        "directions may be off by more than is stated. Check azimuth_deg, elevation_deg "
        "(in a room canvas_m) and pixel of each, and their standard errors"
    )
    return [Note("fiducials disagree", "", text, sigmas / NOTED)]


def _softened(fiducials: Sequence[Fiducial], slack: float) -> list[Fiducial]:
    return [replace(f, sigma=float(np.hypot(f.sigma, slack))) for f in fiducials]


def _seen(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> Array:
    """Directions (N, 3) in which the cameras see the fiducials."""
    return normalise(fiducial_points(rig, fiducials))


def _disagreement(fiducials: Sequence[Fiducial], seen: Array) -> float:
    """Largest residual [sigma] of fiducials seen in directions (N, 3), after the best rotation."""
    if len(seen) < 2:
        return 0.0
    return max(float(np.linalg.norm(error)) for error in best_rotation(fiducials, seen)[1])


def missing_fiducials(
    radius_known: bool, fiducials: Sequence[Fiducial], freedoms: int
) -> list[Note]:
    """Notes on the gauge freedoms that remain, and what would fix them; `freedoms` is their number."""
    notes, rotations = list[Note](), freedoms
    if not radius_known and freedoms in (1, 2, 4):
        rotations -= 1
        text = (
            "the dome's size is not known, and no distance in metres is given: add [screen] radius_m "
            "or one [[distances]]; directions and the compensation do not need it"
        )
        notes.append(Note("size unknown", "", text))
    if rotations >= 3:
        text = (
            "the dome's front and pole are not known: list two or more [[fiducials]] in venue.toml, or a "
            "springline and a front; until then the dome frame has the axes of the main camera"
        )
        notes.append(Note("rotation unknown", "", text, rotations))
    elif rotations:
        names = " and ".join(dict.fromkeys(f.name for f in fiducials)) or "the pole"
        text = f"the rotation about {names} is not known: list one more of [[fiducials]]"
        notes.append(Note("rotation unknown", "", text, rotations))
    return notes
