"""Perceptual targets of dome masters."""

import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.fields import Fields
from procam.compensate.perceptual.light import Stage, dome_stage
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import REDUCTION
from procam.compensate.perceptual.targets import SAMPLE, MovieTargets, Reached, StillTargets
from procam.errors import InputError

BYTES_PER_PIXEL = 450  # at most, of a still picture while it is solved


class DomeTargets:
    """Targets for content of one size, or of the frames of a movie in their order.

    Parameters
    ----------
    fields : of the dome. fields_of : the same for content of another size.
    """

    def __init__(
        self, fields: Fields, fields_of: Callable[[int], Fields], settings: Perceptual
    ) -> None:
        size = fields.shown.size
        if not settings.video:
            _check_memory(size)

        def stage(edge: int) -> Stage:
            return dome_stage(fields if edge == size else fields_of(edge), edge)

        small = stage(max(size // REDUCTION, 2))
        self._targets: StillTargets | MovieTargets
        if settings.video:
            self._targets = MovieTargets(small, stage(min(size, SAMPLE)), settings)
        else:
            self._targets = StillTargets(stage(size), small, settings)
        self._kept = fields.protected
        gain = fields.shown.gain
        self._gain = None if gain is None else fields.at_pixels(gain)[..., None]

    def of(self, content: Image, exact_moments: Array, reachable: bool) -> Reached:
        """What (P) is to solve in place of content (N, N, 3) in linear light.

        `exact_moments` (3, T) are those of the content's own exact solution, which is `reachable` if no limit
        holds in it.
        """
        if reachable:
            return Reached(content)
        wanted = content if self._gain is None else content * self._gain
        found = self._targets.of(wanted, exact_moments)
        if found.share == 0:
            return Reached(content)
        target = found.target
        if self._gain is not None:
            target = np.where(self._gain > 0, target / np.maximum(self._gain, 1e-9), target)
        if self._kept is not None:
            target = np.where(self._kept[..., None], content, target)
        return replace(found, target=np.ascontiguousarray(target, np.float32))


def _check_memory(size: int) -> None:
    """Refuse a still picture that would not fit in memory, which ends a process without a word."""
    needed, there = size**2 * BYTES_PER_PIXEL, physical_memory()
    if needed > there:
        raise InputError(
            f"method perceptual: pictures of {size} px need about {needed / 1e9:.0f} GB of memory, and this "
            f"computer has {there / 1e9:.0f}; use perceptual-video, which needs a tenth of that"
        )


def physical_memory() -> float:
    """Of this computer [bytes]; infinite if the system does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float("inf")
