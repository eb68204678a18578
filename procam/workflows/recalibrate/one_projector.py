"""One projector solved anew from a session, in a rig of which all else stays."""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.known_rig import solve_projectors
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.recalibration import with_projector
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import nudges, projector_masks
from procam.model.calibration import Calibration
from procam.model.provenance import Note
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.main_camera import light_radiometer, screen_view
from procam.workflows.solve.decode import Decoded, decode_projector
from procam.workflows.solve.geometry import rig_problem
from procam.workflows.solve.light import light_of
from procam.workflows.solve.long_exposure import with_long_exposure
from procam.workflows.solve.plausible import check_on_screen
from procam.workflows.solve.provenance import session_provenance
from procam.workflows.solve.shared_black import never_dark, with_shared_black


@dataclass(frozen=True, slots=True)
class Repaired:
    """A calibration with one projector solved anew; the rms residual of its geometry; notes of its solve.

    `room` (3,): rise of the dark since the session [rel].
    """

    calibration: Calibration
    residual_px: float
    room: Array
    notes: list[Note]


def solve_again(
    venue: Venue, source: Session, session: Session, old: Calibration, name: str
) -> Repaired:
    """Solve one projector from a session; `source` is the session of the calibration."""
    now, before = (_measured(venue, each, old, name) for each in (session, source))
    kept = [note for note in old.provenance.notes if note.subject != f"projector {name}"]
    origin = replace(
        session_provenance(venue, session),
        notes=tuple(dict.fromkeys([*kept, *now.notes])),
        recalibrated=(*old.provenance.recalibrated, name),
        meter=old.provenance.meter,  # the content's unit stays
    )
    lights = (_with_black(venue, before, old, name), _with_black(venue, now, old, name))
    new = with_projector(old, name, now.geometry, now.view, lights, nudges(venue), origin)
    residual = now.geometry.residual_px[now.geometry.main, name]
    rms = float(np.sqrt(np.mean(residual**2)))
    return Repaired(new, rms, _rise_of_dark(now, old, name), now.notes)


@dataclass(frozen=True, slots=True)
class _Measured:
    """A projector's light in a session, the photographs, the rig in which it was solved, and notes."""

    light: ProjectorMeasurement
    images: SessionImages
    view: ScreenView
    geometry: GeometrySolution
    notes: list[Note]


def _measured(venue: Venue, session: Session, calibration: Calibration, name: str) -> _Measured:
    """A projector by the camera that the calibration's light was measured with, where it stands."""
    radiometer = light_radiometer(calibration.camera)
    images, notes = with_long_exposure(SessionImages(session, session.read_plan(), radiometer))
    found, geometry, decoded = _placed(venue, images, calibration, name)
    view = screen_view(venue, calibration.screen, radiometer)
    main = {(geometry.main, name): found}
    notes += [*decoded, *check_on_screen(view, main)]
    masks = projector_masks(venue)
    light = light_of(calibration.screen, images, view, geometry, main, masks, name)
    return _Measured(light, images, view, geometry, [*notes, *light.notes])


def _rise_of_dark(measured: _Measured, calibration: Calibration, name: str) -> Array:
    """Light (3,) of the room when a projector was photographed again, over that of the session [rel]."""
    (_, before), (_, own) = (measured.images.dark(each) for each in ("", name))
    rise = (own - before)[measured.view.on_screen]
    rise = np.nanmean(rise, axis=0, dtype=float)
    return np.asarray(calibration.content_from_camera @ rise)


def _with_black(
    venue: Venue, measured: _Measured, calibration: Calibration, name: str
) -> ProjectorMeasurement:
    """A projector's light, with its part of the blacks that the dark of that session holds."""
    names, session = never_dark(venue), measured.images.session
    if name not in names:
        return measured.light
    others = {n: _measured(venue, session, calibration, n).light for n in names if n != name}
    lights = {**others, name: measured.light}
    with_shared_black(venue, measured.images, measured.view, lights, name)
    return lights[name]


def _placed(
    venue: Venue, images: SessionImages, calibration: Calibration, name: str
) -> tuple[Decoded, GeometrySolution, list[Note]]:
    """What the main camera sees of a projector, the rig with that projector solved, and notes."""
    seen, gathered, notes = {}, {}, list[Note]()
    for camera in calibration.cameras.values():
        own = SessionImages(images.session, images.plan, Radiometer(camera))
        seen[camera.name], gathered[camera.name, name], lines = decode_projector(venue, own, name)
        notes += lines
    known = RigGeometry(
        calibration.screen.shape,
        calibration.cameras,
        {n: p.model for n, p in calibration.projectors.items()},
    )
    problem, main = rig_problem(venue, gathered, ()), calibration.main_camera
    return seen[main], solve_projectors(problem, known, [name], main=main), notes
