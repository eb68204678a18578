"""The numbered calibrations of a venue, VENUE/calibrations/NNNN, and which of them is in use.

A calibration is never changed: another is written beside it. This module loads none of their maps, so
that commands that only list them start quickly.
"""

import json
from contextlib import suppress
from pathlib import Path

from procam.errors import FileFormatError
from procam.files.atomic import write_text

IN_USE = "in-use"  # names the calibration that counts, if that is not the newest


def next_directory(venue_dir: Path) -> Path:
    """The VENUE/calibrations/NNNN after the newest."""
    found = list_calibrations(venue_dir)
    number = int(found[-1].name) + 1 if found else 1
    return venue_dir / "calibrations" / f"{number:04d}"


def list_calibrations(venue_dir: Path) -> list[Path]:
    """Finished calibrations of a venue, oldest first."""
    found = venue_dir.glob("calibrations/[0-9][0-9][0-9][0-9]/calibration.json")
    return sorted(path.parent for path in found)


def calibration_in_use(venue_dir: Path) -> Path:
    """The calibration of a venue that counts: the newest, unless an older one was chosen.

    Raises
    ------
    FileFormatError
        Without calibration, or if the chosen one is not there: another one would be used without a word.
    """
    found = list_calibrations(venue_dir)
    if not found:
        raise FileFormatError(
            f"{venue_dir} has no calibration; run `procam calibrate {venue_dir}` first, or by hand "
            f"`procam patterns {venue_dir}`, `procam ingest` and `procam solve`"
        )
    chosen = venue_dir / "calibrations" / IN_USE
    if not chosen.is_file():
        return found[-1]
    name = chosen.read_bytes().decode(errors="replace").strip()
    for path in found:
        if path.name == name:
            return path
    there = ", ".join(path.name for path in found)
    raise FileFormatError(
        f"{chosen} names calibration {name!r}, which is not there, only {there}; choose one of them: "
        f"procam history {venue_dir} --restore N"
    )


def name_in_use(venue_dir: Path) -> str | None:
    """Name of the calibration that counts; None without one, or if the chosen one is not there."""
    try:
        return calibration_in_use(venue_dir).name
    except FileFormatError:
        return None


def calibrated_session(venue_dir: Path) -> str:
    """The session that the calibration in use was solved from; "" where there is no calibration."""
    if not list_calibrations(venue_dir):
        return ""
    return session_of(calibration_in_use(venue_dir), venue_dir)


def session_of(directory: Path, venue_dir: Path) -> str:
    """The session that a calibration of a venue was solved from.

    Raises
    ------
    FileFormatError
        Its calibration.json is damaged.
    """
    path = directory / "calibration.json"
    try:
        return str(json.loads(path.read_bytes())["provenance"].get("session", ""))
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"{path} is damaged ({type(error).__name__}: {error}); restore it, or go back to another "
            f"calibration: procam history {venue_dir} --restore N"
        ) from error


def use_calibration(venue_dir: Path, directory: Path) -> None:
    """Choose the calibration of a venue that counts; the newest does where none is chosen."""
    chosen = venue_dir / "calibrations" / IN_USE
    if directory.name == list_calibrations(venue_dir)[-1].name:
        chosen.unlink(missing_ok=True)
    else:
        write_text(chosen, directory.name + "\n")


def solved_sessions(venue_dir: Path) -> set[str]:
    """Names of the sessions that calibrations of a venue were solved from, as far as they can be read."""
    names = set[str]()
    for path in list_calibrations(venue_dir):
        with suppress(FileFormatError):  # which whoever loads it refuses
            names.add(session_of(path, venue_dir))
    return names


def chosen_calibration(path: Path) -> Path:
    """A calibration directory, or the one in use where `path` is a venue."""
    if (path / "calibration.json").is_file():
        return path
    is_venue = (path / "venue.toml").is_file() or list_calibrations(path)
    return calibration_in_use(path) if is_venue else path


def venue_of_calibration(path: Path) -> Path:
    """The venue of a calibration directory; a venue's folder stays as it is."""
    if not (path / "calibration.json").is_file():
        return path
    return path.parent.parent if path.parent.name == "calibrations" else path.resolve().parents[1]
