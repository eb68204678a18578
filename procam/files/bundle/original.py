"""The figures of the calibration that was solved from a session, to compare with at another place."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from procam.errors import FileFormatError
from procam.files.session_tables import parse_object
from procam.files.versions import list_calibrations

# whose versions a calibration records
PACKAGES = ("procam", "numpy", "scipy", "opencv-contrib-python-headless", "OpenImageIO")
VERSION = re.compile(r"\d[\w.+!-]*")
SHA256 = re.compile(r"[0-9a-f]{64}")
NAME = re.compile(r"[a-z][a-z0-9_]*")  # of a figure
PARTS = ("value", "goal", "pass", "samples", "sigma")  # of a figure; its name gives the unit
OPERATORS = ("<=", ">=", "==", "abs<=")


def original_figures(venue_dir: Path, session: str) -> str | None:
    """A JSON text: feedback, albedo and figures of the calibration of a session; None if there is none.

    Of several it is the first with the newest input: later ones with the same input were refined. Of all
    text in it only versions, the hash of the input and names of figures get in.
    """
    found = [d for d in _documents(venue_dir) if d["provenance"].get("session") == session]
    if not found:
        return None
    newest = _input(found[-1])
    same = (document for document in found if _input(document) == newest)
    return json.dumps(_shared(next(same)), indent=1) + "\n"


def _input(document: dict[str, Any]) -> str | None:
    """The hash of what a calibration was solved from, if it is one."""
    return _text(SHA256, document["provenance"].get("input_sha256"))


def _shared(document: dict[str, Any]) -> dict[str, Any]:
    quality = document["quality"]
    kept = {
        "schema_version": _numbers(document.get("schema_version")),
        "feedback": _parts(document.get("feedback"), ("value", "sigma")),
        "albedo": _parts(document.get("albedo"), ("value", "sigma")),
        "quality": {n: _parts(figure, PARTS) for n, figure in quality.items() if NAME.fullmatch(n)},
    }
    found = document["provenance"].get("versions")
    versions = found if isinstance(found, dict) else {}
    source = {
        "input_sha256": _input(document),
        "python": _text(VERSION, document["provenance"].get("python")),
        "versions": {name: _text(VERSION, versions.get(name)) for name in PACKAGES},
    }
    return {**kept, "provenance": source}


def _parts(entry: Any, keys: tuple[str, ...]) -> dict[str, Any]:
    """The numbers of an entry, and its goal."""
    found = entry if isinstance(entry, dict) else {}
    return {
        key: _goal(found.get(key)) if key == "goal" else _numbers(found.get(key)) for key in keys
    }


def _goal(entry: Any) -> dict[str, Any] | None:
    if not isinstance(entry, dict) or entry.get("op") not in OPERATORS:
        return None
    return {"op": entry["op"], "value": _numbers(entry.get("value"))}


def _numbers(value: Any) -> Any:
    """A number, a truth value, or a list of these; None for anything else."""
    if isinstance(value, list):
        return [_numbers(each) for each in value]
    return value if isinstance(value, int | float) else None


def _text(pattern: re.Pattern[str], value: Any) -> str | None:
    return value if isinstance(value, str) and pattern.fullmatch(value) else None


def _documents(venue_dir: Path) -> Iterator[dict[str, Any]]:
    for directory in list_calibrations(venue_dir):
        path = directory / "calibration.json"
        document = parse_object(path, path.read_bytes())
        quality, provenance = (document.setdefault(n, {}) for n in ("quality", "provenance"))
        figures = quality.values() if isinstance(quality, dict) else ()
        parts = provenance, quality, *figures
        if not all(isinstance(part, dict) for part in parts):
            raise FileFormatError(
                f"{path} is damaged (provenance or quality is no object); restore it"
            )
        yield document
