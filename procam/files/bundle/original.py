"""The figures of the calibration that was solved from a session, to compare with at another place."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from procam.errors import FileFormatError
from procam.files.session_tables import parse_object
from procam.files.versions import list_calibrations

KEPT = ("schema_version", "feedback", "albedo")
SOURCES = ("input_sha256", "python", "versions")  # of the provenance
PARTS = ("value", "unit", "goal", "pass", "samples", "sigma")  # of a figure


def original_figures(venue_dir: Path, session: str) -> str | None:
    """A JSON text: feedback, albedo and figures of the calibration of a session; None if there is none.

    Of several it is the first with the newest input: later ones with the same input were refined.
    """
    found = [d for d in _documents(venue_dir) if _source(d, "session") == session]
    if not found:
        return None
    same = (d for d in found if _source(d, "input_sha256") == _source(found[-1], "input_sha256"))
    document = next(same)
    kept = {key: document[key] for key in KEPT if key in document}
    quality = document.get("quality", {})
    kept["quality"] = {n: {p: figure.get(p) for p in PARTS} for n, figure in quality.items()}
    kept["provenance"] = {key: _source(document, key) for key in SOURCES}
    return json.dumps(kept, indent=1) + "\n"


def _documents(venue_dir: Path) -> Iterator[dict[str, Any]]:
    for directory in list_calibrations(venue_dir):
        path = directory / "calibration.json"
        document = parse_object(path, path.read_bytes())
        quality = document.get("quality", {})
        figures = quality.values() if isinstance(quality, dict) else ()
        parts = document.get("provenance", {}), quality, *figures
        if not all(isinstance(part, dict) for part in parts):
            raise FileFormatError(
                f"{path} is damaged (provenance or quality is no object); restore it"
            )
        yield document


def _source(document: dict[str, Any], key: str) -> Any:
    return document.get("provenance", {}).get(key)
