"""`procam meter`: absolute luminance and colour of a calibration, from readings of a hand meter."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from procam.estimate.light.absolute import (
    LARGEST_ADDITIVITY,
    LARGEST_RESIDUAL,
    AbsoluteLight,
    fit_absolute,
)
from procam.estimate.light.colour_spaces import (
    colour_temperature,
    content_from_rgb,
    unshown_saturation,
    xyy_from_xyz,
)
from procam.files.calibration import load_calibration, save_calibration
from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.meter import read_meter
from procam.files.versions import (
    chosen_calibration,
    next_directory,
    use_calibration,
    venue_of_calibration,
)
from procam.interfaces.cli._options import FromArgument, Json
from procam.interfaces.cli._output import Output, as_dicts, exit_if_missed
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.model.quality import Figure, Goal

EXAMPLE = "procam meter my-dome readings.csv"
SPACES = ("Rec.709", "P3-D65", "Rec.2020")
LEAST_LOST = 0.005  # of a primary's saturation; less is not printed


def meter(
    start: FromArgument,
    readings: Annotated[
        Path,
        typer.Argument(
            metavar="READINGS",
            help="CSV: projector,patch,azimuth_deg,elevation_deg,Y,x,y (or X,Y,Z) in cd/m2.",
        ),
    ],
    *,
    json: Json = False,
) -> None:
    """Make a calibration absolute with a hand meter; exit 1 if the two disagree.

    Show red, green, blue, white and black on the whole panel of one projector, unwarped and
    unblended, the others shuttered, in the dark. Read each from the middle of the dome at one place
    well inside the picture. A second place, or a second projector of the type, checks the first.
    The result is a new calibration, whose white perceptual methods, previews and forecasts take.
    """
    output, venue, kept = Output(json), venue_of_calibration(start), chosen_calibration(start)
    with recorded(venue, "meter"):
        verify_unchanged(venue, kept)
        known = load_calibration(kept)
        found = fit_absolute(read_meter(readings, tuple(known.projectors)), known)
        figures = _figures(found)
        agree = all(figure.passed is not False for figure in figures.values())
        out = _kept(venue, known, found, readings) if agree else None
    for line in _lines(found):
        output.say(line)
    output.table(figures)
    for note in found.notes:
        output.say(f"note: {note}")
    output.say(f"{out} written" if out else f"nothing written: meter and {kept} disagree")
    output.finish({"calibration": out and str(out), **_document(found, figures)})
    exit_if_missed(figures)


def _kept(venue: Path, known: Calibration, found: AbsoluteLight, readings: Path) -> Path:
    """Write the calibration with what the meter has read, the newest of its venue, and use it."""
    provenance = replace(known.provenance, meter=_provenance(found, readings))
    out = next_directory(venue)
    save_calibration(replace(known, absolute=found.colour, provenance=provenance), out)
    use_calibration(venue, out)
    return out


def _figures(found: AbsoluteLight) -> dict[str, Figure]:
    residual = float(found.residual_de2000.mean())
    figures = {
        "residual_de2000": Figure(
            residual,
            "-",
            Goal("<=", LARGEST_RESIDUAL),
            len(found.readings),
            "mean over the readings",
        )
    }
    if found.additivity is not None:
        figures["additivity_error"] = Figure(
            found.additivity.error,
            "-",
            Goal("abs<=", LARGEST_ADDITIVITY),
            note=f"{found.additivity.projector}; sigma {found.additivity.sigma:.3f} by the meter",
        )
    return figures


def _lines(found: AbsoluteLight) -> Iterator[str]:
    nits, sigma = found.colour.nits_per_unit
    kelvin, duv = colour_temperature(found.colour.white)
    temperature = "no colour temperature" if np.isnan(kelvin) else f"{kelvin:.0f} K"
    x, y, _ = xyy_from_xyz(found.colour.white)
    yield (
        f"reference white: {nits:.4g} +- {sigma:.2g} cd/m2, x {x:.4f} y {y:.4f}, {temperature} "
        f"(Duv {duv:+.4f})"
    )
    for name, (x, y, luminance) in _primaries(found).items():
        yield f"  {name:5} x {x:.4f} y {y:.4f}, {luminance:.4g} cd/m2"
    if found.contrast is not None:
        yield f"contrast: {found.contrast:.0f}:1, full white over black at one place"
    reading, residual = found.worst
    yield f"largest residual: {reading}, dE2000 {residual:.2f}"
    for space, unshown in _unshown(found).items():
        lost = [f"{n} {v:.0%}" for n, v in unshown.items() if v > LEAST_LOST]
        yield (
            f"{space}: saturation that cannot be shown: {', '.join(lost)}"
            if lost
            else f"{space}: all shown"
        )


def _primaries(found: AbsoluteLight) -> dict[str, list[float]]:
    """X, y and Y of each content channel at 1."""
    each = xyy_from_xyz(found.colour.xyz_from_content.T)
    return {name: row.tolist() for name, row in zip(PRIMARIES, each, strict=True)}


def _unshown(found: AbsoluteLight) -> dict[str, dict[str, float]]:
    """By colour space and primary, with the dome's white as the space's."""
    matrix = found.colour.xyz_from_content
    shares = {s: unshown_saturation(content_from_rgb(s, matrix), matrix) for s in SPACES}
    return {
        space: dict(zip(PRIMARIES, share.tolist(), strict=True)) for space, share in shares.items()
    }


def _document(found: AbsoluteLight, figures: Mapping[str, Figure]) -> dict[str, Any]:
    colour = found.colour
    nits, sigma = colour.nits_per_unit
    kelvin, duv = colour_temperature(colour.white)
    matrix = {"value": colour.xyz_from_content.tolist(), "sigma": colour.sigma.tolist()}
    return {
        "xyz_from_content": matrix,
        "nits_per_unit": {"value": nits, "sigma": sigma},
        "white_xy": xyy_from_xyz(colour.white)[:2].tolist(),
        "white_temperature_k": None if np.isnan(kelvin) else kelvin,
        "white_duv": duv,
        "primaries_xy": {name: row[:2] for name, row in _primaries(found).items()},
        "contrast": found.contrast,
        "unshown_saturation": _unshown(found),
        "figures": as_dicts(figures),
        "notes": list(found.notes),
    }


def _provenance(found: AbsoluteLight, readings: Path) -> dict[str, Any]:
    return {
        "readings": readings.name,
        "readings_sha256": hashlib.sha256(readings.read_bytes()).hexdigest(),
        "versions": {name: version(name) for name in ("procam", "colour-science")},
        "notes": list(found.notes),
    }
