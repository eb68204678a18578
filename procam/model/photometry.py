"""Response, colour and brightness of a projector."""

from dataclasses import dataclass

from procam.arrays import Array, Array32


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
