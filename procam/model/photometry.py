"""Response, colour and brightness of a projector."""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, Array32, IndexArray

PRIMARIES = ("red", "green", "blue")
MOST_RESPONSE = 0.02  # of white, at any drive
CERTAIN = 5.0  # sigmas


@dataclass(frozen=True, slots=True)
class ResponseCurve:
    """Projector response as a monotone table.

    `levels` (K,) drive 0..1; `values` (K, 3) relative linear light, 0 at drive 0 and 1 at drive 1
    (black subtracted); `sigma` (K, 3) their standard errors.
    """

    levels: Array
    values: Array
    sigma: Array


@dataclass(frozen=True, slots=True)
class Departure:
    """A difference of a response at a `drive` [-]: `size` of light over white, standard error `sigma`.

    `channel` is the index of a primary, None for the mean of all.
    """

    size: float
    sigma: float
    drive: float = 0.0
    channel: int | None = None

    def in_channel(self, channels: IndexArray) -> "Departure":
        """The same where the channels that were compared are those of an array."""
        return self if self.channel is None else replace(self, channel=int(channels[self.channel]))

    @property
    def excess(self) -> float:
        """Size over what it must be to be named: `MOST_RESPONSE`, or five standard errors."""
        return abs(self.size) / max(MOST_RESPONSE, CERTAIN * self.sigma)

    @property
    def place(self) -> str:
        """Where it is, in words."""
        light = "light" if self.channel is None else PRIMARIES[self.channel]
        return f"its {light} at drive {255 * self.drive:.0f} of 255"

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.place} by {self.size:+.3f} of white"


def departures(step: Array, sigma: Array, drives: Array) -> list[Departure]:
    """Of differences (L, C) at drives (L,) the clearest of the channels' mean, then those of each channel."""
    columns: list[tuple[int | None, Array, Array]] = [
        (None, step.mean(axis=1), np.sqrt((sigma**2).sum(axis=1)) / sigma.shape[1])
    ]
    columns += [(c, step[:, c], sigma[:, c]) for c in range(step.shape[1])]
    return [
        max(
            (
                Departure(float(size), float(error), float(drive), channel)
                for size, error, drive in zip(sizes, errors, drives, strict=True)
            ),
            key=lambda departure: departure.excess,
        )
        for channel, sizes, errors in columns
    ]


@dataclass(frozen=True, slots=True)
class AbsoluteColour:
    """What content light is in absolute units, by a hand meter.

    `xyz_from_content` (3, 3) from content radiance [rel] to XYZ [cd/m2]; `covariance` (9, 9) of its entries,
    row by row.
    """

    xyz_from_content: Array
    covariance: Array

    @property
    def sigma(self) -> Array:
        """Standard errors (3, 3) of `xyz_from_content` [cd/m2]."""
        return np.sqrt(np.diag(self.covariance)).reshape(3, 3)

    @property
    def white(self) -> Array:
        """XYZ (3,) of the reference white [cd/m2]."""
        return np.asarray(self.xyz_from_content.sum(axis=1))

    @property
    def nits_per_unit(self) -> tuple[float, float]:
        """Luminance of the reference white (relative radiance 1) and its standard error [cd/m2]."""
        return float(self.white[1]), float(np.sqrt(self.covariance[3:6, 3:6].sum()))


@dataclass(frozen=True, slots=True)
class Photometry:
    """Light of one projector in the calibration's content channels.

    direct radiance at a pixel = gain * (colour_mix @ response(drive) ** exponent) + black
    (docs/theory/photometry.md, R2).

    Attributes
    ----------
    response : drive to linear light.
    colour_mix : (3, 3), rows sum to 1: light of each primary in each content channel.
    gain : (H, W, 3) direct radiance [rel] at full white, before blending.
    exponent : (H, W, 3) change of the response over the picture, as with a media server that feeds
        projectors of different response; None for one response.
    """

    response: ResponseCurve
    colour_mix: Array
    gain: Array32
    exponent: Array32 | None = None
