"""Pictures of a round as they are written, how much alike two are, and the slate that distinguishes them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, FloatArray
from procam.maths.codes.shot_id import draw_shot_id

TOP = 65535
SAMPLED_PX = 16  # every 16th pixel of a picture is compared
SAME = 4  # of TOP: a picture that is computed again is not the same to the last bit
ALIKE = 0.1  # mean difference over mean: people do not see which of two pictures is shown
SLATE_CELLS = 100  # along the shorter side: larger ones are bent by the dome
SLATE_DRIVE = 0.75  # of the largest drive of its picture: half the light, which no camera clips

Counts = NDArray[np.uint16]
Pictures = Mapping[str, FloatArray]  # drive (H, W, C), 0..1, by projector
Samples = Mapping[str, Array]  # some pixels (h, w, C) by projector, 0..TOP


def pixels(picture: FloatArray) -> Counts:
    """A picture as it is written."""
    return np.rint(np.clip(picture, 0, 1) * TOP).astype(np.uint16)


def sampled(pictures: Pictures) -> Samples:
    """Some pixels of each picture."""
    return {n: pixels(p[::SAMPLED_PX, ::SAMPLED_PX]).astype(float) for n, p in pictures.items()}


def same(first: Samples, second: Samples) -> bool:
    """Whether pictures of the same projectors are the same."""
    return all(
        first[n].shape == second[n].shape and np.abs(first[n] - second[n]).max() <= SAME
        for n in first
    )


def alike(first: Samples, second: Samples) -> bool:
    """Whether pictures of the same projectors look much the same."""
    if any(first[n].shape != second[n].shape for n in first):
        return False
    off = sum(float(np.abs(first[n] - second[n]).sum()) for n in first)
    return off < ALIKE * sum(float(part.sum()) for part in first.values())


def slate(number: int, pictures: Pictures) -> dict[str, Counts]:
    """A picture's number, as marks that the first of its projectors shows; the others show black."""
    lit, slates = min(pictures), dict[str, Counts]()
    for name, picture in pictures.items():
        black = np.zeros(picture.shape, np.uint8)
        top = int(np.ceil(255 * SLATE_DRIVE * min(float(picture.max()), 1.0)))
        drawn = draw_shot_id(black, number, top, SLATE_CELLS) if name == lit else black
        slates[name] = drawn.astype(np.uint16) * (TOP // 255)
    return slates
