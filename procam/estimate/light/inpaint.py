"""Panel pixels that showed something else than the patterns: left out, and filled from around them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from procam.estimate.light.separation import SeparatedLight
from procam.maths.warp import grow
from procam.model.mask import Mask

Image = NDArray[np.float32]
Pixels = NDArray[np.bool_]
Array = NDArray[np.float64]
Index = NDArray[np.intp]
LIT_HALF = 0.5
BORDER_CAMERA_PX = 3  # how far lens and scattering carry light out of a hidden place
NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))


def pixels_without_pattern(panel: Mask, projector_xy: Image) -> Pixels:
    """Camera pixels (H, W) that see marked pixels of a panel, or the light beside them."""
    return grow(panel.at(projector_xy), BORDER_CAMERA_PX)


def fill_light(
    light: SeparatedLight, white: Image, hidden: Pixels, solid_angle_sr: NDArray[np.float64]
) -> SeparatedLight:
    """Direct light continued over `hidden` camera pixels (H, W), as if white had shone there too.

    The border of the lit area is drawn straight through them. `white` (H, W, 3) is the photograph of
    white, black taken off: scattered light belongs to the flux it really had, and grows with it.
    """
    on_screen = solid_angle_sr > 0
    lit_share = fill_picture(light.lit[..., None].astype(np.float32), hidden, on_screen)[..., 0]
    lit = light.lit.copy()
    lit[hidden] = on_screen[hidden] & (lit_share[hidden] > LIT_HALF)
    direct = fill_picture(light.direct, hidden & on_screen, light.lit)
    direct[hidden & ~lit] = 0

    def flux_of(picture: Image) -> Array:
        return light.flux + solid_angle_sr[hidden] @ np.nan_to_num(picture - light.direct[hidden])

    shown = flux_of(white[hidden] - light.scattered[hidden])
    flux = flux_of(direct[hidden])
    return replace(
        light,
        direct=direct,
        extended=fill_picture(light.extended, hidden & on_screen, light.lit),
        scattered=light.scattered * (flux / shown).astype(np.float32),
        flux=flux,
        lit=lit,
    )


def fill_picture(picture: Image, hidden: Pixels, known: Pixels) -> Image:
    """`picture` (H, W, C) with its hidden pixels replaced by what is `known` (H, W) around them.

    A membrane spanned by the known pixels (Laplace's equation), so that slopes go on. Hidden places
    that touch none become 0.
    """
    edge = known & ~hidden
    number = np.full(hidden.shape, -1)
    rows, columns = np.nonzero(hidden)
    number[hidden] = np.arange(len(rows))
    right = np.zeros((len(rows), picture.shape[2]))
    count = np.full(len(rows), 1e-9)  # without it a place that touches nothing has no solution
    at: list[tuple[Index, Index]] = []
    for down, across in NEIGHBOURS:
        r, c = rows + down, columns + across
        inside = (r >= 0) & (r < hidden.shape[0]) & (c >= 0) & (c < hidden.shape[1])
        r, c = np.where(inside, r, rows), np.where(inside, c, columns)
        beside, within = inside & edge[r, c], inside & hidden[r, c]
        count += beside | within
        right[beside] += np.nan_to_num(picture[r[beside], c[beside]])
        at.append((np.flatnonzero(within), number[r[within], c[within]]))
    filled = picture.copy()
    if len(rows):
        filled[hidden] = _solved(count, at, right)
    return filled


def _solved(count: Array, links: list[tuple[Index, Index]], right: Array) -> Array:
    """Values (N, C) of which each is the mean of its `count` neighbours: those linked, and `right`."""
    each = np.arange(len(count))
    first = np.concatenate([each, *(i for i, _ in links)])
    second = np.concatenate([each, *(j for _, j in links)])
    values = np.concatenate([count, np.full(len(first) - len(each), -1.0)])
    matrix = coo_array((values, (first, second)), shape=(len(each), len(each))).tocsc()
    return np.asarray(spsolve(matrix, right)).reshape(right.shape)
