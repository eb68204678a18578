"""`procam forecast`: contrast and white to expect of a screen, before anything is bought.

A dome is described by options, or measured by a calibration; a box or a cylinder by options. Figures are
printed as value (low .. high), over what is uncertain: the 95 % interval of albedo or feedback, and venue
states.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from json import dumps
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import load_calibration
from procam.files.versions import chosen_calibration, venue_of_calibration
from procam.interfaces.cli._forecast_options import (
    Albedo,
    AlbedoSigma,
    Box,
    Contrast,
    Coverage,
    Cylinder,
    FloorAlbedo,
    HalfAngle,
    Lit,
    Lumens,
    OtherAlbedo,
    Out,
    Paths,
    Radius,
    Reflecting,
)
from procam.interfaces.cli._forecast_room import room_found
from procam.interfaces.cli._forecast_text import (
    COLUMNS,
    USUAL,
    Described,
    Found,
    assumed_lines,
    assumptions_of,
    check_lumens,
    light_lines,
    metered_nits,
    picture_lines,
    plain,
)
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.plots.forecast import RELATIVE, write_plot
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.workflows.forecast import (
    Levels,
    PlannedDome,
    Prospect,
    light_levels,
    measured,
    picture_figures,
    planned,
    sampled,
    white_luminance,
)
from procam.workflows.judged_picture import LUMINANCE, PictureFigures, Seen
from procam.workflows.refine.stored_pictures import read_square

EXAMPLE = "procam forecast --albedo 0.5 --coverage 0.9 --lumens 60000 --radius-m 8 sky.png"
UNCHANGED = (
    "Compensation does not change the contrast of black beside white: it dims both by one factor. "
    "It restores white, mid-tones, colours and gradients."
)


def forecast(
    paths: Paths = None,
    *,
    albedo: Albedo = None,
    albedo_sigma: AlbedoSigma = None,
    coverage: Coverage = None,
    reflecting: Reflecting = None,
    half_angle_deg: HalfAngle = None,
    floor_albedo: FloorAlbedo = None,
    contrast: Contrast = None,
    radius_m: Radius = None,
    lumens: Lumens = None,
    box: Box = None,
    cylinder: Cylinder = None,
    lit: Lit = None,
    other_albedo: OtherAlbedo = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Predict white and contrast of a dome or a room before anything is bought.

    Of a planned dome (--albedo and --coverage at least), a planned room (--box or --cylinder, and
    --albedo), or of a venue that is calibrated; and what compensation can do for your own pictures there.
    """
    described = {
        "albedo": albedo,
        "albedo_sigma": albedo_sigma,
        "coverage": coverage,
        "reflecting": reflecting,
        "half_angle_deg": half_angle_deg,
        "floor_albedo": floor_albedo,
        "contrast": contrast,
        "radius_m": radius_m,
    }
    given = {name: value for name, value in described.items() if value is not None}
    shapes = {kind: size for kind, size in (("box", box), ("cylinder", cylinder)) if size}
    if shapes or lit or other_albedo is not None:
        if paths and _is_calibrated(paths[0]):
            raise InputError(
                f"forecast: {paths[0]} is a venue, and --box, --cylinder, --lit and --other-albedo "
                "describe a room that is planned; give one or the other"
            )
        found = room_found(paths or [], shapes, given, lit or (), other_albedo, lumens)
    else:
        found = _of_dome(paths or [], given, lumens)
    _report(found, out, Output(json))


def _of_dome(paths: Sequence[Path], described: Described, lumens: float | None) -> Found:
    venue = paths[0] if paths and _is_calibrated(paths[0]) else None
    prospect = _prospect(venue, described)
    _check_light(lumens, described, venue)
    read = {str(p): read_square(p) for p in paths[1 if venue else 0 :]}
    contents = {path: sampled(content) for path, (content, _) in read.items()}
    levels = _levels(prospect, lumens)
    unit = RELATIVE if lumens is None and not metered_nits(prospect) else "cd/m2"
    pictures = {path: _picture(prospect, content) for path, content in contents.items()}
    assumptions = list(assumptions_of(prospect, venue, described, lumens))
    assumptions += [note for _, note in read.values() if note]
    states = _States.of(prospect, lumens, contents)
    found = Found(levels, unit, pictures, assumptions, wrap(UNCHANGED, COLUMNS))
    if not states:
        return found
    document = {"states": states.document()}
    return replace(found, after=list(states.lines(unit)), document=document)


def _report(found: Found, out: Path | None, output: Output) -> None:
    """Print a forecast, and write its plot and document into a folder."""
    levels, unit, pictures = found.levels, found.unit, found.pictures
    document = {
        "unit": unit,
        "light": plain(levels),
        "pictures": {path: plain(figures) for path, (figures, _) in pictures.items()},
        "assumptions": found.assumptions,
        **found.document,
    }
    if out is not None:
        seen = [(Path(path).name, seen) for path, (_, seen) in pictures.items()]
        write_plot(out / "forecast.png", levels, unit, seen, found.layout)
        atomic.write_text(out / "forecast.json", dumps(document, indent=1))
    for line in light_lines("expected, in brackets both ends", levels, unit):
        output.say(line)
    for line in found.more:
        output.say(line)
    for path, (figures, _) in pictures.items():
        for line in picture_lines(path, figures):
            output.say(line)
    for line in found.after:
        output.say(line)
    for line in assumed_lines(found.assumptions):
        output.say(line)
    if out is not None:
        output.say(f"{out / 'forecast.png'} and {out / 'forecast.json'} written")
    output.finish(document)


def _is_calibrated(path: Path) -> bool:
    """Whether it is a venue, or VENUE@N, and no picture."""
    return path.is_dir() or venue_of_calibration(path) != path


def _prospect(venue: Path | None, described: Described) -> Prospect:
    """The dome of a venue's newest calibration, or the one that is described."""
    if venue is not None:
        if described:
            named = [f"--{name.replace('_', '-')}" for name in described]
            raise InputError(
                f"forecast: {', '.join(named)} cannot be combined with {venue}, whose calibration has "
                "measured them; give one or the other"
            )
        return measured(load_calibration(chosen_calibration(venue)))
    if not {"albedo", "coverage"} <= described.keys():
        raise InputError(
            "forecast needs --albedo and --coverage, or a VENUE with a calibration as the first argument"
        )
    values = USUAL | described
    screen = Dome(
        values.get("radius_m", 1.0),
        math.radians(values["half_angle_deg"]),
        floor_albedo=values["floor_albedo"],
    )
    names = ("albedo", "albedo_sigma", "coverage", "reflecting", "contrast")
    return planned(PlannedDome(screen, **{name: values[name] for name in names}))


def _check_light(lumens: float | None, described: Described, venue: Path | None) -> None:
    """A luminance needs lumens and a radius."""
    check_lumens(lumens)
    if lumens is not None and venue is None and "radius_m" not in described:
        raise InputError("--lumens needs --radius-m, the dome's radius [m]")


@dataclass(frozen=True)
class _States:
    """A venue as it was calibrated, then in each of its states.

    `levels` and `figures`, those of each picture by path, are in that order.
    """

    names: list[str]
    levels: list[Levels]
    figures: Mapping[str, list[PictureFigures]]

    @classmethod
    def of(
        cls, prospect: Prospect, lumens: float | None, contents: Mapping[str, np.ndarray]
    ) -> "_States | None":
        """None where no state was measured."""
        venue = prospect.ends[1]
        names = list(venue.states)
        if not names:
            return None
        states, white = [None, *names], _white(prospect, venue, lumens)
        return cls(
            names,
            [light_levels(venue, white, state) for state in states],
            {
                path: [picture_figures(venue, content, state)[0] for state in states]
                for path, content in contents.items()
            },
        )

    def document(self) -> dict[str, Any]:
        """Bands over the states as JSON."""
        pictures = {path: plain(figures, value=0) for path, figures in self.figures.items()}
        return {"names": self.names, "light": plain(self.levels, value=0), "pictures": pictures}

    def lines(self, unit: str) -> Iterator[str]:
        """Bands over the states for people."""
        yield f"\nas calibrated, in brackets with venue states: {', '.join(self.names)}"
        yield from light_lines("expected", self.levels, unit, value=0)
        for path, figures in self.figures.items():
            yield from picture_lines(path, figures, value=0)


def _levels(prospect: Prospect, lumens: float | None) -> list[Levels]:
    """White and black at the ends and in the middle."""
    return [light_levels(c, _white(prospect, c, lumens)) for c in prospect.ends]


def _white(prospect: Prospect, dome: Calibration, lumens: float | None) -> float:
    """Light of a direct white of 1.0: in cd/m2 if lumens are given, or a hand meter has read it."""
    if lumens is None:
        return metered_nits(prospect) or 1.0
    paint = float(LUMINANCE @ dome.albedo.value)
    return white_luminance(lumens, dome.dome.radius_m, prospect.lit_sr, paint)


def _picture(prospect: Prospect, content: np.ndarray) -> tuple[list[PictureFigures], Seen]:
    """A picture's figures at the ends and in the middle, and how it is seen in the middle."""
    figures, seen = zip(*(picture_figures(c, content) for c in prospect.ends), strict=True)
    return list(figures), seen[1]
