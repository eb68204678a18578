"""Fiducials that contradict each other are named; those that agree are accepted."""

from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome

from procam.errors import CalibrationError
from procam.estimate.geometry.fiducial_checks import check_fiducials, fiducial_notes
from procam.estimate.geometry.solve import solve_geometry
from procam.model.optics import Distance, Fiducial

SIGMA = 1.7e-4  # a hundredth of a degree
DOME = SimulatedDome.build(1, projectors=2)
SEEN = DOME.observations(64)


def _marks(count: int = 5) -> list[Fiducial]:
    return DOME.fiducials(SIGMA, count)


def _off(mark: Fiducial, degrees: float) -> Fiducial:
    assert mark.elevation is not None
    return replace(mark, elevation=mark.elevation + np.radians(degrees))


def _complaint(fiducials: list[Fiducial], **more: object) -> str:
    with pytest.raises(CalibrationError) as message:
        solve_geometry(DOME.problem(SEEN, fiducials=fiducials, **more))
    return str(message.value)


@pytest.mark.parametrize("degrees", [20.0, 0.15])
def test_one_wrong_fiducial_of_five_is_named(degrees: float) -> None:
    marks = _marks()
    marks[3] = _off(marks[3], degrees)
    message = _complaint(marks)
    assert message.startswith("fiducials: back does not fit the others, off by up to")


def test_of_three_fiducials_all_suspects_are_named() -> None:
    marks = _marks(3)
    marks[1] = _off(marks[1], 0.6)
    message = _complaint(marks)
    assert message.startswith("fiducials: ") and "left" in message


@pytest.mark.parametrize(("sigmas", "named"), [(2.0, False), (8.0, True)])
def test_a_fiducial_that_is_doubtful_is_noted(sigmas: float, named: bool) -> None:
    """The others give way to it by a third, so that less is left than it is off."""
    marks = _marks()
    marks[3] = _off(marks[3], np.degrees(sigmas * SIGMA))
    rig = solve_geometry(DOME.problem(SEEN, fiducials=marks)).rig
    notes = fiducial_notes(rig, marks, rough=False)
    assert len(notes) == named
    assert all("standard errors from where they fit together best" in str(note) for note in notes)


def test_a_springline_that_is_wrong() -> None:
    marks = _marks(3)
    marks += [replace(_off(m, 3.0), name="rim", azimuth=None) for m in _marks()[3:4]]
    assert _complaint(marks).startswith("fiducials: rim does not fit the others")


@pytest.mark.parametrize("known", [True, False])
def test_a_distance_that_does_not_fit(known: bool) -> None:
    rig = DOME.rig()
    places = {n: c.camera_from_dome.origin for n, c in rig.cameras.items() if c.camera_from_dome}
    places |= {n: p.projector_from_dome.origin for n, p in rig.projectors.items()}

    def between(a: str, b: str, times: float = 1.0) -> Distance:
        return Distance(a, b, times * float(np.linalg.norm(places[a] - places[b])), 0.01)

    sound = [between("zenith", "south"), between("zenith", "north"), between("south", "north")]
    solve_geometry(DOME.problem(SEEN, distances=sound, radius_known=known))
    message = _complaint(
        list(DOME.fiducials()),
        distances=[*sound[:2], between("south", "north", 3.0)],
        radius_known=known,
    )
    assert message.startswith("distances: south to north is given as ") and "make" in message


def test_distances_in_a_rig_that_is_roughly_known_have_two_percent() -> None:
    rig = DOME.rig()
    south, north = (rig.projectors[name].projector_from_dome.origin for name in ("south", "north"))
    metres = float(np.linalg.norm(south - north))
    near, far = (Distance("south", "north", times * metres, 1e-3) for times in (1.03, 1.3))
    check_fiducials(rig, [], [near], rough=True)
    for wrong, rough in ((near, False), (far, True)):
        with pytest.raises(CalibrationError, match="distances: south to north is given as"):
            check_fiducials(rig, [], [wrong], rough=rough)
