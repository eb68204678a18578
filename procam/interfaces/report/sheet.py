"""The operators' sheet of a venue: one page with what they run, check and do when something is wrong."""

from collections.abc import Iterator
from pathlib import Path
from shlex import quote

from procam.files import atomic
from procam.files.calibration import load_dome
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use, list_calibrations
from procam.interfaces.report.cover import date_text, is_served
from procam.interfaces.report.data import written_at
from procam.interfaces.report.page import html_template
from procam.model.screen import Dome

NAME = "operator-sheet.html"
SHOW, FRAMES, TRACK = "show.mov", "frames", "show-track"
LISTED = 4  # earlier calibrations that the sheet names


def write_sheet(venue_dir: Path) -> Path:
    """Write VENUE/operator-sheet.html, one self-contained page; returns its path.

    Raises
    ------
    InputError
        jinja2 is not installed, or the folder has no venue.toml.
    FileFormatError
        The venue has no calibration.
    """
    venue, used = load_venue(venue_dir), calibration_in_use(venue_dir)
    folder = quote(str(venue_dir.resolve()))
    page = html_template("sheet_template.html").render(
        venue=venue_dir.resolve().name,
        number=used.name,
        written=date_text(written_at(used)),
        folder=folder,
        frames=_frames_text(venue),
        play=list(_play(venue, folder)),
        states=sorted(load_dome(used).states),
        earlier=[(p.name, date_text(written_at(p))) for p in _earlier(venue_dir, used)],
        symptoms=list(_symptoms(venue, folder)),
    )
    path = venue_dir / NAME
    atomic.write_text(path, page)
    return path


def _earlier(venue_dir: Path, used: Path) -> list[Path]:
    """The newest calibrations that were made before the one in use, newest first."""
    there = [path for path in list_calibrations(venue_dir) if path.name < used.name]
    return there[::-1][:LISTED]


def _frames_text(venue: Venue) -> str:
    """What is played, and by whom."""
    names = ", ".join(venue.table.projectors)
    if is_served(venue):
        return f"Play the movie in {FRAMES}/ on the media server ({names}), as any dome master."
    return f"Play the movies in {FRAMES}/, each on the projector of its name: {names}."


def _play(venue: Venue, folder: str) -> Iterator[tuple[str, str]]:
    """Steps to make a show ready, as (what for, command)."""
    what = "the server's movie" if is_served(venue) else "the projectors' movies"
    yield (
        f"Take the scattered light out of the show, and make {what}",
        f"procam compensate {folder} {SHOW} {FRAMES} --to projectors",
    )
    if not isinstance(venue.screen, Dome):
        return
    yield (
        "Or, for a player with procam's shader, only a track of the show",
        f"procam export {folder} shader {SHOW} {TRACK}",
    )


def _symptoms(venue: Venue, folder: str) -> Iterator[tuple[str, str]]:
    """What is seen, and what to do."""
    screen = "dome" if isinstance(venue.screen, Dome) else "room"
    yield (
        "Seams are double or blurred",
        f"Something moved. Run the monthly check; if it names a drift, have the {screen} calibrated again.",
    )
    yield (
        "One part is darker or of another colour",
        "Wait until the lamps are warm (30 min), clean the lens, run the monthly check.",
    )
    yield (
        "All of it is grey and pale",
        "Close doors, switch lights off. Is the compensated show playing, and not the original?",
    )
    yield "One projector is dark", _dark(venue, folder)
    yield (
        "It has been wrong since a new calibration",
        "Go back to the one before, as above, and make the show ready again.",
    )


def _dark(venue: Venue, folder: str) -> str:
    """What to check on a dark projector, by its remote control if one has any."""
    controlled = [name for name, table in venue.table.projectors.items() if table.control]
    if not controlled:
        return "Check power, shutter, input and cable, and that the player runs."
    command = f"`procam projector {folder} {quote(controlled[0])} state`"
    return f"Check power, shutter and input, such as with {command}; then the cable and the player."
