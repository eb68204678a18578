"""Compensation on the canvas of a room of any shape: (P) of docs/theory/compensation.md, (C2).

The unknown is the irradiance of every face. It determines the scattered light of every pixel, hence the light
to send, hence the irradiance again: a fixed point. A step costs one product with the form factors and one
pass over the picture.
"""

from collections.abc import Callable
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
        self._given = albedo, hi
        self._albedo = albedo.astype(np.float32)
        self._of_pixels = np.where(canvas.lit[..., None], self._albedo[canvas.face], np.float32(0))
        lit = canvas.lit[..., None]
        self._lo, self._hi = (np.where(lit, np.float32(x), np.float32(0)) for x in (lo, hi))

    def with_black(self, lo: Image | float) -> "RoomCompensator":
        """The same with another least light."""
        albedo, hi = self._given
        return RoomCompensator(self.canvas, self._factors, albedo, lo, hi)

    def exact(self, target: Image) -> RoomPicture:
        """(P): the observed light is the target (H, W, 3) [rel] wherever no limit holds."""
        irradiance = self._settled(lambda scattered: self._clipped(target - scattered))
        scattered = self._scattered(irradiance)
        direct = self._clipped(target - scattered)
        free = (direct > self._lo) & (direct < self._hi) & self.canvas.lit[..., None]
        return RoomPicture(direct, direct + scattered, free)

    def none(self, target: Image) -> RoomPicture:
        """The target itself, clamped, is sent."""
        direct = self._clipped(target)
        irradiance = self._settled(lambda _: direct)
        free = np.broadcast_to(self.canvas.lit[..., None], direct.shape)
        return RoomPicture(direct, direct + self._scattered(irradiance), free)

    def _settled(self, sent: Sent) -> Array32:
        """Irradiance (F, 3) of faces, where the light sent follows from the scattered light."""
        nothing = np.zeros(self._albedo.shape, np.float32)
        return fixed_point(partial(self._step, sent), nothing, TOLERANCE)

    def _step(self, sent: Sent, irradiance: Array32) -> Array32:
        direct = self.canvas.mean(sent(self._scattered(irradiance)))
        return self._factors.gather(direct + self._albedo * irradiance)

    def _scattered(self, irradiance: Array32) -> Image:
        return self._of_pixels * np.maximum(self.canvas.field(irradiance), 0)

    def _clipped(self, light: Image) -> Image:
        return np.clip(light, self._lo, self._hi)
