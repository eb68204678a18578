"""The parts of a report: rows of pictures of the screen, charts, tables, sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from procam.arrays import FloatArray
from procam.interfaces.plots.charts import Scale, paint_categories
from procam.interfaces.plots.figure import Colour, css_colour
from procam.interfaces.report.data import Material

Legend = Sequence[tuple[Colour, str]]


@dataclass(frozen=True, slots=True)
class ScreenPicture:
    """One picture on the screen's canvas, with its title."""

    title: str
    image: str


@dataclass(frozen=True, slots=True)
class Group:
    """Pictures that share one colour scale or one legend of (colour, text)."""

    pictures: list[ScreenPicture]
    scale: Scale | None = None
    legend: list[tuple[str, str]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Pictures:
    """A row of pictures of the screen."""

    kind: ClassVar[str] = "pictures"
    groups: list[Group]
    caption: str
    dark: bool = False


@dataclass(frozen=True, slots=True)
class Charts:
    """Charts side by side."""

    kind: ClassVar[str] = "charts"
    images: list[tuple[str, str]]  # picture, what it shows
    caption: str
    width_px: int


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head; the first column names the row."""

    kind: ClassVar[str] = "table"
    head: list[str]
    rows: list[list[str]]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Text:
    """A sentence; a `missing` one names the command that adds what is not there.

    `good` of a verdict: whether it is a good one.
    """

    kind: ClassVar[str] = "text"
    text: str
    missing: bool = False
    good: bool | None = None

    @property
    def style(self) -> str:
        """Its class in the page."""
        if self.good is not None:
            return "verdict small good" if self.good else "verdict small bad"
        return "missing" if self.missing else ""


Block = Pictures | Charts | Table | Text


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the report."""

    key: str
    title: str
    blocks: list[Block]


def not_there(what: str, command: str) -> Text:
    """A sentence with what is missing and the command that adds it."""
    return Text(f"{what}: not there yet. Run {command} to add it.", missing=True)


def calibrating(material: Material) -> str:
    """The command that writes a calibration and its pictures."""
    return (
        f"`procam calibrate {material.directory}` (by hand: `procam session plan`, `add`, `solve`)"
    )


def signed(label: str, end: float) -> Scale:
    """A scale of differences in per cent, from -end to +end."""
    return Scale(label, -end, end, "signed", 100.0)


def signed_light(end: float) -> Scale:
    """A scale of errors of light."""
    arrows = "too dark \N{LEFTWARDS ARROW} [% of white] \N{RIGHTWARDS ARROW} too bright"
    return signed(arrows, end)


def extent(values: FloatArray, least: float, step: float = 0.0) -> float:
    """99.5 % of the sizes of finite values, not below `least`, rounded up to a multiple of `step`."""
    known = np.abs(values[np.isfinite(values)])
    end = max(float(np.percentile(known, 99.5)), least) if known.size else least
    return float(np.ceil(end / step - 1e-9) * step) if step else end


def brightness(top: float) -> Scale:
    """A scale of light, encoded for a screen."""
    return Scale("light, 1 = white", 0.0, top, "light")


def painted(material: Material, pictures: Mapping[str, FloatArray], scale: Scale) -> Group:
    """Pictures (H, W) or (H, W, 3) by title on one scale."""
    shown = {t: scale.paint(p, material.inside(p.shape[1])) for t, p in pictures.items()}
    return Group([ScreenPicture(*each) for each in shown.items()], scale)


def categories(
    material: Material, pictures: Mapping[str, NDArray[np.integer]], legend: Legend
) -> Group:
    """Pictures (H, W) by title, of indices into the colours of a legend."""
    colours = [colour for colour, _ in legend]
    shown = {
        t: paint_categories(p, colours, material.inside(p.shape[1])) for t, p in pictures.items()
    }
    entries = [(css_colour(colour), text) for colour, text in legend]
    return Group([ScreenPicture(*each) for each in shown.items()], None, entries)
