"""The equations of a compensated frame, and their solution by looks at the whole picture."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.fields import Fields, NodeSample
from procam.compensate.solver import Root
from procam.kernels.frame import (
    TERMS,
    FrameModel,
    bounced_light,
    frame_apply,
    frame_sums,
)
from procam.kernels.frame.coding import Coding
from procam.kernels.native.arrays import aligned_like

Array = NDArray[np.float64]
Image = NDArray[np.float32]
CHANNELS = 3
TOLERANCE = 2e-9  # of the moments, relative: what double sums of single light resolve
TOLERANCES = {1: 1.5e-5, 2: 1e-6}  # of types of so many bytes: their own steps show nothing of it


class Equations:
    """Numbers of a frame's bounced light: solved, kept for the next frame, applied.

    Parameters
    ----------
    fields : of the dome.
    method : see `Compensator`.
    albedo : (3,), which paper eq. 12 goes by.
    """

    def __init__(self, fields: Fields, method: str, albedo: Array) -> None:
        self.fields, self.method = fields, method
        self.model = _known_to(method, fields.model, albedo)
        same = fields.shown is fields.model
        self.shown = self.model if same else _known_to(method, fields.shown, albedo)
        self.solution = np.zeros((2, CHANNELS, TERMS))  # q, and what (W) takes off
        self._made: dict[bool, tuple[Array, Image]] = {}  # light of the last look, and for what
        self._root: Root | None = None  # of the last frame
        self._written: Array | None = None  # solution under which the picture at hand is written

    def light(self, model: FrameModel) -> Image:
        """What bounces to each node (M, M, 3) of `model` or `shown` [rel]; in (W) less what it pulls.

        The next solution's light is written over it.
        """
        which = model is self.model
        known, room = self._made.get(which, (None, None))
        if known is None or (known != self.solution).any():
            offset = self.solution[1] if self.method == "least-squares" else None
            light = bounced_light(model, self.solution[0], offset, room)
            self._made[which] = self.solution.copy(), light
        return self._made[which][1]

    def sums(self, content: NDArray[Any], light: Image, what: str, coding: Coding) -> Array:
        """Moments (3, T), see `kernels.frame.frame_sums`."""
        return frame_sums(self.model, content, light, what, coding)

    def _light_sums(
        self, content: NDArray[Any], coding: Coding, target: NDArray[Any] | None
    ) -> Array:
        """Moments (3, T) of the light to send; it is written to `target`, if there is one."""
        light = self.light(self.model)
        if target is None:
            return self.sums(content, light, "light", coding)
        self._written = self.solution.copy()
        found = np.empty((CHANNELS, self.model.terms))
        frame_apply(self.model, content, light, coding, target, found)
        return found

    def frame(
        self, content: NDArray[Any], coding: Coding, out: NDArray[Any] | None
    ) -> NDArray[Any]:
        """Solve, and write the light to send, encoded as the content is.

        The look that is likely the last one writes already.
        """
        target = aligned_like(content) if out is None else out
        early = self.shown is self.model and not np.may_share_memory(content, target)
        self.solve(content, coding, target if early else None)
        if self._written is None or (self._written != self.solution).any():
            self.apply(content, coding, target)
        return target

    def apply(
        self, content: NDArray[Any], coding: Coding, out: NDArray[Any] | None
    ) -> NDArray[Any]:
        """The light to send, encoded as the content is."""
        return frame_apply(self.shown, content, self.light(self.shown), coding, out)

    def solve(
        self, content: NDArray[Any], coding: Coding, target: NDArray[Any] | None = None
    ) -> None:
        """Find the numbers of a frame, from those of the last; looks may write to `target`."""
        self._written = None
        if self.method in ("none", "paper-eq12"):
            self.solution = np.zeros((2, CHANNELS, TERMS))
            if self.method == "paper-eq12":
                self.solution[0, :, :1] = self.sums(
                    content, self.light(self.model), "content", coding
                )
            return
        root = self._root or self._begun(content, coding)
        self._root = None  # unless this frame is solved, the next does not start from here
        root.follow(
            lambda value, last: self._residual(value, content, coding, target if last else None),
            lambda value: self._slope(value, content, coding),
            TOLERANCES.get(content.itemsize, TOLERANCE),
        )
        self._root = root
        self._use(root.value)

    def _use(self, value: Array) -> None:
        """Numbers of moments (3, T), and in (W) of what they pull."""
        terms = self.model.terms
        self.solution[0] = self.fields.numbers_of(value[:, :terms])
        self.solution[1, :, :terms] = value[:, terms:] if value.shape[1] > terms else 0

    def left(self, content: NDArray[Any], sent: Array, coding: Coding) -> Array:
        """What the solution leaves of the equations of its optimum; `sent` are moments of its light."""
        if self.method != "least-squares":
            return sent - self.assumed()
        assert self._root is not None
        return self._residual(self._root.value, content, coding)

    def assumed(self) -> Array:
        """Moments (3, T) that the last solution takes for those of the light sent."""
        if self.method in ("none", "paper-eq12"):
            return self.solution[0, :, : self.model.terms]
        assert self._root is not None
        return self._root.value[:, : self.model.terms]

    def _residual(
        self,
        value: Array,
        content: NDArray[Any],
        coding: Coding,
        target: NDArray[Any] | None = None,
    ) -> Array:
        """Moments of the light sent less those assumed; in (W) also the pull less what it must be.

        (W) minimises sum a (y - t)^2 / 2, y = b0 + v mono.C m, under m = sum a mono b0. With pull l, the
        multiplier of that, b0 = clip(t - v mono.C m + mono.l) and l = -C^T sum a v mono (y - t).
        """
        terms = self.model.terms
        self._use(value)
        if self.method == "exact":
            return self._light_sums(content, coding, target) - value
        light = self.light(self.model)
        what = "content" if self.method == "subtract" else "light"
        left = self.sums(content, light, what, coding) - value[:, :terms]
        if self.method == "subtract":
            return left
        pull = value[:, terms:]
        error = self.sums(content, light, "excess", coding)
        error = error + np.einsum("cij,cj->ci", self.fields.painted_gram, pull)
        asked = -np.einsum("cji,cj->ci", self.fields.operator, error)
        return np.concatenate([left, asked - pull], axis=1)

    def _begun(self, content: NDArray[Any], coding: Coding) -> Root:
        """No light, and the slope there."""
        terms = self.model.terms * (2 if self.method == "least-squares" else 1)
        value = np.zeros((CHANNELS, terms))
        return Root(value, self._slope(value, content, coding))

    @cached_property
    def _sample(self) -> NodeSample:
        return NodeSample.of(self.model)

    def _slope(self, value: Array, content: NDArray[Any], coding: Coding) -> Array:
        """Slope of the residual, by the places of a sample that no limit holds."""
        self._use(value)
        sample = self._sample
        free = np.ones(sample.shape, bool)
        if self.method != "subtract":
            free = sample.free(
                self.model,
                coding.decoded(sample.of_picture(content)),
                self.light(self.model),
                coding.most(content.dtype),
            )
        return self._slope_of(free)

    def _slope_of(self, free: NDArray[np.bool_]) -> Array:
        sample, operator, terms = self._sample, self.fields.operator, self.model.terms
        eye = np.eye(terms)
        painted = sample.products(free, 1)
        if self.method != "least-squares":
            return -(eye + painted @ operator)
        transposed = operator.transpose(0, 2, 1)
        slope = np.empty((CHANNELS, 2 * terms, 2 * terms))
        slope[:, :terms, :terms] = -(eye + painted @ operator)
        slope[:, :terms, terms:] = sample.products(free, 0)
        slope[:, terms:, :terms] = -transposed @ sample.products(~free, 2) @ operator
        slope[:, terms:, terms:] = -(eye + transposed @ painted)
        return slope


def _known_to(method: str, model: FrameModel, albedo: Array) -> FrameModel:
    """A model as a method knows it; those for comparison know of no lamps."""
    if method == "none":
        return replace(model, ambient=None, spread=np.zeros_like(model.spread), terms=1)
    if method == "paper-eq12":
        flat = np.full_like(model.spread, albedo / (4 * np.pi))
        return replace(model, ambient=None, spread=flat, terms=1)
    return model
