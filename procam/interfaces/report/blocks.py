"""The parts of a report: rows of dome pictures, charts, tables, sentences."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from procam.arrays import FloatArray
from procam.interfaces.plots.charts import Scale
from procam.interfaces.report.data import Material


@dataclass(frozen=True, slots=True)
class DomePicture:
    """One dome master to show, with its title."""

    title: str
    image: str


@dataclass(frozen=True, slots=True)
class Group:
    """Dome masters that share one colour scale or one legend of (colour, text)."""

    domes: list[DomePicture]
    scale: Scale | None = None
    legend: list[tuple[str, str]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Domes:
    """A row of dome masters."""

    kind: ClassVar[str] = "domes"
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


Block = Domes | Charts | Table | Text


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


def painted(pictures: Mapping[str, FloatArray], scale: Scale) -> Group:
    """Dome masters by title on one scale."""
    return Group([DomePicture(t, scale.paint(p)) for t, p in pictures.items()], scale)
