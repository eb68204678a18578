"""The rig and the light of a session: all that its photographs are needed for."""

from collections.abc import MutableMapping
from dataclasses import dataclass, replace

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.provenance import Note
from procam.model.screen import Screen
from procam.workflows.events import Event, Steps
from procam.workflows.solve.main_view import main_view
from procam.workflows.solve.rig import SolvedRig, solve_session_rig
from procam.workflows.solve.shared_black import BlackLight, with_shared_black


@dataclass(frozen=True, slots=True)
class MeasuredSession:
    """What a calibration is assembled from besides the light of projectors; no picture is in it."""

    rig: SolvedRig
    screen: Screen
    geometry: GeometrySolution
    view: ScreenView
    black: BlackLight
    notes: list[Note]


def measure_session(
    venue: Venue, session: Session, measured: MutableMapping[str, ProjectorMeasurement], total: int
) -> Steps[MeasuredSession]:
    """Solve the rig and measure the light of every projector; what was decoded is dropped at the end.

    Geometry from all cameras; light from the one that sees most. `total` steps are those of the solve.
    """
    names = list(venue.table.projectors)
    rig = yield from solve_session_rig(venue, session, total)
    placed = total - len(names) - 2
    yield Event("solve", placed, total, f"geometry solved; {rig.verdict}")
    main = main_view(venue, rig)
    for done, name in enumerate(main.measure_into(measured, names), placed + 1):
        yield Event("solve", done, total, f"{name} light split, response fitted")
    black = with_shared_black(venue, main.images, main.view, measured)
    notes = [*rig.notes, *main.notes, *black.notes]
    return MeasuredSession(
        replace(rig, found={}), main.screen, main.geometry, main.view, black, notes
    )
