"""The equations of a compensated frame, solved by evaluations of the whole picture.

A frame is known once the moments of its direct light are: sums over the dome of light times the
monomials of the direction. They give the coefficients of the scattered light (`Fields.operator`);
content less scattered light, within its limits, is the direct light; its moments must be those assumed.
That makes 1, 4 or 9 unknowns per colour, twice as many for least squares (W). Each evaluation of the
residual reads the picture once (`kernels.frame`). `Root` starts from the last frame's solution and
slope, so that a slow pan takes two evaluations, and the second one already writes the result. The first
frame starts from the solution of a sample of its pixels, on the same sample of nodes.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, FloatArray, Image
from procam.compensate.fields import SAMPLE, Fields
from procam.compensate.solver import Root
from procam.errors import DidNotConverge
from procam.kernels.frame.api import frame_apply, frame_sums, scattered_light
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.model import TERMS, FrameModel
from procam.kernels.native.arrays import aligned_empty

CHANNELS = 3
TOLERANCE = 2e-9  # of the moments, relative: the resolution of double sums of single light
FIRST_SHRINK = 1e-3  # share of the residual that the first step should leave
TOLERANCES = {1: 1.5e-5, 2: 1e-6}  # for types of so many bytes: below their own quantisation


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """What is taken off a frame.

    Attributes
    ----------
    moments : (3, T) of the direct light, as assumed [rel sr].
    coefficients : (3, 9) of the polynomial of its scattered light.
    pull : (3, 9) of the polynomial by which (W) raises the direct light; None for other methods.
    """

    moments: Array
    coefficients: Array
    pull: Array | None = None

    @property
    def unknowns(self) -> Array:
        """(3, T), or (3, 2 T) with a pull: moments, then pull."""
        if self.pull is None:
            return self.moments
        return np.concatenate([self.moments, self.pull[:, : self.moments.shape[1]]], axis=1)


class NodeLight:
    """Scattered light at the nodes of one model, kept for the last solution asked for."""

    def __init__(self, model: FrameModel) -> None:
        self.model = model
        self._known: tuple[Solution, Image] | None = None

    def of(self, solution: Solution) -> Image:
        """Light (M, M, 3) [rel], in (W) less the pull. The next solution's light overwrites it."""
        if self._known is None or not _same(self._known[0], solution):
            buffer = None if self._known is None else self._known[1]
            light = scattered_light(self.model, solution.coefficients, solution.pull, buffer)
            self._known = solution, light
        return self._known[1]


class FrameEquations:
    """Solves frames one after the other, each from the solution of the one before.

    Parameters
    ----------
    fields : of the dome.
    method : see `Compensator`.
    albedo : (3,), for paper eq. 12.
    """

    def __init__(self, fields: Fields, method: str, albedo: Array) -> None:
        self.fields, self.method, self.albedo = fields, method, albedo
        self.model = _known_to(method, fields.model, albedo)
        same = fields.shown is fields.model
        self.shown = self.model if same else _known_to(method, fields.shown, albedo)
        self._light = NodeLight(self.model)
        self._shown_light = self._light if same else NodeLight(self.shown)
        self._root: Root | None = None  # of the last frame, if it was solved

    def restart(self) -> None:
        """Forget the last frame's solution, and the light that is kept of it."""
        self._root = None

    @property
    def nothing(self) -> Solution:
        """No scattered light."""
        return Solution(np.zeros((CHANNELS, self.model.terms)), np.zeros((CHANNELS, TERMS)))

    def light(self, solution: Solution) -> Image:
        """Scattered light (M, M, 3) at the nodes of `model` [rel], see `NodeLight.of`."""
        return self._light.of(solution)

    def shown_light(self, solution: Solution) -> Image:
        """The same for `shown`."""
        return self._shown_light.of(solution)

    def sums(self, content: AnyArray, solution: Solution, what: str, coding: Coding) -> Array:
        """Moments (3, T), see `kernels.frame.frame_sums`."""
        return frame_sums(self.model, content, self.light(solution), what, coding)

    def frame(
        self, content: AnyArray, coding: Coding, out: AnyArray | None
    ) -> tuple[AnyArray, Solution]:
        """Solve; the light to send, encoded as the content is, with its solution."""
        target = aligned_empty(content.shape, content.dtype) if out is None else out
        early = self.shown is self.model and not np.may_share_memory(content, target)
        solution, written = self.solve(content, coding, target if early else None)
        if not written:
            self.apply(content, coding, solution, target)
        return target, solution

    def apply(
        self, content: AnyArray, coding: Coding, solution: Solution, out: AnyArray | None
    ) -> AnyArray:
        """The light to send for a known solution, encoded as the content is."""
        return frame_apply(self.shown, content, self.shown_light(solution), coding, out)

    def solve(
        self, content: AnyArray, coding: Coding, target: AnyArray | None = None
    ) -> tuple[Solution, bool]:
        """The solution of a frame, and whether its picture was written to `target` on the way.

        The evaluation that is likely the last one writes there.
        """
        if self.method == "none":
            return self.nothing, False
        if self.method == "paper-eq12":
            flux = self.sums(content, self.nothing, "content", coding)
            return Solution(flux, np.pad(flux, ((0, 0), (0, TERMS - 1)))), False
        root, self._root = self._root or self._start(content, coding), None
        target = target if self.method == "exact" else None
        written: Array | None = None

        def residual(value: Array, last: bool) -> Array:
            nonlocal written
            if last:
                written = value.copy()
            solution = self._solution(value)
            return self.residual(content, coding, solution, target if last else None)

        def slope(value: Array) -> Array:
            return self._slope(self._solution(value), content, coding)

        root.follow(residual, slope, TOLERANCES.get(content.itemsize, TOLERANCE))
        self._root = root
        up_to_date = target is not None and np.array_equal(written, root.value)  # type: ignore[arg-type]
        return self._solution(root.value), up_to_date

    def residual(
        self, content: AnyArray, coding: Coding, solution: Solution, target: AnyArray | None = None
    ) -> Array:
        """Moments of the light sent less those assumed; in (W) also the optimal pull less the pull.

        (W) minimises sum a (y - t)^2 / 2, y = b0 + v mono.C m, under m = sum a mono b0. With pull l, the
        multiplier of that, b0 = clip(t - v mono.C m + mono.l) and l = -C^T sum a v mono (y - t).
        With a `target`, for (P) alone, the light is also written there.
        """
        if target is not None:
            sent = np.empty((CHANNELS, self.model.terms))
            frame_apply(self.model, content, self.light(solution), coding, target, sent)
            return sent - solution.moments
        what = "content" if self.method == "subtract" else "light"
        missed = self.sums(content, solution, what, coding) - solution.moments
        if solution.pull is None:
            return missed
        pull = solution.pull[:, : self.model.terms]
        error = self.sums(content, solution, "excess", coding)
        error = error + np.einsum("cij,cj->ci", self.fields.spread_gram, pull)
        optimal = -np.einsum("cji,cj->ci", self.fields.operator, error)
        return np.concatenate([missed, optimal - pull], axis=1)

    def _solution(self, value: Array) -> Solution:
        """The solution of unknowns (3, K)."""
        terms = self.model.terms
        moments = value[:, :terms]
        pull = None
        if self.method == "least-squares":
            pull = np.zeros((CHANNELS, TERMS))
            pull[:, :terms] = value[:, terms:]
        return Solution(moments, self.fields.coefficients_of(moments), pull)

    def _start(self, content: AnyArray, coding: Coding) -> Root:
        """The root of a sample of the picture; no light if the picture is small, or has no limits."""
        terms = self.model.terms * (2 if self.method == "least-squares" else 1)
        value = np.zeros((CHANNELS, terms))
        if self.method != "subtract" and self.model.size > SAMPLE:
            with suppress(DidNotConverge):  # the whole picture may have a solution
                sampled = self._pixels_of_sample(content)
                value = self._sample.solve(sampled, coding)[0].unknowns
        return Root(value, self._slope(self._solution(value), content, coding), FIRST_SHRINK)

    @cached_property
    def _sample(self) -> "FrameEquations":
        """The same equations for a sample of the nodes; a sample's equations return themselves."""
        sampled = self.fields.sampled()
        return self if sampled is self.fields else FrameEquations(sampled, self.method, self.albedo)

    def _pixels_of_sample(self, content: AnyArray) -> AnyArray:
        """Those (S, S, 3) of a picture."""
        return content[self.fields.sampled_pixels][:, self.fields.sampled_pixels]

    def _slope(self, solution: Solution, content: AnyArray, coding: Coding) -> Array:
        """Slope of the residual, from a sample."""
        return self._sample._slope_at_nodes(solution, self._pixels_of_sample(content), coding)

    def _slope_at_nodes(self, solution: Solution, content: AnyArray, coding: Coding) -> Array:
        """Slope of the residual of a picture (M, M, 3) with a pixel at each node."""
        fields, operator, terms = self.fields, self.fields.operator, self.model.terms
        free = self._free(solution, coding.decoded(content), coding.most(content.dtype))
        eye, spread = np.eye(terms), self.model.spread.astype(float)
        weighted = fields.products(free * spread)
        if self.method != "least-squares":
            return -(eye + weighted @ operator)
        transposed = operator.transpose(0, 2, 1)
        slope = np.empty((CHANNELS, 2 * terms, 2 * terms))
        slope[:, :terms, :terms] = -(eye + weighted @ operator)
        slope[:, :terms, terms:] = fields.products(free.astype(float))
        slope[:, terms:, :terms] = -transposed @ fields.products(~free * spread**2) @ operator
        slope[:, terms:, terms:] = -(eye + transposed @ weighted)
        return slope

    def _free(self, solution: Solution, content: FloatArray, top: float) -> BoolArray:
        """Nodes (M, M, 3) where no limit holds; white that is just reached is free: light is taken off it."""
        model = self.model
        if self.method == "subtract":
            return np.ones(model.spread.shape, bool)
        gain = 1 if model.gain is None else model.gain[..., None]
        wanted = content * gain - self.light(solution)
        hi = top if model.hi is None else np.minimum(model.hi, top)
        return np.asarray((wanted > model.lo) & (wanted <= hi))


def _same(a: Solution, b: Solution) -> bool:
    pulls = a.pull is b.pull or np.array_equal(a.pull, b.pull)  # type: ignore[arg-type]
    return pulls and np.array_equal(a.coefficients, b.coefficients)


def _known_to(method: str, model: FrameModel, albedo: Array) -> FrameModel:
    """A model as a method takes it; methods for comparison ignore the lamps."""
    if method == "none":
        return replace(model, ambient=None, spread=np.zeros_like(model.spread), terms=1)
    if method == "paper-eq12":
        flat = np.full_like(model.spread, albedo / (4 * np.pi))
        return replace(model, ambient=None, spread=flat, terms=1)
    return model
