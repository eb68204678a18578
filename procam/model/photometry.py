"""What a projector's light is like."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class ResponseCurve:
    """Monotone table of the projector's response.

    `levels` (K,) drive 0..1; `values` (K, 3) relative linear light, 0 at drive 0 and 1 at drive 1
    (black taken off); `sigma` (K, 3) their standard errors.
    """

    levels: NDArray[np.float64]
    values: NDArray[np.float64]
    sigma: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Photometry:
    """Light of one projector in the calibration's content channels.

    direct radiance at a pixel = gain * (colour_mix @ response(drive) ** exponent) + black.

    Attributes
    ----------
    response : drive to linear light.
    colour_mix : (3, 3), rows sum to 1: what each primary sends into each content channel.
    gain : (H, W, 3) direct radiance [rel] at full white, before blending.
    exponent : (H, W, 3) how the response differs by place, as that of a media server does whose
        projectors are not alike; None where it does not.
    """

    response: ResponseCurve
    colour_mix: NDArray[np.float64]
    gain: NDArray[np.float32]
    exponent: NDArray[np.float32] | None = None
