"""The numbered calibrations of a venue, VENUE/calibrations/NNNN, and which of them is in use.

A calibration is never changed: another is written beside it. This module loads none of their maps, so
that commands that only list them start quickly.
"""

import json
import re
from contextlib import suppress
from pathlib import Path

from procam.errors import FileFormatError, InputError
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
            f"`procam session plan {venue_dir} PICTURES`, `procam session add` and `procam session solve`"
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
        f"procam venue use {venue_dir}@N"
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
            f"calibration: procam venue use {venue_dir}@N"
        ) from error


def use_calibration(venue_dir: Path, directory: Path) -> None:
    """Choose the calibration of a venue that counts; the newest does where none is chosen."""
    chosen, name = venue_dir / "calibrations" / IN_USE, directory.resolve().name
    if name == list_calibrations(venue_dir)[-1].name:
        chosen.unlink(missing_ok=True)
    else:
        write_text(chosen, name + "\n")


def solved_sessions(venue_dir: Path) -> set[str]:
    """Names of the sessions that calibrations of a venue were solved from, as far as they can be read."""
    names = set[str]()
    for path in list_calibrations(venue_dir):
        with suppress(FileFormatError):  # which whoever loads it refuses
            names.add(session_of(path, venue_dir))
    return names


def chosen_calibration(path: Path) -> Path:
    """A calibration directory: that of VENUE@N, the one in use of VENUE, or `path` itself.

    Raises
    ------
    InputError
        The venue has no calibration N.
    """
    if (path / "calibration.json").is_file():
        return path
    venue, number = _parted(path)
    if number is not None:
        return _numbered(venue, number)
    is_venue = (path / "venue.toml").is_file() or list_calibrations(path)
    return calibration_in_use(path) if is_venue else path


def venue_of_calibration(path: Path) -> Path:
    """The venue of a calibration directory or of VENUE@N; a venue's folder stays as it is.

    Raises
    ------
    InputError
        The calibration is in no venue.
    """
    path = _parted(path)[0]
    if not (path / "calibration.json").is_file():
        return path
    if path.resolve().parent.name != "calibrations":
        raise InputError(
            f"{path}: this calibration is in no venue; give one such as VENUE/calibrations/0001, or VENUE@1"
        )
    return path.parent.parent if path.parent.name == "calibrations" else path.resolve().parents[1]


def _parted(path: Path) -> tuple[Path, int | None]:
    """The venue and the number of VENUE@N; a folder that has an @ in its name stays whole."""
    if path.exists() or not (match := re.fullmatch(r"(.+)@([^/@]*)", str(path))):
        return path, None
    if not match[2].isdecimal():
        raise InputError(
            f"{path}: what follows @ is the number of a calibration, such as {match[1]}@3"
        )
    return Path(match[1]), int(match[2])


def _numbered(venue: Path, number: int) -> Path:
    there = {int(path.name): path for path in list_calibrations(venue)}
    if not venue.is_dir():
        raise InputError(f"{venue}: there is no such folder; is its name right?")
    if number not in there:
        names = ", ".join(map(str, there))
        which = f", only {names}; choose one of them" if there else ", and no other either"
        raise InputError(f"{venue} has no calibration {number}{which}")
    return there[number]
