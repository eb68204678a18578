"""Frames of a projector in NumPy: the reference implementation of `warp_frame`.

Arguments are checked and described in `procam.kernels.warp.api`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, Array, Image

BLOCK = 16  # pixels that share base and step of their numbers
PLACE, BLACK, SHARE = slice(0, 2), slice(2, 5), slice(5, 8)
PACKED = np.dtype([("base", "f4", 8), ("step", "f4", 8), ("number", "u2", (8, BLOCK))])
TILE, BAND, STRIP = 64, 32, 32  # columns and rows of a tile, columns of its strips [px]
STEPS, OCTAVES = 32, 16
LEAST = 2.0**-OCTAVES
_KNOT = np.arange(STEPS * OCTAVES + 1)
_LIFTED = LEAST * 2.0 ** (_KNOT // STEPS) * (1 + _KNOT % STEPS / STEPS)
KNOTS = (_LIFTED - LEAST) / (1 - LEAST)  # light at which drives are tabulated, dense in the dark


@dataclass(frozen=True, slots=True)
class WarpPlan:
    """Everything `warp_frame` needs of one projector; made by `plan_warp`.

    Attributes
    ----------
    shape : (H, W) of the frame.
    blocks : (ceil(H / 32), ceil(W / 64), 2, 32, 2) of type PACKED, in the order C takes them: place,
        black and share of each pixel in 20 bytes. Bands, tiles, strips, rows, halves of a strip.
    unmix : (3, 3) float32.
    decode : (256,) float32 light of 8-bit masters.
    drives : (513, 3) drives 0..1 at the light KNOTS; None where frames are light themselves.
    thresholds : (64, 64) float32.
    """

    shape: tuple[int, int]
    blocks: NDArray[np.void]
    unmix: Image
    decode: Image
    drives: Array | None
    thresholds: Image


def unpacked(plan: WarpPlan, band: int) -> Image:
    """Place x, y, black and share (h, W, 8) of 32 rows, fewer at the end."""
    blocks = plan.blocks[band]
    numbers = blocks["base"][..., None] + blocks["step"][..., None] * blocks["number"]
    rows = numbers.transpose(2, 0, 1, 3, 5, 4).reshape(BAND, -1, 8)
    return rows[: plan.shape[0] - band * BAND, : plan.shape[1]]


def sample(master: Image, place: Image) -> Image:
    """Bilinear samples (..., 3) of (N, M, 3) at (..., 2); the master is 0 outside."""
    first = np.clip(np.floor(place), 0, np.array(master.shape[1::-1]) - 2).astype(int)
    total = np.zeros((*place.shape[:-1], 3), np.float32)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = first + np.array([dx, dy])
        weight = np.maximum(1 - np.abs(place - at.astype(np.float32)), 0).prod(axis=-1)
        total += weight[..., None] * master[at[..., 1], at[..., 0]]
    return total


def light(master: Image, pixel: Image, unmix: Image) -> Image:
    """Light to send (h, W, 3), 0..1, for pixels (h, W, 8); unknown light is none."""
    asked = (sample(master, pixel[..., PLACE]) - pixel[..., BLACK]) * pixel[..., SHARE]
    return np.clip(np.nan_to_num(asked @ unmix.T, nan=0.0), 0, 1)


def decoded(master: AnyArray, plan: WarpPlan) -> Image:
    """The master in linear light; infinite light is unknown."""
    if master.dtype == np.uint8:
        return plan.decode[master]
    if master.dtype == np.uint16:
        return master.astype(np.float32) / np.float32(65535)
    return np.where(np.isfinite(master), master, np.nan).astype(np.float32)


def drive(light: Image, plan: WarpPlan) -> Image:
    """Drives (h, W, 3) that give light (h, W, 3)."""
    assert plan.drives is not None
    planes = [np.interp(light[..., c], KNOTS, plan.drives[:, c]) for c in range(3)]
    return np.stack(planes, axis=-1).astype(np.float32)


def warp_frame(master: AnyArray, plan: WarpPlan, out: AnyArray) -> None:
    """See `procam.kernels.warp_frame`."""
    linear = decoded(master, plan)
    tile = np.tile(plan.thresholds, (1, -(-plan.shape[1] // TILE)))[:, : plan.shape[1], None]
    for band in range(len(plan.blocks)):
        sent = light(linear, unpacked(plan, band), plan.unmix)
        top = band * BAND
        rows = slice(top, top + len(sent))
        if out.dtype == np.float32:
            out[rows] = sent
        elif out.dtype == np.uint16:
            out[rows] = np.rint(65535 * drive(sent, plan))
        else:
            lifted = 255 * drive(sent, plan) + tile[top % TILE :][: len(sent)]
            out[rows] = np.floor(np.minimum(lifted, 255))
