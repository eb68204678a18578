"""Commands that work on calibrations and pictures; no device is touched."""

from pathlib import Path
from typing import Any

import typer

from procam.errors import FileFormatError
from procam.files.calibration import load_calibration
from procam.files.images.layers import read_channels
from procam.files.session import Session
from procam.interfaces.cli.output import Output
from procam.interfaces.cli.venues import venue_of


def run_report(where: Path, output: Output) -> None:
    """`procam report`."""
    from procam.interfaces.report import write_report

    venue = venue_of(where) if (where / "plan.json").is_file() else where
    path = write_report(venue)
    output.say(f"{path} written")
    output.finish({"report": str(path)})


def run_judge(calibration: Path, truth: Path, output: Output) -> None:
    """`procam judge`."""
    from procam.interfaces.judge import failed, judge

    figures = judge(calibration, truth)
    output.table(figures)
    output.finish({name: figure.as_dict() for name, figure in figures.items()})
    if failed(figures):
        raise typer.Exit(1)


def run_inspect(path: Path, output: Output) -> None:
    """`procam inspect`."""
    document = _describe(path)
    for key, value in document.items():
        output.say(f"{key:>22}  {value}")
    output.finish(document)


def _describe(path: Path) -> dict[str, Any]:
    if path.name == "calibration.json":
        path = path.parent
    if path.name == "plan.json":
        path = path.parent
    if (path / "calibration.json").is_file():
        return _calibration(path)
    if (path / "plan.json").is_file():
        return _session(path)
    if path.suffix.lower() in (".exr", ".tif", ".tiff", ".png"):
        return _image(path)
    raise FileFormatError(
        f"{path}: got nothing that procam knows, expected a calibration or session folder, or an "
        "EXR, TIFF or PNG file"
    )


def _calibration(path: Path) -> dict[str, Any]:
    calibration = load_calibration(path)
    return {
        "kind": "calibration",
        "schema_version": calibration.schema_version,
        "projectors": list(calibration.projectors),
        "cameras": list(calibration.cameras),
        "feedback": [round(float(v), 4) for v in calibration.feedback.value],
        "feedback_sigma": [round(float(v), 4) for v in calibration.feedback.sigma],
        "albedo": [round(float(v), 4) for v in calibration.albedo.value],
        "albedo_sigma": [round(float(v), 4) for v in calibration.albedo.sigma],
        "states": list(calibration.states),
        **{name: figure.value for name, figure in calibration.quality.items()},
        "provenance": dict(calibration.provenance),
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


def _image(path: Path) -> dict[str, Any]:
    channels = read_channels(path)
    first = next(iter(channels.values()))
    document: dict[str, Any] = {"kind": "image", "size": [first.shape[1], first.shape[0]]}
    import numpy as np

    for name, values in channels.items():
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        document[name] = {"min": low, "max": high, "nan": int(values.size - finite.size)}
    return document
