"""Light of a picture as planes: its limits, and how direct light becomes total light."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procam.arrays import Array, Array32, BoolArray, Image
from procam.compensate.fields import Fields
from procam.compensate.perceptual.descent import Problem
from procam.compensate.perceptual.objective import Contrast, Guard
from procam.kernels.frame.reference import monomials
from procam.maths.vision.pyramid import Pyramid
from procam.maths.warp import enlarged, reduced_to

DARKEST_SUM = 1e-30  # sr
LARGEST_FORM = 256  # px of the grid on which the polynomial of scattered light is evaluated


@dataclass(frozen=True, eq=False)
class FieldTransport:
    """Transport by fields: total = direct + spread (phi . G M) + lamps, M = sum_i a_i phi_i direct_i.

    Attributes
    ----------
    spread : (3, H, W). lamps : (3, H, W) light of the room's own lamps [rel]; or None.
    area : (H, W) weight of the pixels in M [sr]; 0 where none is lit.
    terms : (T, h, w) phi on a coarser grid. operator : (3, T, T) G.
    """

    spread: Array32
    lamps: Array32 | None
    area: Array32
    terms: Array
    operator: Array

    def moments(self, direct: Array32) -> Array:
        """M (3, T)."""
        return self._sums(direct * self.area)

    def scattered(self, moments: Array) -> Array32:
        """Scattered light, and the lamps' (3, H, W)."""
        form = np.einsum("cij,cj->ci", self.operator, moments)
        found = self._field(form) * self.spread
        return found if self.lamps is None else found + self.lamps

    def total(self, direct: Array32) -> Array32:
        """Total light (3, H, W)."""
        return direct + self.scattered(self.moments(direct))

    def adjoint(self, slope: Array32) -> Array32:
        """Slopes over direct light, from those over total light."""
        form = np.einsum("cji,cj->ci", self.operator, self._sums(slope * self.spread))
        return slope + self.area * self._field(form)

    def _sums(self, planes: Array32) -> Array:
        """Sums (3, T) of planes times phi."""
        count, height, width = self.terms.shape
        if count == 1:
            return planes.sum(axis=(1, 2), dtype=float)[:, None]
        pixels = planes[0].size / (height * width)
        means = [reduced_to(p, (height, width)) for p in planes]
        return np.einsum("chw,thw->ct", np.array(means, float), self.terms) * pixels

    def _field(self, form: Array) -> Array32:
        """Values of phi . form at the pixels (3, H, W); (3, 1, 1) if phi is 1."""
        if len(self.terms) == 1:
            return form[:, :, None].astype(np.float32)
        coarse = np.tensordot(form, self.terms, 1).astype(np.float32)
        return np.array([enlarged(plane, self.area.shape) for plane in coarse])


@dataclass(frozen=True, eq=False)
class Stage:
    """What pictures of one size are shown on.

    Attributes
    ----------
    lo, hi : (3, H, W) limits of direct light [rel]. weight : (H, W) of the pixels for the eye, summing to
        1; 0 where nothing is lit or content is sent unchanged.
    transport : of the light. pixels_per_degree : at the eyepoint.
    kept : (H, W) where content is sent unchanged, or None.
    """

    lo: Array32
    hi: Array32
    weight: Array32
    transport: FieldTransport
    pixels_per_degree: float
    kept: BoolArray | None = None

    @cached_property
    def levels(self) -> Pyramid:
        """Of its pictures."""
        return Pyramid((self.weight > 0).astype(np.float32), self.pixels_per_degree)

    def problem(self, target: Array32, white_nits: float) -> Problem:
        """To show a target (3, H, W)."""
        counted = target * (self.weight > 0)
        contrast = Contrast(self.levels, counted, self.weight, white_nits)
        guard = Guard(counted, self.weight, white_nits)
        return Problem(contrast, guard, self.transport, *self.limits(target))

    def limits(self, target: Array32) -> tuple[Array32, Array32]:
        """Least and most direct light (3, H, W): the target itself where it is sent unchanged."""
        if self.kept is None:
            return self.lo, self.hi
        sent = np.clip(target, self.lo, self.hi)
        lo, hi = (np.where(self.kept, sent, limit) for limit in (self.lo, self.hi))
        return lo, hi


def dome_stage(fields: Fields, top: float = np.inf) -> Stage:
    """A dome for pictures of the fields' size; nothing is sent brighter than `top` [rel]."""
    shown = fields.shown
    area = fields.at_pixels(shown.solid_angle_sr)
    chosen = area > 0 if fields.protected is None else (area > 0) & ~fields.protected
    weight = np.where(chosen, area, 0)
    form = min(shown.size, LARGEST_FORM)
    direction, _ = fields.canvas.planes(form)
    transport = FieldTransport(
        spread=planes(fields.at_pixels(shown.spread)) * chosen,
        lamps=None if shown.ambient is None else planes(fields.at_pixels(shown.ambient)) * chosen,
        area=area,
        terms=monomials(direction, shown.terms),
        operator=fields.operator,
    )
    assert shown.hi is not None
    lo, hi = (planes(fields.at_pixels(limit)) * (area > 0) for limit in (shown.lo, shown.hi))
    return Stage(
        lo=lo,
        hi=np.maximum(np.minimum(hi, np.float32(top)), lo),
        weight=(weight / max(weight.sum(dtype=float), DARKEST_SUM)).astype(np.float32),
        transport=transport,
        pixels_per_degree=shown.size / float(np.degrees(fields.canvas.fov)),
        kept=fields.protected,
    )


def planes(picture: Image) -> Array32:
    """A picture (H, W, 3) as planes (3, H, W)."""
    return np.ascontiguousarray(np.moveaxis(picture, -1, 0), np.float32)


def interleaved(found: Array32) -> Image:
    """Planes (3, H, W) as a picture (H, W, 3)."""
    return np.ascontiguousarray(np.moveaxis(found, 0, -1))
