"""The fields of a calibration for the frame kernels, and the operator of scattered light.

A calibration has maps on a dome master: scatter per flux, limits, coverage. They are sampled at the nodes
of the frame model, and continued some nodes beyond the lit part, where interpolation at its border reads.
Scattered light is a field `spread` times a polynomial q of the direction, with q = G M for the moments M
of the direct light; G (`operator`) is the calibration's kernel in terms of monomials.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, FloatArray, Image, IndexArray, Map
from procam.compensate._continuation import WELL_LIT, continue_fields, lit_part
from procam.errors import InputError
from procam.kernels.frame.api import scattered_light
from procam.kernels.frame.model import TERMS, FrameModel
from procam.kernels.frame.reference import ROWS, interpolated, monomials
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import direction_from_angles, master_pixels
from procam.maths.light.scatter_kernel import basis
from procam.model.calibration import Calibration
from procam.model.transport import ScatterKernel, ScreenMaps

WHITES = ("summed", "keep")
CHANNELS = 3
GOLDEN = 0.6180339887498949  # golden ratio: its multiples are uniform modulo 1
SAMPLE = 128  # pixels along the edge of a sample, at most
DARKEST = 1e-3  # gain beyond the lit part, where it may be 0 [-]


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields of a calibration on a dome master of M x M nodes, and the operator of scattered light.

    Attributes
    ----------
    shown : the model for pictures; its `spread` is v, so that the scattered light at a place is
        v (q . mono(direction)), see `kernels.frame`. It has `hi`.
    model : the model for sums, in which protected content is sent unchanged.
    operator : (3, T, T) per colour, from moments of direct light (`kernels.frame.frame_sums`) to q.
    protected : (N, N) where content is sent unchanged, or None. canvas : that of the pictures.
    """

    shown: FrameModel
    model: FrameModel
    operator: Array
    protected: BoolArray | None
    canvas: Canvas = STANDARD

    @classmethod
    def of(
        cls, calibration: Calibration, size: int, state: str | None = None, white: str = "summed"
    ) -> "Fields":
        """Fields for content of `size`, in a venue state, under a white.

        Parameters
        ----------
        white : luminance of content value 1.0. "summed": the white that every place can reach. "keep":
            today's full white, scattered light included, which only small bright objects can reach.

        Raises
        ------
        InputError
            An unknown white or state.
        """
        if white not in WHITES:
            raise InputError(f"white: {white!r} is unknown; choose {' or '.join(WHITES)}")
        shown, canvas = _model(calibration, size, state), calibration.dome_canvas
        protected = _protected(calibration.maps, canvas, size)
        fields = cls(shown, shown, _operator(calibration), protected, canvas)
        if white == "keep":
            gain = fields.todays_white() * (1 if shown.gain is None else shown.gain)
            uniform = np.broadcast_to(gain, shown.coverage.shape).astype(np.float32)
            shown = replace(shown, gain=uniform)
        if fields.protected is None:
            return replace(fields, shown=shown, model=shown)
        return replace(fields, shown=shown, model=_untouched(shown, calibration.maps, canvas))

    def coefficients_of(self, moments: Array) -> Array:
        """Coefficients q (3, 9) of scattered light for moments (3, T) [rel sr] of direct light."""
        found = np.zeros((CHANNELS, TERMS))
        found[:, : self.model.terms] = np.einsum("cij,cj->ci", self.operator, moments)
        return found

    def todays_white(self) -> float:
        """Total light of the full-white picture as it is today, of the darkest colour [rel]."""
        model = self.shown
        gain = np.ones_like(model.coverage) if model.gain is None else model.gain
        assert model.hi is not None
        total = self._total(np.clip(gain[..., None], model.lo, model.hi).astype(float))
        area = model.solid_angle_sr.astype(float)
        totals = np.tensordot(area, total, 2) / np.tensordot(area, gain.astype(float), 2)
        return float(totals.min())

    @cached_property
    def full_white(self) -> Image:
        """(N, N, 3) total light with all projectors at full drive, the most that (W) aims for [of content].

        A sun of 1e5 cannot be shown; the square of its error would light the whole dome.
        """
        model = self.shown
        assert model.hi is not None
        total = self._total(model.hi.astype(float))
        if model.gain is not None:
            total = total / np.maximum(model.gain, DARKEST)[..., None]
        return self.at_pixels(total)

    def at_pixels(self, field: AnyArray) -> Image:
        """A field at the nodes (M, M[, 3]), interpolated to the picture (N, N[, 3])."""
        model = self.shown
        found = np.empty((model.size, model.size, *field.shape[2:]), np.float32)
        for start in range(0, model.size, ROWS):
            rows = slice(start, start + ROWS)
            found[rows] = interpolated(model, field, rows)
        return found

    def _total(self, direct: Array) -> Array:
        """Total light (M, M, 3) for direct light at the nodes [rel]."""
        return direct + scattered_light(self.shown, self.coefficients_of(self.node_sums(direct)))

    def node_sums(self, values: Array) -> Array:
        """Moments (3, T) of values (M, M, 3), from nodes alone."""
        terms = monomials(self.model.direction, self.model.terms)
        per_pixel = (self.model.size / self.model.nodes) ** 2
        weight = self.model.solid_angle_sr.astype(float) * per_pixel
        return np.asarray(np.einsum("yx,yxc,kyx->ck", weight, values, terms, optimize=True))

    @cached_property
    def sampled_pixels(self) -> IndexArray:
        """Rows (S,) of a picture, and columns: one of every few, irregularly: content may be periodic."""
        size = self.model.size
        step = -(-size // SAMPLE)
        first = np.arange(0, size, step)
        place = step * (GOLDEN * np.arange(len(first)) % 1)
        return np.minimum(first + place.astype(np.intp), size - 1)

    def sampled(self) -> "Fields":
        """The fields of `model` at the nodes nearest to `sampled_pixels`, for pictures of those.

        Their solid angles add up to those of the dome. Returns self if all nodes are in the sample.
        """
        model = self.model
        at = self.sampled_pixels * model.nodes // model.size
        if len(at) == model.nodes == model.size:
            return self
        names = ("spread", "lo", "hi", "ambient", "gain", "coverage")
        found: dict[str, Any] = {n: getattr(model, n) for n in names}
        found = {n: None if f is None else f[at][:, at] for n, f in found.items()}
        area = model.solid_angle_sr[at][:, at]
        share = model.solid_angle_sr.sum() / max(area.sum(), 1e-30)
        area *= share * (model.size / model.nodes) ** 2
        direction = model.direction[:, at][:, :, at]
        small = replace(model, size=len(at), solid_angle_sr=area, direction=direction, **found)
        return Fields(small, small, self.operator, None, self.canvas)

    @cached_property
    def gram(self) -> Array:
        """(T, T): moments of the monomials themselves [sr]."""
        return self.products(np.ones((*self.model.coverage.shape, 1)))[0]

    @cached_property
    def spread_gram(self) -> Array:
        """(3, T, T): the same, weighted with `spread`."""
        return self.products(self.model.spread.astype(float))

    def products(self, weights: Array) -> Array:
        """(C, T, T): moments [sr] of the monomials times one another, with weights (M, M, C)."""
        terms = monomials(self.model.direction, self.model.terms).reshape(self.model.terms, -1)
        weight = self.model.solid_angle_sr.astype(float).ravel()
        weight *= (self.model.size / self.model.nodes) ** 2
        each = [(terms * (weight * p)) @ terms.T for p in weights.reshape(-1, weights.shape[-1]).T]
        return np.array(each)


def _model(calibration: Calibration, size: int, state: str | None) -> FrameModel:
    maps = calibration.maps
    nodes = min(size, maps.size)
    direction, area = calibration.dome_canvas.planes(nodes)
    where = None
    if nodes != maps.size or calibration.canvas != STANDARD:
        where = master_pixels(np.moveaxis(direction, 0, -1), maps.size)
    coverage = _at_nodes(maps.coverage, where) * (area > 0)
    lit = coverage > 0
    lit_colours = np.repeat(lit, CHANNELS).reshape(*lit.shape, CHANNELS)
    lo, hi = (lit_part(_at_nodes(limit, where), lit_colours) for limit in (maps.lo, maps.hi))
    _unfade(hi, lo, coverage)
    gain = None if maps.falloff is None else lit_part(_at_nodes(maps.falloff, where), lit)
    bare = FrameModel(
        size=size,
        spread=np.ones_like(lo),
        lo=lo,
        hi=hi,
        ambient=None,
        gain=gain,
        coverage=coverage,
        solid_angle_sr=area * np.float32((nodes / size) ** 2) * coverage,
        direction=direction,
        terms=(maps.kernel.degree + 1) ** 2,
    )
    scatter, ambient = _scatter(calibration, where, state)
    profile = _profile_at_nodes(bare, maps.kernel)
    spread = np.divide(scatter, profile, out=profile)
    np.copyto(spread, 0, where=~lit_colours)
    continue_fields([f for f in (spread, lo, hi, gain) if f is not None], coverage)
    return replace(bare, spread=spread, ambient=ambient)


def _unfade(hi: Map, lo: Map, coverage: Map) -> None:
    """Raise limits that coverage fades over the border: what is lit at all can be driven to full there."""
    fades = (coverage > 0) & (coverage < 1)
    hi[fades] /= np.maximum(coverage[fades], np.float32(WELL_LIT))[:, None]
    np.maximum(hi, lo, out=hi)


def _at_nodes(field: Map, where: FloatArray | None) -> Map:
    """A map sampled at `where`, or the map itself."""
    if where is None:
        return field
    from procam.maths.warp import sample  # noqa: PLC0415 - OpenCV takes a tenth of the time to a first pixel

    return sample(field, where)


def _untouched(shown: FrameModel, maps: ScreenMaps, canvas: Canvas) -> FrameModel:
    """A model in which protected content is sent unchanged."""
    direction, _ = canvas.directions(shown.nodes)
    kept = maps.is_protected(master_pixels(direction, maps.size))
    none = np.float32(0)
    ambient = None if shown.ambient is None else np.where(kept[..., None], none, shown.ambient)
    gain = None if shown.gain is None else np.where(kept, np.float32(1), shown.gain)
    spread = np.where(kept[..., None], none, shown.spread)
    return replace(shown, spread=spread, ambient=ambient, gain=gain)


def _protected(maps: ScreenMaps, canvas: Canvas, size: int) -> BoolArray | None:
    """Where (N, N) content is sent unchanged; None if nowhere."""
    if maps.protected is None:  # a large master's directions take seconds
        return None
    direction, inside = canvas.directions(size)
    every = maps.is_protected(master_pixels(direction, maps.size)) & inside
    return every if every.any() else None


def _scatter(
    calibration: Calibration, where: FloatArray | None, state: str | None
) -> tuple[Map, Map | None]:
    """Scatter per flux (M, M, 3) [1/sr] and the lamps' light, or None, in a venue state."""
    scatter = _at_nodes(calibration.maps.scatter_per_flux, where)
    if state is None:
        return scatter, None
    condition = calibration.state(state)
    ambient = None if condition.ambient is None else _at_nodes(condition.ambient, where)
    return scatter * condition.scatter_ratio.astype(np.float32), ambient


def _profile_at_nodes(bare: FrameModel, kernel: ScatterKernel) -> Image:
    """The polynomial (M, M, 3) of scattered light under full white; `bare` has a spread of ones."""
    profile = np.zeros((CHANNELS, TERMS))
    profile[:, : bare.terms] = kernel.profile @ _harmonics(kernel.degree).T
    return scattered_light(bare, profile)


def _operator(calibration: Calibration) -> Array:
    """(3, T, T) A B A^T, A as in `_harmonics`."""
    change = _harmonics(calibration.maps.kernel.degree)
    return np.asarray(change @ calibration.maps.kernel.matrix @ change.T)


def _harmonics(degree: int) -> Array:
    """A (T, T): the functions of `maths.scatter_kernel` are A^T times the monomials."""
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 12, endpoint=False), np.linspace(-1, 1, 9))
    direction = direction_from_angles(turn.ravel(), np.arcsin(height.ravel()))
    mono = monomials(direction.T, (degree + 1) ** 2).T
    return np.asarray(np.linalg.lstsq(mono, basis(direction, degree), rcond=None)[0])
