"""Solves the rig from decoded pictures and a venue's marks, and names what does not fit."""

from collections.abc import Mapping, Sequence

from procam.errors import CalibrationError
from procam.estimate.geometry.adjustment import LENS_PRIOR, RigProblem
from procam.estimate.geometry.diagnosis import find_causes, focal_share, rescaled_by
from procam.estimate.geometry.fiducial_checks import fiducial_notes, missing_fiducials
from procam.estimate.geometry.fiducials import with_camera_errors
from procam.estimate.geometry.model import Observations, Pair
from procam.estimate.geometry.solve import MAX_SPHERE_RATIO, GeometrySolution, solve_geometry
from procam.estimate.geometry.start import MIN_OBSERVATIONS, ProjectorPrior
from procam.estimate.geometry.walls import MovedWall, moved_walls
from procam.files.venue.load import Venue
from procam.files.venue.tables import DomeTable
from procam.model.optics import Fiducial
from procam.model.provenance import Note
from procam.workflows.solve.apriltags import known_distances

# departures of a lens from its prior: beyond the first they are named; beyond the second, 3.5 %, the prior
# pulls directions by more than is stated (1.5 times at 4 %, with one camera). Misfits make 3.1 % in one
# of 100 drawn rooms
PRIOR_SIGMAS, REFUSED_SIGMAS = 2.0, 7.0
NOTED_M, NOTED_SIGMAS = 0.005, 2.0  # of a wall that is not where it was drawn


def rig_problem(
    venue: Venue, seen: Mapping[Pair, Observations], marks: Sequence[Fiducial]
) -> RigProblem:
    """What is known of a venue's rig before it is solved."""
    table = venue.table
    return RigProblem(
        venue.screen.shape,
        venue.cameras,
        {
            name: ProjectorPrior(name, entry.size, entry.lens)
            for name, entry in table.projectors.items()
        },
        {pair: some for pair, some in seen.items() if len(some.sigma_px) >= MIN_OBSERVATIONS},
        {name: entry.intrinsics for name, entry in table.cameras.items()},
        marks,
        known_distances(venue, marks),
        not (isinstance(table.screen, DomeTable) and table.screen.radius_m is None),
    )


def solve_rig(problem: RigProblem) -> tuple[GeometrySolution, str, list[Note]]:
    """The solved rig, a verdict on the screen's shape, and notes.

    Raises
    ------
    CalibrationError
        If there is no solution; with the probable cause, if one of `find_causes` is it.
    """
    try:
        found = solve_geometry(problem)
    except CalibrationError as error:
        text = [str(error), *find_causes(problem, None)]
        raise type(error)("\n".join(text)) from error
    marks = with_camera_errors(found.rig, problem.fiducials)
    notes = missing_fiducials(problem.radius_known, marks, found.gauge_freedoms)
    rough = found.sphere_systematic_ratio >= MAX_SPHERE_RATIO
    notes += fiducial_notes(found.rig, marks, rough=rough)
    verdict, guilty = _verdict(found), find_causes(problem, found)
    causes = guilty or ([verdict] if rough else [])
    notes += _wall_notes(moved_walls(found.rig, found.covariance))
    notes += [*_lens_notes(problem, found), *(Note("misfit", "", cause) for cause in causes)]
    return found, verdict, notes


def _lens_notes(problem: RigProblem, found: GeometrySolution) -> list[Note]:
    """Cameras whose solved focal length contradicts the prior, which still pulls directions and light.

    Raises
    ------
    CalibrationError
        If it contradicts the prior so much that directions would be wrong by more than is stated.
    """
    notes = []
    for name, camera in problem.cameras.items():
        prior = LENS_PRIOR["prior"]
        if problem.intrinsics[name] != "prior" or prior is None:
            continue
        share = focal_share(camera.lens, found.rig.cameras[name].lens)
        advice = f'or correct f, or set intrinsics = "solve", as "prior" means {prior[0]:.1%}'
        line = f"{rescaled_by(name, share)}; {advice}"
        if abs(share) > REFUSED_SIGMAS * prior[0]:
            raise CalibrationError(line)
        if abs(share) > PRIOR_SIGMAS * prior[0]:
            text = line.removeprefix(f"camera {name}: ")
            notes.append(Note("lens contradicts", f"camera {name}", text, share / prior[0]))
    return notes


def _wall_notes(walls: Sequence[MovedWall]) -> list[Note]:
    """Walls that are so far from where venue.toml has them that its dimensions are worth correcting."""
    return [
        Note("wall off", each.name, _off(each), each.most_m / NOTED_M)
        for each in walls
        if each.most_m > max(NOTED_M, NOTED_SIGMAS * each.most_sigma_m)
    ]


def _off(wall: MovedWall) -> str:
    """How a wall is off, and what to do."""
    far, sigma, most = (1e3 * x for x in (abs(wall.outwards_m), wall.sigma_m, wall.most_m))
    has = "The calibration has it where it is"
    if far < NOTED_SIGMAS * sigma:
        return f"it is tilted or shifted by up to {most:.0f} mm against venue.toml. {has}"
    side = "farther from" if wall.outwards_m > 0 else "nearer to"
    return (
        f"it is {far:.0f} +- {sigma:.0f} mm {side} the middle of the room than venue.toml says, and up to "
        f"{most:.0f} mm at its edges. {has}; measure it, and correct [screen] if that is much"
    )


def _verdict_on_room(systematic_ratio: float, ratio: str, walls: Sequence[MovedWall]) -> str:
    if systematic_ratio < MAX_SPHERE_RATIO and walls:
        worst = max(walls, key=lambda wall: wall.most_m)
        return (
            f"walls are not quite where venue.toml has them, {worst.name} most "
            f"({1e3 * worst.most_m:.0f} mm); their places were solved {ratio}"
        )
    if systematic_ratio < MAX_SPHERE_RATIO:
        return f"walls are where venue.toml has them {ratio}"
    return (
        f"the pictures do not quite fit the screen of venue.toml {ratio}. Likely: a wall that is off, a "
        '"fixed" lens that is, or a device that moved. Standard errors of directions include that'
    )


def _verdict(found: GeometrySolution) -> str:
    ratio = f"(ratio {found.sphere_systematic_ratio**2:.1f})"
    if not (found.rig.shape.is_sphere or found.rig.shape.degree):
        walls = moved_walls(found.rig, found.covariance)
        return _verdict_on_room(found.sphere_systematic_ratio, ratio, walls)
    if found.sphere_systematic_ratio < MAX_SPHERE_RATIO:
        return f"the dome is a sphere {ratio}"
    degree, alone = found.rig.shape.degree, len(found.rig.cameras) == 1
    if not degree:
        return (
            f"the pictures do not fit a sphere {ratio}, and a smooth deformation does not explain it. "
            'Likely: the wrong lens model, a "fixed" lens that is off, panel seams, or a device that moved. '
            "Standard errors of directions include that"
        )
    caveat = (
        ", which one camera cannot tell from a wrong lens; a second camera can" if alone else ""
    )
    shape = f"its shape was solved up to harmonics of degree {degree}"
    return f"the dome is NOT a sphere {ratio}; {shape}{caveat}"
