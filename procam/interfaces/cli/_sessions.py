"""Functions that the commands share which refine a venue."""

from pathlib import Path
from shlex import quote

from procam.errors import InputError
from procam.files.calibration import load_calibration, save_calibration
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use, next_directory, use_calibration
from procam.interfaces.cli._output import Output
from procam.interfaces.report import write_report
from procam.memory import return_buffers
from procam.model.screen import Dome
from procam.workflows.refine.refine import Refined
from procam.workflows.refine.stored_pictures import keep_pictures
from procam.workflows.sample_content import half_sky
from procam.workflows.solve.plausible import check_calibration


def load_dome_venue(directory: Path, command: str) -> Venue:
    """The venue of a command that is for domes only.

    Raises
    ------
    InputError
        Its screen is a room.
    """
    venue = load_venue(directory)
    if not isinstance(venue.screen, Dome):
        raise InputError(
            f"procam {command} is for domes, and the screen of {directory} is a {venue.screen.kind}"
        )
    return venue


def keep_report(venue: Path) -> Path:
    """Write the pictures of the calibration in use, and the report that shows them; returns its path."""
    return_buffers()  # of the solve, which took more
    _keep_pictures(venue)
    return_buffers()  # the report reads the calibration again, when this one is gone
    return write_report(venue)


def _keep_pictures(venue: Path) -> None:
    calibration = load_calibration(calibration_in_use(venue))
    keep_pictures(venue, calibration, half_sky(calibration.maps.size, calibration.screen))


def keep_refined(directory: Path, kept: Path, refined: Refined, output: Output) -> Path:
    """Write the loop's calibration if it is better than the one at `kept`; returns the newest one."""
    if refined.worse:
        output.say(f"nothing written, {kept} stays newest: {refined.worse}")
        return kept
    if not refined.better:
        found = "no picture got better" if refined.corrections else "nothing to correct"
        output.say(f"{found}, {kept} stays newest")
        return kept
    output.warn(check_calibration(refined.calibration))
    out = next_directory(directory)
    save_calibration(refined.calibration, out)
    use_calibration(directory, out)
    output.say(f"{out} written; see it: procam report {quote(str(directory))}")
    return out
