"""Compensation on the canvas of a room of any shape: (P) of docs/theory/compensation.md, (C2).

The unknown is the irradiance of every face. It determines the scattered light of every pixel, hence the light
to send, hence the irradiance again: a fixed point. A step costs one product with the form factors and one
pass over the picture.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np

from procam.arrays import Array, Array32, BoolArray, Image
from procam.errors import InputError, ShapeError
from procam.maths.fixed_point import fixed_point
from procam.maths.mesh.canvas import MeshCanvas
from procam.maths.mesh.compressed import CompressedFactors

Sent = Callable[[Image], Image]  # light to send, from scattered light
TOLERANCE = 1e-5  # of the brightest irradiance
BRIGHTEST = 0.999  # albedo: a room must lose light


@dataclass(frozen=True, slots=True)
class RoomPicture:
    """A picture (H, W, 3) on a canvas, 0 off the screen.

    `direct` light of the projectors, `observed` with inter-reflections [rel]; `free` : no limit holds.
    """

    direct: Image
    observed: Image
    free: BoolArray


class RoomCompensator:
    """Compensates pictures on one canvas.

    Parameters
    ----------
    canvas, factors : of one mesh.
    albedo : (F, 3) of its faces [-].
    lo, hi : least and most direct light of a lit place [rel], numbers or (H, W, 3).

    Raises
    ------
    InputError
        An albedo that is none, or limits that cross.
    """

    def __init__(
        self,
        canvas: MeshCanvas,
        factors: CompressedFactors,
        albedo: Array,
        lo: Image | float = 0.0,
        hi: Image | float = 1.0,
    ) -> None:
        if albedo.shape != (len(factors.area), 3):
            raise ShapeError("albedo", albedo.shape, f"({len(factors.area)}, 3)")
        if not ((albedo >= 0) & (albedo <= BRIGHTEST)).all():
            raise InputError(
                f"albedo: {albedo.min():g} to {albedo.max():g}; 0 to {BRIGHTEST:g} are needed"
            )
        if np.any(np.asarray(lo) > np.asarray(hi)):
            raise InputError("lo and hi: lo is above hi; are they swapped?")
        self.canvas, self._factors = canvas, factors
        self._albedo = albedo.astype(np.float32)
        lit = canvas.lit[..., None]
        self._paint = np.where(lit, self._albedo[canvas.face], np.float32(0))
        self._held: BoolArray | None = None
        self._lo, self._hi = (np.where(lit, np.float32(x), np.float32(0)) for x in (lo, hi))

    @property
    def limits(self) -> tuple[Image, Image]:
        """Least and most direct light (H, W, 3)."""
        return self._lo, self._hi

    def with_black(self, lo: Image | float) -> "RoomCompensator":
        """The same with another least light."""
        other = copy(self)
        other._lo = np.where(self.canvas.lit[..., None], np.float32(lo), np.float32(0))
        return other

    def with_paint(self, albedo: Image, held: BoolArray) -> "RoomCompensator":
        """The same with the albedo (H, W, 3) of each pixel; `held` (H, W) are sent the content itself."""
        other = copy(self)
        other._paint, other._held = albedo, held if held.any() else None
        return other

    def limited(self, top: float) -> "RoomCompensator":
        """The same with light of `top` at most."""
        other = copy(self)
        other._hi = np.minimum(self._hi, np.float32(top))
        return other

    def exact(self, target: Image, start: Array32 | None = None) -> RoomPicture:
        """(P): the observed light is the target (H, W, 3) [rel] wherever no limit holds.

        `start` (F, 3) is an irradiance near that of the result, which saves most of the time.
        """
        sent = partial(self._sent, target)
        irradiance = self._settled(sent, start)
        scattered = self._scattered(irradiance)
        direct = sent(scattered)
        free = (direct > self._lo) & (direct < self._hi) & self.canvas.lit[..., None]
        return RoomPicture(direct, direct + scattered, free)

    def irradiance(self, target: Image) -> Array32:
        """Irradiance (F, 3) of (P)."""
        return self._settled(partial(self._sent, target))

    def none(self, target: Image) -> RoomPicture:
        """The target itself, clamped, is sent."""
        direct = self._clipped(target)
        light = self.canvas.mean(direct)
        irradiance = fixed_point(
            lambda e: self._factors.gather(light + self._albedo * e), self._nothing, TOLERANCE
        )
        free = np.broadcast_to(self.canvas.lit[..., None], direct.shape)
        return RoomPicture(direct, direct + self._scattered(irradiance), free)

    @property
    def _nothing(self) -> Array32:
        return np.zeros(self._albedo.shape, np.float32)

    def _settled(self, sent: Sent, start: Array32 | None = None) -> Array32:
        """Irradiance (F, 3) of faces, where the light sent follows from the scattered light."""
        first = self._nothing if start is None else start
        return fixed_point(partial(self._step, sent), first, TOLERANCE)

    def _step(self, sent: Sent, irradiance: Array32) -> Array32:
        direct = self.canvas.mean(sent(self._scattered(irradiance)))
        return self._factors.gather(direct + self._albedo * irradiance)

    def _scattered(self, irradiance: Array32) -> Image:
        scattered = self.canvas.field(irradiance)
        np.maximum(scattered, 0, out=scattered)
        scattered *= self._paint
        return scattered

    def _sent(self, target: Image, scattered: Image) -> Image:
        direct = np.subtract(target, scattered, dtype=np.float32)
        np.clip(direct, self._lo, self._hi, out=direct)
        if self._held is not None:
            direct[self._held] = self._clipped(target)[self._held]
        return direct

    def _clipped(self, light: Image) -> Image:
        return np.clip(light, self._lo, self._hi)
