"""A correspondence map as a picture."""

import numpy as np
from numpy.typing import NDArray

from procam.model.correspondence import CorrespondenceMap

LINES = 16  # grid lines over the longer side of the panel
UNKNOWN = 24  # grey of holes


def draw_map(found: CorrespondenceMap, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Colours (H, W, 3): red grows to the panel's right, green downwards; a grid every 1/16.

    The cells of a sound map are straight and of one colour each; holes are dark grey.
    """
    xy = np.where(found.valid[..., None], found.projector_xy, 0.0)
    share = np.clip(xy / np.maximum(np.array(size) - 1.0, 1.0), 0, 1)
    colour = np.stack([share[..., 0], share[..., 1], 1 - share.mean(axis=-1)], axis=-1)
    cell = max(size) / LINES
    # a line runs where neighbours lie in different cells
    index = np.floor(xy / cell)
    line = np.zeros(found.valid.shape, bool)
    line[:, 1:] |= (index[:, 1:] != index[:, :-1]).any(axis=-1)
    line[1:, :] |= (index[1:] != index[:-1]).any(axis=-1)
    colour = np.where(line[..., None], 1.0, 0.15 + 0.7 * colour)
    picture = np.where(found.valid[..., None], 255 * colour, UNKNOWN)
    return np.asarray(np.rint(picture), np.uint8)
