"""ISO and aperture, which must stay as they are while a session is photographed, and after it."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from procam.errors import FileFormatError
from procam.files import atomic
from procam.files.session import Session

NAMES = "ISO", "aperture f/"
Setting = tuple[float | None, float | None]  # ISO and aperture; None where the header has none


def common_settings(
    photos: Iterable[tuple[Path, Setting]], known: Mapping[str, float]
) -> dict[str, float]:
    """What photographs have in common with each other and with what is known, by name.

    Raises
    ------
    FileFormatError
        One has another ISO or aperture.
    """
    found = dict(known)
    for path, setting in photos:
        for name, value in zip(NAMES, setting, strict=True):
            if value is not None and found.setdefault(name, value) != value:
                raise FileFormatError(
                    f"{path}: {name}{value:g}, but others have {found[name]:g}; only the shutter time "
                    "may change between photographs, also after a calibration; take them again"
                )
    return found


def read_settings(session: Session, camera: str) -> dict[str, float]:
    """Those of a session's photographs, as far as they are known."""
    path = _path(session, camera)
    try:
        known = json.loads(path.read_bytes()) if path.is_file() else {}
        return {name: float(known[name]) for name in NAMES if name in known}
    except (ValueError, TypeError, RecursionError) as error:
        raise FileFormatError(
            f"{path}: damaged; remove it, and it is made again when photographs are added"
        ) from error


def keep_settings(session: Session, camera: str, settings: Mapping[str, float]) -> None:
    """Store them with the session's photographs."""
    if settings:
        atomic.write_text(_path(session, camera), json.dumps(dict(settings)))


def _path(session: Session, camera: str) -> Path:
    return session.directory / "captures" / camera / "settings.json"
