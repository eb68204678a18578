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

BYTES_PER_PIXEL = 550  # at most, of a still picture while it is solved
LEAST_GAIN = 1e-9


class DomeTargets:
    """Targets for content of one size, or of the frames of a movie in their order.

    Parameters
    ----------
    fields : of the dome. fields_of : the same for content of another size.
    """

    def __init__(
        self, fields: Fields, fields_of: Callable[[int], Fields], settings: Perceptual
    ) -> None:
        if not settings.video:
            _check_memory(fields.shown.size)
        self._fields, self._fields_of, self._settings = fields, fields_of, settings
        self._by_top = dict[float, StillTargets | MovieTargets]()
        gain = fields.shown.gain
        self._gain = None if gain is None else fields.at_pixels(gain)[..., None]
        kept = fields.protected
        self._kept = None if kept is None else kept[..., None]

    def of(self, content: Image, exact_moments: Array, top: float, reachable: bool) -> Reached:
        """What (P) is to solve in place of content (N, N, 3) in linear light.

        `exact_moments` (3, T) are those of the content's own exact solution, which is `reachable` if no limit
        holds in it. `top` is the most light that its type can send [rel].
        """
        if reachable:
            return Reached(content)
        wanted = np.maximum(content if self._gain is None else content * self._gain, 0)
        if self._kept is not None:
            wanted = np.where(self._kept, content, wanted)
        found = self._targets(top).of(wanted, exact_moments)
        if found.share == 0:
            return Reached(content)
        target = found.target
        if self._gain is not None:
            target = np.where(self._gain > 0, target / np.maximum(self._gain, LEAST_GAIN), target)
        if self._kept is not None:
            target = np.where(self._kept, content, target)
        return replace(found, target=np.ascontiguousarray(target, np.float32))

    def restart(self) -> None:
        """Forget the frames before."""
        self._by_top.clear()

    def _targets(self, top: float) -> StillTargets | MovieTargets:
        """For content that can send `top`."""
        if top not in self._by_top:
            self._by_top[top] = self._new_targets(top)
        return self._by_top[top]

    def _new_targets(self, top: float) -> StillTargets | MovieTargets:
        size = self._fields.shown.size

        def stage(edge: int) -> Stage:
            return dome_stage(self._fields if edge == size else self._fields_of(edge), top)

        small = stage(max(size // REDUCTION, 2))
        if self._settings.video:
            return MovieTargets(small, stage(min(size, SAMPLE)), self._settings)
        return StillTargets(stage(size), small, self._settings)


def _check_memory(size: int) -> None:
    """Refuse a still picture that would not fit in memory, which ends a process without a word."""
    needed, there = size**2 * BYTES_PER_PIXEL, physical_memory()
    if needed > there:
        raise InputError(
            f"method perceptual: pictures of {size} px need about {needed / 1e9:.0f} GB of memory, and this "
            f"computer has {there / 1e9:.0f}; use perceptual-video, which needs a tenth of that"
        )


def physical_memory() -> float:
    """Of this computer [bytes]; infinite where the system has no such figure."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float("inf")
