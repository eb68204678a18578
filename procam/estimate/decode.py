"""Gray codes with inverses to projector coordinates, one pair at a time."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import ShapeError
from procam.maths.gray import decode_gray
from procam.model.correspondence import CorrespondenceMap

Image = NDArray[np.float32]
QUANTISATION_PX = 1 / np.sqrt(12)  # a Gray code tells the pixel, not the place inside it
COARSE_STRIPE_PX = 8
LIT_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class CodePair:
    """A stripe picture and its inverse: `axis` "x" or "y", `bit` (0 = finest), both (H, W)."""

    axis: str
    bit: int
    bright: Image
    inverse: Image


@dataclass(frozen=True, slots=True)
class DecodeLimits:
    """What counts as decoded.

    Attributes
    ----------
    white_black : white - black must exceed this [same unit as the pictures].
    contrast : |pattern - inverse| must reach this in every bit.
    lit_share : mean of |pattern - inverse| / (white - black) over the coarse bits must reach this.
        It tells directly lit pixels from those that only see light from elsewhere on the dome,
        where white - black is large too (science.md s.2); 0 switches it off.
    """

    white_black: float
    contrast: float
    lit_share: float = LIT_SHARE


def decode_gray_pairs(
    pairs: Iterable[CodePair],
    white: Image,
    black: Image,
    bits: dict[str, int],
    limits: DecodeLimits,
) -> CorrespondenceMap:
    """Projector pixel seen by every camera pixel; `bits` per axis, pairs in any order.

    Pairs are folded in as they come: memory does not grow with their number.
    """
    span = white - black
    code = {axis: np.zeros(white.shape, np.int32) for axis in bits}
    share, coarse = np.zeros(white.shape, np.float32), 0
    valid = np.isfinite(span) & (span > limits.white_black)
    for pair in pairs:
        if pair.bright.shape != white.shape:
            raise ShapeError(f"code {pair.axis}{pair.bit}", pair.bright.shape, f"{white.shape}")
        strength = pair.bright - pair.inverse
        code[pair.axis] |= (strength > 0).astype(np.int32) << pair.bit
        np.abs(strength, out=strength)
        with np.errstate(invalid="ignore"):
            valid &= strength >= limits.contrast
        if 2 ** (pair.bit + 1) >= COARSE_STRIPE_PX:
            share += strength
            coarse += 1
    if coarse and limits.lit_share:
        with np.errstate(invalid="ignore"):
            valid &= share >= limits.lit_share * coarse * span
    xy = np.stack([decode_gray(code[axis], bits[axis]) for axis in bits], axis=-1)
    xy = np.where(valid[..., None], xy, np.nan).astype(np.float32)
    sigma = np.where(valid, QUANTISATION_PX, np.nan).astype(np.float32)
    return CorrespondenceMap(xy, sigma, valid)


def drop_outside(found: CorrespondenceMap, size: tuple[int, int]) -> CorrespondenceMap:
    """Invalidate coordinates beyond a panel of `size` (width, height): they are misread codes."""
    with np.errstate(invalid="ignore"):
        inside = found.valid & np.all(found.projector_xy <= np.array(size) - 1, axis=-1)
    return CorrespondenceMap(
        np.where(inside[..., None], found.projector_xy, np.nan).astype(np.float32),
        np.where(inside, found.sigma_px, np.nan).astype(np.float32),
        inside,
    )


def default_limits(white: NDArray[np.floating], black: NDArray[np.floating]) -> DecodeLimits:
    """Limits for pictures of unknown origin, from their own noise.

    The noise is read off neighbouring pixels of the black picture; a bit must stand 4 of its
    standard errors clear, white - black 8.
    """
    step = np.diff(black.astype(float), axis=1)
    noise = 1.4826 * float(np.median(np.abs(step - np.median(step)))) / np.sqrt(2)
    steps = np.diff(np.unique([white, black]))
    # what can be decoded spans 16 camera steps or more; a clean drawing shows two values only
    rounding = 0.5 * min(float(steps.min()), float(steps.sum()) / 16) if steps.size else 0.5
    noise = max(noise, rounding)
    return DecodeLimits(white_black=8 * noise, contrast=4 * noise)
