"""`procam inspect`: what a file or folder holds."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from procam.errors import FileFormatError
from procam.files.calibration import load_calibration
from procam.files.images.layers import read_channels
from procam.files.provenance import provenance_entry
from procam.files.session import Session
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output

EXAMPLE = "procam inspect my-dome/calibrations/0001"


def inspect(
    file: Annotated[
        Path, typer.Argument(help="Calibration, session, plan, bundle, map or picture.")
    ],
    json: Json = False,
) -> None:
    """Describe a file or folder that procam has written, and check that it is whole."""
    output, document = Output(json), _describe(file)
    for key, value in document.items():
        output.say(f"{key:>22}  {value}")
    output.finish(document)


def _describe(path: Path) -> dict[str, Any]:
    if path.name in ("calibration.json", "plan.json"):
        path = path.parent
    if (path / "calibration.json").is_file():
        return _calibration(path)
    if (path / "plan.json").is_file():
        return _session(path)
    if path.suffix.lower() == ".zip":
        return _bundle(path)
    if path.suffix.lower() in (".exr", ".tif", ".tiff", ".png"):
        return _image(path)
    raise FileFormatError(
        f"{path}: this is no file of procam's; give a calibration or session folder, a bundle (.zip), or "
        "an EXR, TIFF or PNG file"
    )


def _calibration(path: Path) -> dict[str, Any]:
    calibration = load_calibration(path)
    rounded = {
        name: [round(float(v), 4) for v in values]
        for quantity in ("feedback", "albedo")
        for name, values in (
            (quantity, getattr(calibration, quantity).value),
            (f"{quantity}_sigma", getattr(calibration, quantity).sigma),
        )
    }
    return {
        "kind": "calibration",
        "schema_version": calibration.schema_version,
        "projectors": list(calibration.projectors),
        "cameras": list(calibration.cameras),
        **rounded,
        "states": list(calibration.states),
        **{name: figure.value for name, figure in calibration.quality.items()},
        "provenance": provenance_entry(calibration.provenance),
    }


def _session(path: Path) -> dict[str, Any]:
    session = Session(path)
    plan = session.read_plan()
    cameras = sorted(p.name for p in (path / "captures").glob("*") if p.is_dir())
    stored = {camera: len(session.stored(camera)) for camera in cameras}
    return {
        "kind": "session",
        "shots": len(plan.shots),
        "exposures": plan.exposures,
        "stored": stored,
        "complete": bool(stored) and all(n == plan.exposures for n in stored.values()),
    }


def _bundle(path: Path) -> dict[str, Any]:
    from procam.files.bundle.read import read_manifest

    manifest = read_manifest(path)
    places = [name.split("/") for name in manifest.files]
    named = {
        kind: sorted({parts[3] for parts in places if parts[2:3] == [kind] and len(parts) > 4})
        for kind in ("captures", "patterns")
    }
    return {
        "kind": "bundle",
        "procam": manifest.procam,
        "projectors": named["patterns"],
        "cameras": named["captures"],
        "photographs": manifest.frames,
        "planned": manifest.planned,
        "files": len(manifest.files),
        "megabytes": round(path.stat().st_size / 1e6, 1),
        "left_out": manifest.redacted,
    }


def _image(path: Path) -> dict[str, Any]:
    channels = read_channels(path)
    first = next(iter(channels.values()))
    document: dict[str, Any] = {"kind": "image", "size": [first.shape[1], first.shape[0]]}
    for name, values in channels.items():
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        document[name] = {"min": low, "max": high, "nan": int(values.size - finite.size)}
    return document
