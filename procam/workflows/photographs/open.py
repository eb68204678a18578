"""The photographer of a venue: its devices, or its people."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from procam.devices.rig import Rig
from procam.errors import CalibrationError, InputError
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.tables import BY_HAND
from procam.model.calibration import Calibration
from procam.model.frame import Frame
from procam.model.optics import CameraModel
from procam.workflows.capture.ingest import camera_and_response
from procam.workflows.capture.settings import read_settings
from procam.workflows.photographs.driven import DrivenPhotographer, Photographer, Wanted
from procam.workflows.photographs.likeness import same, sampled
from procam.workflows.photographs.orders import Asked
from procam.workflows.photographs.receive import receive
from procam.workflows.photographs.rounds import Rounds
from procam.workflows.venue_rig import rig_owner

Size = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Given:
    """A folder of photographs for the last round, or to `replace` those that were given last."""

    folder: Path
    replace: bool = False


class HandPhotographer(Photographer):
    """Gives the photographs that are stored, and asks for the first that is not."""

    def __init__(self, rounds: Rounds, notes: Sequence[str] = ()) -> None:
        self._rounds, self.notes = rounds, notes
        self._used: list[str] = []
        self._planned: list[Wanted] = []
        self._last: Asked

    @property
    def again(self) -> str:
        """What to do if the photographs turn out to be bad."""
        return (
            "Give other photographs of the last round with --photos and --replace, or remove "
            f"{self._rounds.folder} to begin again"
        )

    def plan(self, wanted: Sequence[Wanted]) -> None:
        """Ask for these together, unless they belong to a longer plan."""
        if not any(_equal(first, each) for first in wanted[:1] for each in self._planned):
            self._planned = [*wanted, *self._planned]

    def take(self, wanted: Wanted) -> Frame:
        """The photograph.

        Raises
        ------
        PhotographsWanted
            It was not taken yet.
        """
        self.plan([wanted])
        asked = self._rounds.find(wanted, self._used)
        if asked is None:
            raise self._rounds.ask(self._missing())
        self._used.append(asked.id)
        at = next(i for i, each in enumerate(self._planned) if _equal(wanted, each))
        del self._planned[at]
        self._last = asked
        return self._rounds.frame(asked)

    def retake(self, wanted: Wanted) -> Frame:
        """The photograph that was given last."""
        return self._rounds.frame(self._last)

    def end(self) -> None:
        """The next one begins a new folder, unless photographs of this one are replaced."""
        self._rounds.end()

    def _missing(self) -> list[Wanted]:
        """What is planned and not stored."""
        used, missing = list(self._used), list[Wanted]()
        for each in self._planned:
            asked = self._rounds.find(each, used)
            if asked is None:
                missing.append(each)
            else:
                used.append(asked.id)
        return missing


def _equal(first: Wanted, second: Wanted) -> bool:
    """Whether two are of the same pictures and exposure."""
    if first.exposure_s != second.exposure_s or first.pictures.keys() != second.pictures.keys():
        return False
    return same(sampled(first.pictures), sampled(second.pictures))


@contextmanager
def photographer_of(
    venue: Venue,
    calibration: Calibration,
    work: str,
    of: str,
    given: Given | None,
    settle_s: float = 0.0,
    rig: Callable[[], Rig] | None = None,
) -> Iterator[Photographer]:
    """A photographer with the camera that the calibration's light was measured with.

    Of a venue that is driven by hand it has the photographs of sessions/WORK-0001, and those in the
    given folder too. `of` is what the work is of: another begins a folder of its own. Devices wait
    `settle_s` [s] before a new picture is photographed; they are those of `rig`, which then is not left here.

    Raises
    ------
    InputError
        Photographs were given, but devices take them; or the calibration is of other devices.
    CalibrationError
        Of the block, with what to do about the photographs.
    """
    check_devices(venue, calibration)
    if not is_by_hand(venue):
        refuse_mixed(venue)
        if given:
            raise InputError(
                "--photos is for venues whose devices are all driven by hand; leave it out"
            )
        with nullcontext(rig) if rig else rig_owner(venue) as opened:
            yield DrivenPhotographer(opened(), calibration, settle_s)
        return
    camera = calibration.camera
    session = Session(venue.directory / "sessions" / calibration.provenance.session)
    with hand_photographer(venue, camera, session, work, of, given) as photographer:
        yield photographer


def is_by_hand(venue: Venue) -> bool:
    """Whether all devices are by hand."""
    return set(_backends(venue).values()) == {BY_HAND}


def refuse_mixed(venue: Venue) -> None:
    """Refuse a venue that is by hand in part: rounds of photographs and devices cannot take turns."""
    hand = [name for name, backend in _backends(venue).items() if backend == BY_HAND]
    if hand and not is_by_hand(venue):
        raise InputError(
            f"{venue.directory / 'venue.toml'}: this command needs all devices driven by procam, or "
            f"none; {', '.join(hand)} {'is' if len(hand) == 1 else 'are'} by hand. Remove backend from the "
            f"others to photograph by hand, or give {hand[0]} a backend"
        )


def _backends(venue: Venue) -> dict[str, str]:
    cameras, projectors = venue.table.cameras.items(), venue.table.projectors.items()
    return {n: c.backend for n, c in cameras} | {n: p.backend for n, p in projectors}


@contextmanager
def hand_photographer(
    venue: Venue,
    camera: CameraModel,
    session: Session | None,
    work: str,
    of: str,
    given: Given | None,
) -> Iterator[HandPhotographer]:
    """The photographer of the newest rounds of a work, with the photographs of a given folder too.

    ISO, aperture and the camera's response are those of `session`, which the work builds on if it does.
    """
    exposure_s = venue.table.capture.exposure_s
    ended = given is not None and given.replace
    rounds = Rounds.newest(venue.directory, work, camera, exposure_s, of, ended=ended)
    notes = list[str]()
    if given:
        session = session or rounds.session
        _, response, _ = camera_and_response(venue, session, camera.name)
        if given.replace:
            rounds.reopen()
        notes = receive(rounds, given.folder, response, read_settings(session, camera.name))
    photographer = HandPhotographer(rounds, notes)
    try:
        yield photographer
    except CalibrationError as error:
        text = str(error) + "." * (str(error)[-1] not in "?.")
        raise type(error)(f"{text} {photographer.again}") from error


def check_devices(venue: Venue, calibration: Calibration) -> None:
    """Refuse a calibration of other cameras or projectors than the venue's."""
    table = venue.table
    sizes = {n: camera.size for n, camera in calibration.cameras.items()}
    _check_devices(venue, "camera", sizes, {n: t.size for n, t in table.cameras.items()})
    sizes = {n: p.model.size for n, p in calibration.projectors.items()}
    _check_devices(venue, "projector", sizes, {n: t.size for n, t in table.projectors.items()})


def _check_devices(
    venue: Venue, kind: str, known: Mapping[str, Size], there: Mapping[str, Size]
) -> None:
    for name, size in known.items():
        if there.get(name) != size:
            found = (
                f"{kind} {name} of size {list(there[name])}"
                if name in there
                else f"no {kind} {name}"
            )
            raise InputError(
                f"{venue.directory / 'venue.toml'}: {found}, but the newest calibration has {kind} {name} of "
                f"{list(size)}; calibrate it again"
            )
