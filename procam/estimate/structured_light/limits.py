"""What counts as light, as a bit, and as a sample."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[Any]
Mask = NDArray[np.bool_]
LIT_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class DecodeLimits:
    """What counts as decoded, in the unit of the pictures.

    Attributes
    ----------
    white_black : white - black must exceed this.
    contrast : |pattern - inverse| must reach this in every stripe picture.
    lit_share : direct light must be this share of white - black. White - black alone marks the whole
        dome as lit, because scattered light reaches everywhere (science.md s.2); 0 reckons with none.
    saturated, dark : samples at or above, at or below, are not used; None for none.
    neighbours : a pixel must agree with its neighbourhood, or it is dropped.
    """

    white_black: float
    contrast: float
    lit_share: float = LIT_SHARE
    saturated: float | None = None
    dark: float | None = None
    neighbours: bool = True


def default_limits(white: Samples, black: Samples) -> DecodeLimits:
    """Limits for pictures of unknown origin, from their own noise.

    The noise is read off neighbouring pixels of the black picture; a bit must stand 4 of its
    standard errors clear, white - black 8. Whole numbers end at 0 and at their full scale.
    """
    step = np.diff(black.astype(float), axis=1)
    noise = 1.4826 * float(np.median(np.abs(step - np.median(step)))) / np.sqrt(2)
    steps = np.diff(np.unique([white, black]))
    # what can be decoded spans 16 camera steps or more; a clean drawing shows two values only
    rounding = 0.5 * min(float(steps.min()), float(steps.sum()) / 16) if steps.size else 0.5
    noise = max(noise, rounding)
    whole = white.dtype.kind == "u"
    return DecodeLimits(
        white_black=8 * noise,
        contrast=4 * noise,
        saturated=full_scale(white) if whole else None,
        dark=0.0 if whole else None,
    )


def full_scale(white: Samples) -> float:
    """Where whole numbers end: at the fewest bits, of 8, 10, 12, 14 or 16, that `white` fits in."""
    top = int(white.max())
    return float(next(2**bits - 1 for bits in (8, 10, 12, 14, 16) if top < 2**bits))


def dropped_samples(image: Samples, limits: DecodeLimits) -> Mask:
    """Samples (H, W) that say nothing: saturated, dark, or not a number."""
    bad = ~np.isfinite(image) if image.dtype.kind == "f" else np.zeros(image.shape, bool)
    if limits.saturated is not None:
        bad |= image >= limits.saturated
    if limits.dark is not None:
        bad |= image <= limits.dark
    return np.asarray(bad)
