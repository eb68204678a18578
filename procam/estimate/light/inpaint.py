"""Camera pixels that do not show the pattern: excluded from fits, and inpainted afterwards.

Shot marks cover a part of the panel, and in lens glints no screen is seen.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.estimate.light.separation import SeparatedLight
from procam.maths.warp import grow
from procam.model.mask import Mask

LIT_HALF = 0.5
BORDER_CAMERA_PX = 3  # radius of the lens blur around such a place
NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))


def pixels_without_pattern(panel: Mask, projector_xy: Image) -> BoolArray:
    """Camera pixels (H, W) that see masked pixels of a panel, or their blur."""
    return grow(panel.at(projector_xy), BORDER_CAMERA_PX)


def fill_light(
    light: SeparatedLight, white: Image, missing: BoolArray, solid_angle_sr: Array
) -> SeparatedLight:
    """Inpaint the light at camera pixels without the pattern, as if white had been shown there.

    Parameters
    ----------
    light : separated light. white : (H, W, 3) photograph of white, black subtracted: its flux
        caused the scattered light, which is scaled to the flux after inpainting.
    missing : (H, W) pixels to inpaint. solid_angle_sr : (H, W), 0 off the screen.
    """
    on_screen = solid_angle_sr > 0
    lit_share = fill_picture(light.lit[..., None].astype(np.float32), missing, on_screen)[..., 0]
    lit = light.lit.copy()
    lit[missing] = on_screen[missing] & (lit_share[missing] > LIT_HALF)
    direct = fill_picture(light.direct, missing & on_screen, light.lit)
    direct[missing & ~lit] = 0

    def flux_of(picture: Image) -> Array:
        return light.flux + solid_angle_sr[missing] @ np.nan_to_num(picture - light.direct[missing])

    shown = flux_of(white[missing] - light.scattered[missing])
    flux = flux_of(direct[missing])
    return replace(
        light,
        direct=direct,
        scattered=light.scattered * (flux / shown).astype(np.float32),
        flux=flux,
        lit=lit,
    )


def fill_picture(picture: Image, missing: BoolArray, known: BoolArray) -> Image:
    """`picture` (H, W, C) with `missing` pixels (H, W) interpolated from `known` ones (H, W).

    Solves Laplace's equation with the known pixels as boundary values. Regions without a known
    neighbour become 0.
    """
    edge = known & ~missing
    number = np.full(missing.shape, -1)
    rows, columns = np.nonzero(missing)
    number[missing] = np.arange(len(rows))
    right = np.zeros((len(rows), picture.shape[2]))
    count = np.full(len(rows), 1e-9)  # keeps the matrix regular where a region has no boundary
    at: list[tuple[IndexArray, IndexArray]] = []
    for down, across in NEIGHBOURS:
        r, c = rows + down, columns + across
        inside = (r >= 0) & (r < missing.shape[0]) & (c >= 0) & (c < missing.shape[1])
        r, c = np.where(inside, r, rows), np.where(inside, c, columns)
        beside, within = inside & edge[r, c], inside & missing[r, c]
        count += beside | within
        right[beside] += np.nan_to_num(picture[r[beside], c[beside]])
        at.append((np.flatnonzero(within), number[r[within], c[within]]))
    filled = picture.copy()
    if len(rows):
        filled[missing] = _solved(count, at, right)
    return filled


def _solved(count: Array, links: list[tuple[IndexArray, IndexArray]], right: Array) -> Array:
    """Values (N, C), each the mean of its `count` neighbours: linked unknowns, and the sum `right`."""
    each = np.arange(len(count))
    first = np.concatenate([each, *(i for i, _ in links)])
    second = np.concatenate([each, *(j for _, j in links)])
    values = np.concatenate([count, np.full(len(first) - len(each), -1.0)])
    matrix = coo_array((values, (first, second)), shape=(len(each), len(each))).tocsc()
    return np.asarray(spsolve(matrix, right)).reshape(right.shape)
