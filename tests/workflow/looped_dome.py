"""A dome so small that `procam refine` takes seconds, and a picture for it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from tiny_venue import TINY_PAIR, quick_simulator

from procam.arrays import Image
from procam.estimate.closed_loop import picture_loop as closed_loop
from procam.maths.geometry.sphere import master_directions

MASTER, CELLS = 128, 48
SIZE = replace(TINY_PAIR, projector_size=(160, 100), camera_size=(256, 256), map_size=MASTER)


@contextmanager
def quick_loop() -> Iterator[None]:
    """Cells as wide as such a camera allows."""
    with quick_simulator(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed_loop, "LOOP_SIZE", CELLS)
        yield


def broad() -> Image:
    """A bright front, a dark rear: no detail that pixels of a degree would blur."""
    direction, inside = master_directions(MASTER)
    front = np.clip(1.5 * direction[..., 0] + 0.5, 0, 1)
    picture = 0.03 + 0.6 * front * front * (3 - 2 * front)
    return np.asarray((picture * inside)[..., None].repeat(3, axis=-1), np.float32)
