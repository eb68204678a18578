"""`procam forecast`: contrast and white to expect of a dome, before anything is bought."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import latest_calibration, load_calibration
from procam.interfaces.cli.output import Output
from procam.interfaces.plots.forecast import RELATIVE, write_plot
from procam.model.calibration import Calibration
from procam.model.screen import Dome
from procam.workflows.forecast import (
    LUMINANCE,
    Band,
    Levels,
    PictureFigures,
    PlannedDome,
    Prospect,
    Seen,
    band,
    light_levels,
    measured,
    picture_figures,
    planned,
    sampled,
    white_luminance,
)
from procam.workflows.refine.shown import read_square

Described = Mapping[str, float | None]
USUAL = {
    "albedo_sigma": 0.03,
    "reflecting": 1.0,
    "half_angle_deg": 90.0,
    "floor_albedo": 0.1,
    "contrast": 2000.0,
}
COLUMNS, LABEL, FIGURE = 100, 37, 31
UNCHANGED = (
    "Compensation does not change the contrast of black beside white: it dims both by one factor. "
    "It restores white, mid-tones, colours and gradients."
)


def run_forecast(
    paths: Sequence[Path],
    described: Described,
    lumens: float | None,
    out: Path | None,
    output: Output,
) -> None:
    """`procam forecast`: `described` is a planned dome, None where nothing was said of it."""
    venue = paths[0] if paths and paths[0].is_dir() else None
    prospect = _prospect(venue, described)
    _check_light(lumens, described, venue)
    contents = {str(p): sampled(read_square(p)) for p in paths[1 if venue else 0 :]}
    levels = _levels(prospect, lumens)
    unit = RELATIVE if lumens is None else "cd/m2"
    pictures = {path: _picture(prospect, content) for path, content in contents.items()}
    house = _Hall.of(prospect, lumens, contents)
    assumptions = list(_assumptions(prospect, venue, described, lumens))
    document = {
        "unit": unit,
        "light": _plain(levels),
        "pictures": {path: _plain(figures) for path, (figures, _) in pictures.items()},
        "assumptions": assumptions,
        **({"states": house.document()} if house else {}),
    }
    if out is not None:
        seen = [(Path(path).name, seen) for path, (_, seen) in pictures.items()]
        write_plot(out / "forecast.png", levels, unit, seen)
        atomic.write_text(out / "forecast.json", json.dumps(document, indent=1))
    for line in _light_lines("expected, in brackets both ends", _bands(levels), unit):
        output.say(line)
    for line in wrap(UNCHANGED, COLUMNS):
        output.say(line)
    for path, (figures, _) in pictures.items():
        for line in _picture_lines(path, _bands(figures)):
            output.say(line)
    for line in house.lines(unit) if house else ():
        output.say(line)
    for line in _assumed_lines(assumptions):
        output.say(line)
    if out is not None:
        output.say(f"{out / 'forecast.png'} and {out / 'forecast.json'} written")
    output.finish(document)


def _prospect(venue: Path | None, described: Described) -> Prospect:
    """The dome of a venue's newest calibration, or the one that is described."""
    named = [_option(name) for name, value in described.items() if value is not None]
    if venue is not None:
        if named:
            raise InputError(
                f"forecast: got {', '.join(named)} beside {venue}, expected one or the other: a "
                "venue's calibration has measured them"
            )
        return measured(load_calibration(latest_calibration(venue)))
    missing = [_option(name) for name in ("albedo", "coverage") if described[name] is None]
    if missing:
        raise InputError(
            f"forecast: got no {' and no '.join(missing)}, expected both, or a VENUE with a "
            "calibration as the first argument"
        )
    told = USUAL | {name: value for name, value in described.items() if value is not None}
    screen = Dome(
        told.get("radius_m", 1.0),
        math.radians(told["half_angle_deg"]),
        floor_albedo=told["floor_albedo"],
    )
    names = ("albedo", "albedo_sigma", "coverage", "reflecting", "contrast")
    return planned(PlannedDome(screen, **{name: told[name] for name in names}))


def _check_light(lumens: float | None, described: Described, venue: Path | None) -> None:
    """A luminance wants lumens and a radius."""
    if lumens is None:
        return
    if not 0 < lumens < math.inf:
        raise InputError(f"--lumens: got {lumens:g} in all, expected more than 0, such as 10000")
    if venue is None and described["radius_m"] is None:
        raise InputError("--lumens: got no --radius-m beside it, expected the dome's radius [m]")


@dataclass(frozen=True)
class _Hall:
    """A venue in the states of its house: as it was calibrated first, then by name.

    `levels` and `figures`, those of each picture by path, are in that order.
    """

    names: list[str]
    levels: list[Levels]
    figures: Mapping[str, list[PictureFigures]]

    @classmethod
    def of(
        cls, prospect: Prospect, lumens: float | None, contents: Mapping[str, np.ndarray]
    ) -> "_Hall | None":
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
        pictures = {path: _plain(figures, 0) for path, figures in self.figures.items()}
        return {"names": self.names, "light": _plain(self.levels, 0), "pictures": pictures}

    def lines(self, unit: str) -> Iterator[str]:
        """Bands over the states for people."""
        yield f"\nas calibrated, in brackets with house states: {', '.join(self.names)}"
        yield from _light_lines("expected", _bands(self.levels, 0), unit)
        for path, figures in self.figures.items():
            yield from _picture_lines(path, _bands(figures, 0))


def _levels(prospect: Prospect, lumens: float | None) -> list[Levels]:
    """White and black at the three ends."""
    return [light_levels(c, _white(prospect, c, lumens)) for c in prospect.ends]


def _white(prospect: Prospect, dome: Calibration, lumens: float | None) -> float:
    """Light of a direct white of 1.0: in cd/m2 if lumens are told."""
    if lumens is None:
        return 1.0
    paint = float(LUMINANCE @ dome.albedo.value)
    return white_luminance(lumens, dome.screen.radius_m, prospect.lit_sr, paint)


def _picture(prospect: Prospect, content: np.ndarray) -> tuple[list[PictureFigures], Seen]:
    """A picture's figures at the three ends, and what is seen in the middle."""
    figures, seen = zip(*(picture_figures(c, content) for c in prospect.ends), strict=True)
    return list(figures), seen[1]


def _assumptions(
    prospect: Prospect, venue: Path | None, described: Described, lumens: float | None
) -> Iterator[str]:
    """What the figures rest on."""
    yield (
        "matte screen; 1.0 of a picture (255 of 8 bits) is the white that every lit place reaches "
        "without bounces; luminance of R, G and B weighted as in ITU-R BT.709"
    )
    if venue is not None:
        yield f"everything measured by {latest_calibration(venue)}; bands: 95 % of its feedback"
    else:
        told = {n: USUAL[n] if described[n] is None else described[n] for n in USUAL}
        yield (
            f"albedo {described['albedo']:g} with sigma {told['albedo_sigma']:g}; bands: both ends "
            "of its 95 % interval"
        )
        yield (
            f"cap of {told['half_angle_deg']:g} degrees, level, {described['coverage']:.4g} of it "
            f"lit down from the pole, {told['reflecting']:.4g} of it painted; floor of albedo "
            f"{told['floor_albedo']:g} as wide as the rim"
        )
        yield (
            f"projectors of {told['contrast']:g}:1 full white to full black; where pictures "
            "overlap, black is brighter than told here"
        )
    if lumens is not None:
        radius = prospect.ends[1].screen.radius_m
        yield (
            f"{lumens:g} lm, all on the {prospect.lit_sr * radius**2:.4g} m2 that are lit, radius "
            f"{radius:g} m; blending, masks and what misses the dome take their share off"
        )


def _light_lines(title: str, bands: Mapping[str, Band], unit: str) -> Iterator[str]:
    yield _row(title, "without compensation", "with compensation")
    yield _row(
        f"full white [{unit}]", _number(bands["white_before"]), _number(bands["white_after"])
    )
    yield _row("  of it scattered light", _percent(bands["scattered_share"]), "")
    black = _number(bands["black"])
    yield _row(f"full black [{unit}]", black, black)
    rows = {"full white : full black": "on_off", "black beside white, half each": "checkerboard"}
    for label, name in rows.items():
        yield _row(label, *(_number(bands[f"{name}_{when}"], ":1") for when in ("before", "after")))
    scatter = _number(bands["checkerboard_scatter"], ":1")
    yield _row("  if projectors' black were none", scatter, scatter)


def _picture_lines(path: str, bands: Mapping[str, Band]) -> Iterator[str]:
    yield f"\n{path}"
    for label, name in {
        "too bright (clips at black)": "black",
        "too dark (at white)": "white",
    }.items():
        yield _row(f"  {label}", "", _percent(bands[f"clipped_{name}"]))
    yield _row(
        "  darkest quarter too bright by",
        *(_percent(bands[f"dark_lift_{when}"], " of white") for when in ("before", "after")),
    )
    yield _row(
        f"  rms contrast (asked {bands['contrast_target'].value:.3g})",
        *(_number(bands[f"contrast_{when}"]) for when in ("before", "after")),
    )
    yield _row("  of the lost contrast restored", "", _percent(bands["contrast_restored"]))
    yield _row("  can be shown without clipping", "", _verdict(bands["unclipped"]))
    yield _row("  darkest level beside the rest", "", _percent(bands["darkest"], " of white"))


def _assumed_lines(assumptions: Sequence[str]) -> Iterator[str]:
    yield "\nassumed:"
    for text in assumptions:
        yield from wrap(text, COLUMNS, initial_indent="  ", subsequent_indent="    ")


def _row(label: str, before: str, after: str) -> str:
    return f"{label:{LABEL}}{before:>{FIGURE}} {after:>{FIGURE}}".rstrip()


def _bands(ends: Sequence[Levels] | Sequence[PictureFigures], counts: int = 1) -> dict[str, Band]:
    """Each figure with its band, by name; `counts` tells which end is the figure."""
    return {f.name: band([getattr(end, f.name) for end in ends], counts) for f in fields(ends[0])}


def _plain(ends: Sequence[Levels] | Sequence[PictureFigures], counts: int = 1) -> dict[str, Any]:
    """Bands as JSON has them; null where there is no such number."""
    return {
        name: {k: v if math.isfinite(v) else None for k, v in asdict(figure).items()}
        for name, figure in _bands(ends, counts).items()
    }


def _number(figure: Band, unit: str = "") -> str:
    return _with_band([_digits(v) for v in (figure.value, figure.low, figure.high)], unit)


def _percent(figure: Band, unit: str = "") -> str:
    each = [f"{100 * v:.1f}" for v in (figure.value, figure.low, figure.high)]
    return _with_band(each, f" %{unit}")


def _with_band(texts: Sequence[str], unit: str) -> str:
    value, low, high = texts
    if value == "nan":
        return "-"
    told = f"{value}{unit}"
    return told if low == high else f"{told} ({low} .. {high})"


def _digits(value: float) -> str:
    """Three digits, and no powers of ten."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _verdict(unclipped: Band) -> str:
    if unclipped.low == unclipped.high:
        return "yes" if unclipped.value else "no"
    return f"{'yes' if unclipped.value else 'no'}, but not at both ends"


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
