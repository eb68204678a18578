"""Pictures on a screen's canvas, colour scales and charts of a report, as PNG data addresses."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, FloatArray
from procam.interfaces.plots.figure import (
    CHANNELS,
    INK,
    UNKNOWN,
    css_colour,
    finish,
    new_figure,
    png_of,
    require_matplotlib,
    title_axes,
)
from procam.maths.light.curves import srgb_encode
from procam.model.photometry import ResponseCurve
from procam.model.screen import ContentCanvas

Pixels = NDArray[np.uint8]
Colours = Sequence[tuple[int, int, int]]
Palette = Literal["light", "amount", "alternative", "signed"]
# all are safe for colour-blind readers and readable in grey print
MAPS = {"amount": "viridis", "alternative": "cividis", "signed": "RdBu_r"}
# how many projectors: none, one, two, three, four or more
COUNTS = ((236, 238, 239), (158, 202, 225), (66, 146, 198), (8, 81, 156), (8, 29, 88))
STOPS = 24


@dataclass(frozen=True, slots=True)
class Scale:
    """A mapping from numbers to colours.

    Attributes
    ----------
    label : what is shown, with its unit. low, high : values at the ends.
    palette : "light" encodes light for a screen (sRGB), "signed" is centred on 0.
    factor : factor of the ticks' numbers, such as 100 for per cent.
    """

    label: str
    low: float
    high: float
    palette: Palette = "amount"
    factor: float = 1.0

    def position(self, values: FloatArray) -> FloatArray:
        """Position of values on the scale, 0..1."""
        share = np.clip((values - self.low) / (self.high - self.low), 0, 1)
        return srgb_encode(share) if self.palette == "light" else share

    def ticks(self) -> list[tuple[float, str]]:
        """(position [%], text) of round values."""
        values = _round_values(self.low * self.factor, self.high * self.factor)
        places = self.position(values / self.factor) * 100
        minus = [f"{v:.6g}".replace("-", "\N{MINUS SIGN}") for v in values]
        return [(float(p), text) for p, text in zip(places, minus, strict=True)]

    def stops(self) -> list[str]:
        """Colours from low to high, for a gradient."""
        table = self._table()[np.linspace(0, 255, STOPS).round().astype(int)]
        return [css_colour((int(r), int(g), int(b))) for r, g, b in table]

    def _table(self) -> Pixels:
        """The 256 colours of the scale (256, 3)."""
        if self.palette == "light":
            return np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
        name = MAPS[self.palette]
        colours = require_matplotlib().colormaps[name](np.linspace(0, 1, 256))
        return np.asarray(np.rint(np.asarray(colours)[:, :3] * 255), np.uint8)

    def paint(self, values: FloatArray, inside: BoolArray) -> str:
        """A picture (H, W), or (H, W, 3) light, as `screen_png`; NaN is grey."""
        known = np.isfinite(values)
        codes = np.rint(self.position(np.where(known, values, self.low)) * 255).astype(np.uint8)
        colours = codes if values.ndim == 3 else self._table()[codes]
        shown = np.broadcast_to(known if values.ndim == 3 else known[..., None], colours.shape)
        return screen_png(np.where(shown, colours, np.array(UNKNOWN, np.uint8)), inside)


def paint_categories(codes: NDArray[np.integer], colours: Colours, inside: BoolArray) -> str:
    """A picture (H, W) of indices into `colours`, as `screen_png`."""
    return screen_png(np.array(colours, np.uint8)[np.clip(codes, 0, len(colours) - 1)], inside)


def screen_png(rgb: Pixels, inside: BoolArray) -> str:
    """A picture (H, W, 3) on a canvas as a PNG data address, transparent where it is not `inside` (H, W)."""
    from matplotlib.image import imsave  # noqa: PLC0415

    rgba = np.dstack([np.where(inside[..., None], rgb, 0), inside * np.uint8(255)])
    buffer = io.BytesIO()
    imsave(buffer, rgba, format="png", pil_kwargs={"compress_level": 4})
    return _address(buffer.getvalue())


def on_canvas(canvas: ContentCanvas, direction: FloatArray, values: FloatArray, size: int) -> Array:
    """Mean of `values` (K,) per pixel (H, W) of a picture of that width; NaN where none falls.

    `direction` (K, 3) are unit vectors from the screen's origin.
    """
    rows, columns = shape = canvas.shape(size)
    x, y = np.rint(canvas.pixels(direction.astype(float), size)).astype(int).T
    on = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
    index = y[on] * columns + x[on]
    count = np.bincount(index, minlength=rows * columns)
    total = np.bincount(index, weights=values[on], minlength=rows * columns)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return np.asarray(mean.reshape(shape))


def response_chart(name: str, curve: ResponseCurve) -> str:
    """Response of a projector, and its difference from the power law 2.2."""
    figure = new_figure(3.7, 3.9)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    power = curve.levels**2.2
    upper.plot(curve.levels, power, color="#9aa4ad", lw=4, alpha=0.6, label="power law 2.2")
    for c, (label, colour, style) in enumerate(CHANNELS):
        apart, sigma = 100 * (curve.values[:, c] - power), 100 * 1.96 * curve.sigma[:, c]
        upper.plot(curve.levels, curve.values[:, c], color=colour, ls=style, lw=1.6, label=label)
        lower.plot(curve.levels, apart, color=colour, ls=style, lw=1.4)
        lower.fill_between(curve.levels, apart - sigma, apart + sigma, color=colour, alpha=0.18)
    title_axes(upper, name)
    upper.set_ylabel("light given (1 = full)")
    lower.set_ylabel("difference [%]")
    lower.set_xlabel("drive sent (0 = black, 1 = full)")
    finish([upper, lower])
    upper.legend(frameon=False, fontsize=8.5)
    return _address(png_of(figure))


def profile_chart(elevation_deg: Array, before: Array, after: Array, after_free: Array) -> str:
    """Error against elevation, (K,) and (K, 3) as share of white; the right panel is enlarged."""
    figure = new_figure(9.6, 3.5)
    left, right = figure.subplots(1, 2)
    for c, (label, colour, style) in enumerate(CHANNELS):
        left.plot(
            elevation_deg, 100 * before[:, c], color=colour, ls=style, label=f"{label}, before"
        )
        left.plot(elevation_deg, 100 * after_free[:, c], color=colour, ls=style, lw=0.9)
        right.plot(elevation_deg, 100 * after_free[:, c], color=colour, ls=style, label=label)
        right.plot(elevation_deg, 100 * after[:, c], color=colour, ls=style, lw=1, alpha=0.35)
    titles = ("Before; thin, near zero: after", "After, enlarged; pale: limits included")
    for axes, title in zip((left, right), titles, strict=True):
        title_axes(axes, title)
        axes.axhline(0, color=INK, lw=0.8)
        axes.set_xlabel("elevation above the dome's rim [degrees]")
        axes.set_ylabel("too bright by [% of white]")
        axes.legend(frameon=False, fontsize=8.5)
    finish([left, right])
    return _address(png_of(figure))


def loop_chart(residual: Sequence[float], noise_floor: float) -> str:
    """Residual after each iteration against the camera's noise, as shares of white."""
    figure = new_figure(6.4, 3.3)
    axes = figure.subplots()
    values = 100 * np.array(residual, float)
    positive = values[values > 0]
    if len(positive) == len(values) and positive.max() > 8 * positive.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    else:
        axes.set_ylim(0, 1.15 * max(np.nanmax(values), 100 * noise_floor))
    axes.axhline(
        100 * noise_floor, color="#6b7680", ls="--", lw=1.3, label="camera noise, one photograph"
    )
    axes.plot(range(len(values)), values, color="#0063a6", marker="o", label="difference")
    for i, value in enumerate(values):
        axes.annotate(
            f"{value:.2g} %", (i, value), xytext=(7, 6), textcoords="offset points", color=INK
        )
    axes.set_xticks(range(len(values)))
    axes.set_xlim(-0.2, len(values) - 0.45)
    axes.set_xlabel("corrections (0 = the calibration alone)")
    axes.set_ylabel("difference [% of white]")
    axes.legend(frameon=False, fontsize=8.5)
    finish([axes])
    return _address(png_of(figure))


def _address(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _round_values(low: float, high: float) -> Array:
    """Four to nine values on steps of 1, 2 or 5 within a range."""
    rough = (high - low) / 6
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * min((s for s in (1, 2, 5, 10) if s * power >= rough), default=10)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return np.asarray(np.arange(first, last + 1) * step + 0.0)
