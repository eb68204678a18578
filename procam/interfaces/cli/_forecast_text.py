"""The lines of `procam forecast`: figures with their bands, without and with compensation."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from textwrap import wrap
from typing import Any

from procam.errors import InputError
from procam.files.versions import chosen_calibration
from procam.interfaces.plots.forecast import Layout
from procam.workflows.forecast import Band, Levels, Prospect, band
from procam.workflows.judged_picture import PictureFigures, Seen

COLUMNS, LABEL, FIGURE = 100, 37, 31  # widths of the table
Ends = Sequence[Levels] | Sequence[PictureFigures]
Described = dict[str, float]  # a planned dome by the options that are given
Pictures = Mapping[str, tuple[Sequence[PictureFigures], Seen]]
USUAL = {
    "albedo_sigma": 0.03,
    "reflecting": 1.0,
    "half_angle_deg": 90.0,
    "floor_albedo": 0.1,
    "contrast": 2000.0,
}


@dataclass(frozen=True)
class Found:
    """A forecast: `levels` and figures of `pictures` at both ends and in the middle, light in `unit`.

    `more` and `after` are lines after the levels, and after the pictures; `document` is added to that of
    the result; `layout` of a room's canvas.
    """

    levels: Sequence[Levels]
    unit: str
    pictures: Pictures
    assumptions: Sequence[str]
    more: Sequence[str] = ()
    after: Sequence[str] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
    layout: Layout | None = None


def light_lines(title: str, ends: Sequence[Levels], unit: str, *, value: int = 1) -> Iterator[str]:
    """White, black and contrast; `value` is the index of the end that is the figure."""
    bands = _bands(ends, value)
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


def picture_lines(path: str, ends: Sequence[PictureFigures], *, value: int = 1) -> Iterator[str]:
    """What compensation does for a picture."""
    bands = _bands(ends, value)
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


def assumed_lines(assumptions: Sequence[str]) -> Iterator[str]:
    """The assumptions, wrapped."""
    yield "\nassumed:"
    for text in assumptions:
        yield from wrap(text, COLUMNS, initial_indent="  ", subsequent_indent="    ")


def _row(label: str, before: str, after: str) -> str:
    return f"{label:{LABEL}}{before:>{FIGURE}} {after:>{FIGURE}}".rstrip()


def _bands(ends: Ends, value: int) -> dict[str, Band]:
    """Each figure with its band, by name."""
    return {f.name: band([getattr(end, f.name) for end in ends], value) for f in fields(ends[0])}


def plain(ends: Ends, *, value: int = 1) -> dict[str, Any]:
    """Figures with their bands as JSON has them; null where there is no such number."""
    return {
        name: {k: v if math.isfinite(v) else None for k, v in asdict(figure).items()}
        for name, figure in _bands(ends, value).items()
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
    text = f"{value}{unit}"
    return text if low == high else f"{text} ({low} .. {high})"


def _digits(value: float) -> str:
    """Three digits, and no powers of ten."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _verdict(unclipped: Band) -> str:
    if unclipped.low == unclipped.high:
        return "yes" if unclipped.value else "no"
    return f"{'yes' if unclipped.value else 'no'}, but not at both ends"


def check_lumens(lumens: float | None) -> None:
    """Refuse a sum of projectors that is none."""
    if lumens is not None and not 0 < lumens < math.inf:
        raise InputError(
            f"--lumens is {lumens:g}; the sum of all projectors is above 0, such as 10000"
        )


def metered_nits(prospect: Prospect) -> float | None:
    """Luminance of the reference white by a hand meter [cd/m2]."""
    absolute = prospect.ends[1].absolute
    return absolute.nits_per_unit[0] if absolute else None


def assumptions_of(
    prospect: Prospect, venue: Path | None, described: Described, lumens: float | None
) -> Iterator[str]:
    """The assumptions behind the figures."""
    yield (
        "matte screen; 1.0 of a picture (255 of 8 bits) is the white that every lit place reaches "
        "without inter-reflection; luminance of R, G and B weighted as in ITU-R BT.709"
    )
    if venue is not None:
        yield f"everything measured by {chosen_calibration(venue)}; bands: 95 % of its feedback"
        if nits := metered_nits(prospect):
            yield f"by a hand meter 1.0 is {nits:.3g} cd/m2, as direct light"
    else:
        values = USUAL | described
        yield (
            f"albedo {described['albedo']:g} with sigma {values['albedo_sigma']:g}; bands: both ends "
            "of its 95 % interval"
        )
        yield (
            f"cap of {values['half_angle_deg']:g} degrees, level, {described['coverage']:.4g} of it "
            f"lit down from the pole, {values['reflecting']:.4g} of it painted; floor of albedo "
            f"{values['floor_albedo']:g} as wide as the rim"
        )
        yield (
            f"projectors of {values['contrast']:g}:1 full white to full black; where pictures "
            "overlap, black is brighter than printed here"
        )
    if lumens is not None:
        radius = prospect.ends[1].dome.radius_m
        yield (
            f"{lumens:g} lm, all on the {prospect.lit_sr * radius**2:.4g} m2 that are lit, radius "
            f"{radius:g} m; blending, masks and light that misses the dome reduce this"
        )
