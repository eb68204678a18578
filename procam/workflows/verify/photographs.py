"""The photographs that a verification compares: of the calibrated session, and of today.

Of each projector white, black and one picture of level tiles; white again at the end, for lamps that are
still warming up; and one of the dark room at each exposure.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Image
from procam.errors import FileFormatError, OutOfModelRange
from procam.estimate.drift.pictures import ProjectorPhotographs, VenuePhotographs
from procam.files.session import PRUNED, Session
from procam.files.venue.load import Venue
from procam.model.calibration import Calibration
from procam.model.plan import Plan, Purpose
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import Photographer, Wanted
from procam.workflows.solve.long_exposure import with_long_exposure

DARK_LONG, AGAIN, AGAIN_DARK = "dark, long", "white again", "dark again"
LONG = DARK_LONG, "black"  # what is photographed with black's exposure
SATURATED_SHARE = 0.001  # of the screen; above it the exposure is halved
HALVINGS = 8
ROOM_CHANGE = 0.01  # of the light that one projector's white puts on most of the dome
COMPARED = "dark", "white", "black", "levels"  # purposes of shots
LEVELS = 0  # which of the pictures of level tiles


@dataclass(frozen=True)
class Reference:
    """The session that a calibration was solved from, as its main camera saw it.

    `pictures` are drives (H, W, 3) by projector and purpose: white, black, levels.
    """

    images: SessionImages
    photographs: VenuePhotographs
    pictures: Mapping[str, Mapping[Purpose, Image]]

    def of(self, names: Collection[str]) -> "Reference":
        """The same of some projectors."""
        shown = {n: p for n, p in self.photographs.projectors.items() if n in names}
        pictures = {n: p for n, p in self.pictures.items() if n in names}
        return replace(
            self, photographs=replace(self.photographs, projectors=shown), pictures=pictures
        )


def read_reference(venue: Venue, calibration: Calibration) -> Reference:
    """Read the photographs of a calibration's session.

    Raises
    ------
    FileFormatError
        They are gone, or are not those of this calibration.
    """
    name = calibration.provenance.session
    session = Session(venue.directory / "sessions" / name)
    if not (session.directory / "plan.json").is_file():
        raise FileFormatError(
            f"{session.directory}: the session of the calibration in use is gone, and its photographs are "
            "needed to compare with. Restore it, or calibrate again"
        )
    camera = MainCamera.of(venue, calibration)
    plan, names = session.read_plan(), list(calibration.projectors)
    if session.is_pruned:
        raise FileFormatError(PRUNED.format(session=session.directory))
    _check_stored(session, plan, camera.name)
    images, _ = with_long_exposure(SessionImages(session, plan, camera.radiometer))
    short, _ = images.dark()
    shown = {name: _stored(images, name) for name in names}
    photographs = VenuePhotographs(camera.view, short, shown)
    return Reference(images, photographs, {name: _pictures(images, name) for name in names})


def _check_stored(session: Session, plan: Plan, camera: str) -> None:
    """Refuse a session without the frames that are compared; new ones would be of the venue of today."""
    stored = session.stored(camera)
    missing = [
        shot.id
        for shot in plan.shots
        if shot.purpose in COMPARED and any((shot.id, e) not in stored for e in shot.exposures_s)
    ]
    if missing:
        raise FileFormatError(
            f"{session.directory}: photographs of {', '.join(missing[:3])} by camera {camera} are gone, and "
            "a verification compares with them. Restore them from a backup, or calibrate again"
        )


def _stored(images: SessionImages, name: str) -> ProjectorPhotographs:
    short, long = images.dark(name)
    black = images.light(images.only(name, "black")) - long
    white, levels = (
        images.light(images.plan.of(name, purpose)[LEVELS]) - short - black
        for purpose in ("white", "levels")
    )
    return ProjectorPhotographs(white, black, levels)


def _pictures(images: SessionImages, name: str) -> dict[Purpose, Image]:
    purposes: tuple[Purpose, ...] = ("white", "black", "levels")
    shots = {purpose: images.plan.of(name, purpose)[LEVELS] for purpose in purposes}
    return {purpose: images.session.pattern(shot) for purpose, shot in shots.items()}


def take_photographs(
    photographer: Photographer, reference: Reference
) -> Iterator[tuple[str, VenuePhotographs | None]]:
    """Photograph the venue as it is; yields what was done, and at the end the photographs.

    The camera is taken to be where it was. What is too bright for the session's exposure is photographed
    again with half of it, and so is all that follows.
    """
    camera = _Camera(photographer, reference)
    wanted = list(_wanted(reference))
    camera.plan(wanted)
    taken: dict[tuple[str, str], Image] = {}
    for name, what, pictures in wanted:
        taken[name, what] = camera.light(what, pictures)
        yield f"{name or 'the dark room'}: {what}", None
    found, short = reference.photographs, taken["", "dark"]
    _check_room(short, taken["", AGAIN_DARK], found)
    shown = {}
    for name, before in found.projectors.items():
        black = taken[name, "black"] - taken["", DARK_LONG]
        less = short + np.where(np.isfinite(black), black, before.black)
        shown[name] = ProjectorPhotographs(
            taken[name, "white"] - less,
            black,
            taken[name, "levels"] - less,
            taken[name, AGAIN] - less,
        )
    yield "photographed", VenuePhotographs(found.view, short, shown)


def _check_room(first: Image, last: Image, reference: VenuePhotographs) -> None:
    """Refuse photographs between which the room's light changed.

    Raises
    ------
    OutOfModelRange
        By how much, of the white of the projectors.
    """
    seen = (
        reference.view.on_screen & np.isfinite(first).all(axis=-1) & np.isfinite(last).all(axis=-1)
    )
    whites = [np.nanmedian(p.white[seen]) for p in reference.projectors.values()]
    change = float((last[seen].mean(dtype=float) - first[seen].mean(dtype=float)) / np.mean(whites))
    if abs(change) > ROOM_CHANGE:
        raise OutOfModelRange(
            f"the room's own light changed by {change:+.1%} of a projector's light meanwhile; "
            "keep lamps and doors as they are, and verify again"
        )


class _Camera:
    """Gives radiance (H, W, 3), and shortens exposures that saturate."""

    def __init__(self, photographer: Photographer, reference: Reference) -> None:
        images = reference.images
        short_s, long_s = images.only("", "dark").exposures_s
        self._photographer, self._radiometer = photographer, images.radiometer
        self._seen, self._long = (
            reference.photographs.view.on_screen,
            np.float32(images.long_exposure),
        )
        self._exposure_s = {False: short_s, True: long_s}

    def plan(self, wanted: Sequence[tuple[str, str, Mapping[str, Image]]]) -> None:
        """Say what will be asked for."""
        self._photographer.plan([self._of(what, pictures) for _, what, pictures in wanted])

    def light(self, what: str, pictures: Mapping[str, Image]) -> Image:
        """Radiance of a picture, NaN where it is too bright even so."""
        light = self._radiometer.radiance(self._photographer.take(self._of(what, pictures)))
        for _ in range(HALVINGS):
            if np.isnan(light[self._seen]).any(axis=-1).mean() <= SATURATED_SHARE:
                break
            self._exposure_s[what in LONG] /= 2
            light = self._radiometer.radiance(self._photographer.take(self._of(what, pictures)))
        return light / self._long if what in LONG else light

    def _of(self, what: str, pictures: Mapping[str, Image]) -> Wanted:
        return Wanted(pictures, self._exposure_s[what in LONG])


def _wanted(reference: Reference) -> Iterator[tuple[str, str, Mapping[str, Image]]]:
    """Projector, what, pictures. All whites first and again at the end: a lamp that warms up shows."""
    shown = reference.pictures
    yield "", "dark", {}
    yield "", DARK_LONG, {}
    for name, pictures in shown.items():
        yield name, "white", {name: pictures["white"]}
    for name, pictures in shown.items():
        yield name, "black", {name: pictures["black"]}
        yield name, "levels", {name: pictures["levels"]}
    for name, pictures in shown.items():
        yield name, AGAIN, {name: pictures["white"]}
    yield "", AGAIN_DARK, {}
