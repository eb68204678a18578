"""Compensation of dome masters: exact (P), least squares (W), and what they are compared with."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.fields import Fields
from procam.compensate.solver import Root
from procam.errors import InputError, ShapeError
from procam.kernels.frame import (
    TERMS,
    WHOLE,
    Coding,
    FrameModel,
    bounced_light,
    frame_apply,
    frame_sums,
)
from procam.kernels.reference_frame import interpolated
from procam.maths.dither import threshold_tile
from procam.maths.transfer import transfer
from procam.model.calibration import Calibration

Array = NDArray[np.float64]
Image = NDArray[np.float32]
METHODS = ("exact", "subtract", "least-squares", "paper-eq12", "none")
CHANNELS = 3
TOLERANCE = 2e-9  # of the moments, relative: what double sums of single light resolve
TOLERANCE_8_BIT = 5e-6


@dataclass(frozen=True, slots=True)
class Compensated:
    """A compensated picture, all on the content's own dome master.

    Attributes
    ----------
    direct : (N, N, 3) light the projectors must put there [rel]; 0 where nothing is lit, and the
        content itself, whatever it asks for, where a person protects it.
    observed : (N, N, 3) what the audience will see of it [rel].
    free : (N, N, 3) neither bound nor protection holds: observed equals the target there.
    flux : (3,) direct flux [rel sr].
    """

    direct: Image
    observed: Image
    free: NDArray[np.bool_]
    flux: Array


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a compensated frame is worth, told from its own light.

    Attributes
    ----------
    kkt : how far the conditions of the optimum are from holding, relative to the light's moments;
        NaN for methods that find none.
    self_consistency : the light that bounces, as subtracted, less that of the light sent; relative.
    share_lo, share_hi : (3,) share of the lit solid angle where a limit holds.
    flux_in, flux_out : (3,) of the content under its white, and of the light sent [rel sr].
    """

    kkt: float
    self_consistency: float
    share_lo: Array
    share_hi: Array
    flux_in: Array
    flux_out: Array


class Compensator:
    """Compensates dome masters of one size for one calibration.

    Light of protected places is left as it is, and counts for the rest of the dome.

    Parameters
    ----------
    calibration : with maps of the dome.
    size : edge of the square content [px].
    method : "exact" solves (P) of science.md s.5: what no limit holds is reproduced exactly.
        "least-squares" (W) has the least squared error over the dome. "subtract" takes off the light
        that would bounce were there no limits, then clamps (van Baar et al. 2011, eq. 12, with all that
        reflects). "paper-eq12" is that equation to the letter, with the lit area alone. "none" clamps.
    state : name of the house state to compensate for; None for the house as it was calibrated.
    strength : 0 gives the content itself, 1 the full result, mixed as encoded.
    white : what content 1.0 is, see `Fields.of`.
    transfer_name : the content's transfer function, see `maths.transfer`; None: srgb for integers,
        linear for floats.

    Raises
    ------
    InputError
        An unknown method, white or transfer function, a strength outside 0..1, or a state that the
        calibration does not have.

    Notes
    -----
    In a state of ratio r and ambient light A, u becomes r u, and the room's own lamps come on top. Light
    adds up: with e what the lamps bring to the screen before any bounce, what is seen is N (b0 + e) =
    N b0 + N e, and a camera that looked while the projectors were dark saw A = N e, with all its
    bounces. So A is added to what is observed, never to the direct light `lo`, for there it would
    bounce once more. The wanted light is N b0 = t - A: (P) of science.md s.5 with t - A for t. Where A
    outshines the target that is negative, and the clip at lo holds as it does for any black. Methods
    "paper-eq12" and "none" know nothing of the lamps.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: int,
        method: str = "exact",
        state: str | None = None,
        *,
        strength: float = 1.0,
        white: str = "summed",
        transfer_name: str | None = None,
    ) -> None:
        if method not in METHODS:
            raise InputError(f"method: got {method!r}, expected one of {', '.join(METHODS)}")
        if not 0 <= strength <= 1:
            raise InputError(f"strength: got {strength}, expected 0 (the content itself) to 1")
        self.method, self.size, self.strength = method, size, strength
        self._transfer = transfer_name and transfer(transfer_name)
        self.fields = Fields.of(calibration, size, state, white)
        self._model = self._model_of(calibration)
        self._solution = np.zeros(
            (2, CHANNELS, TERMS)
        )  # of the last frame: q, and what (W) takes off
        self._last: tuple[NDArray[Any], Coding, Array] | None = None

    def _model_of(self, calibration: Calibration) -> FrameModel:
        model = self.fields.model
        if self.method == "none":
            return replace(model, ambient=None, spread=np.zeros_like(model.spread), terms=1)
        if self.method == "paper-eq12":
            flat = np.full_like(model.spread, calibration.albedo.value / (4 * np.pi))
            return replace(model, ambient=None, spread=flat, terms=1)
        return model

    @property
    def numbers(self) -> Array:
        """(3, 9) of the last frame: the polynomial of its bounced light (`Fields.numbers_of`)."""
        return self._solution[0]

    @property
    def protected(self) -> NDArray[np.bool_]:
        """(N, N) where the content goes out as it came."""
        none = np.zeros((self.size, self.size), bool)
        return none if self.fields.protected is None else self.fields.protected

    @cached_property
    def lit(self) -> NDArray[np.bool_]:
        """(N, N) where projectors reach."""
        return interpolated(self._model, self._model.coverage, slice(None)) > 0

    def frame(self, image: NDArray[Any], out: NDArray[Any] | None = None) -> NDArray[Any]:
        """The light to send, encoded as the content is.

        Parameters
        ----------
        image : (N, N, 3) uint8, uint16, float16 or float32; 1.0 (255, 65535) is the white.
        out : array like it to write to, which may be `image` itself.

        Raises
        ------
        ShapeError, InputError
            Another shape or element type.
        """
        coded = self._coded(image)
        self._solve(*coded)
        return self._applied(image, coded, out)

    def apply(
        self, image: NDArray[Any], numbers: Array, out: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """`frame` with known numbers (3, 9), such as a track's; nothing is solved."""
        self._solution = np.stack([numbers, np.zeros_like(numbers)])
        return self._applied(image, self._coded(image), out)

    @property
    def certificate(self) -> Certificate:
        """Of the last frame; costs a few looks at it."""
        if self._last is None:
            raise InputError("certificate: got no frame yet, expected one; call frame() first")
        content, coding, residual = self._last
        light = self._light()
        sums = {w: self._sums(content, light, w, coding)[:, 0] for w in ("at least", "at most")}
        sent = self._sums(content, light, "light", coding)
        lit = float(self.fields.gram[0, 0])
        moments = np.abs(sent).max()
        # of (P) and (W) the residual is that of the equations that make the optimum
        optimal = self.method in ("exact", "least-squares")
        assumed = self._root_value()[:, : self._model.terms]
        return Certificate(
            float(np.abs(residual).max() / moments) if optimal else float("nan"),
            float(np.abs(sent - assumed).max() / moments),
            sums["at least"] / lit,
            sums["at most"] / lit,
            self._sums(content, np.zeros_like(light), "content", coding)[:, 0],
            sent[:, 0],
        )

    def solve(self, image: Image) -> Compensated:
        """The compensated picture in linear light, what the audience will see of it, what clips."""
        if image.shape != (self.size, self.size, CHANNELS):
            raise ShapeError("content", image.shape, f"({self.size}, {self.size}, 3)")
        content = np.ascontiguousarray(image, np.float32)
        coding = self._coding("linear", np.inf, 1.0)
        self._solve(content, coding)
        light, every = self._light(), slice(None)
        direct = frame_apply(self._model, content, light, coding)
        wanted = self.target(content) - interpolated(self._model, light, every)
        least, most = (interpolated(self._model, f, every) for f in self._limits)
        free = (wanted > least) & (wanted < most) & self.lit[..., None]
        sums = self._sums(content, light, "light", coding)
        observed = np.where(self.lit[..., None], direct + self._bounced(content, coding, light), 0)
        kept = self.protected
        direct[kept], free[kept] = image[kept], False
        return Compensated(direct, observed.astype(np.float32), free, sums[:, 0])

    def target(self, image: Image) -> Image:
        """What the audience should see (N, N, 3): the content under its white."""
        gain = self._model.gain
        even = 1.0 if gain is None else interpolated(self._model, gain, slice(None))[..., None]
        return np.where(self.lit[..., None], image * even, 0).astype(np.float32)

    @property
    def _limits(self) -> tuple[Image, Image]:
        assert self._model.hi is not None
        return self._model.lo, self._model.hi

    def _bounced(self, content: Image, coding: Coding, light: Image) -> Array:
        """What really bounces of the light sent, and the lamps' (N, N, 3)."""
        whole = self.fields.seen
        terms = whole.terms
        sums = frame_sums(replace(self._model, terms=terms), content, light, "light", coding)
        seen = bounced_light(whole, self.fields.numbers_of(sums))
        return interpolated(whole, seen, slice(None))

    def _coded(self, image: NDArray[Any]) -> tuple[NDArray[Any], Coding]:
        """The content as the kernels take it: 8 bits through tables, the rest in linear light."""
        integer = image.dtype in WHOLE
        name = self._transfer.name if self._transfer else "srgb" if integer else "linear"
        top = 1.0 if integer else np.inf
        if image.dtype == np.uint8:
            return image, self._coding(name, top, self.strength)
        if name == "linear":
            return image, self._coding(name, top, self.strength)
        value = image.astype(np.float32) / np.float32(WHOLE.get(image.dtype, 1))
        linear = transfer(name).decode(value).astype(np.float32)
        return linear, self._coding(name, top, 1.0)

    def _coding(self, name: str, top: float, strength: float) -> Coding:
        known = transfer(name)
        return Coding(known.decode, known.encode, threshold_tile(), strength, top)

    def _applied(
        self, image: NDArray[Any], coded: tuple[NDArray[Any], Coding], out: NDArray[Any] | None
    ) -> NDArray[Any]:
        content, coding = coded
        kept = self.fields.protected
        held = None if kept is None else image[kept]
        if content is image:
            sent = frame_apply(self._model, content, self._light(), coding, out)
        else:
            sent = self._encoded(
                image, frame_apply(self._model, content, self._light(), coding), coding
            )
            if out is not None:
                out[...] = sent
                sent = out
        if held is not None:
            sent[kept] = held
        return sent

    def _encoded(self, image: NDArray[Any], linear: Image, coding: Coding) -> NDArray[Any]:
        whole = WHOLE.get(image.dtype)
        value = np.asarray(coding.encode(linear)) * (whole or 1.0)
        mixed = image + self.strength * (value - image)
        return (np.rint(mixed) if whole else mixed).astype(image.dtype)

    def _light(self) -> Image:
        offset = self._solution[1] if self.method == "least-squares" else None
        return bounced_light(self._model, self._solution[0], offset)

    def _sums(self, content: NDArray[Any], light: Image, what: str, coding: Coding) -> Array:
        return frame_sums(self._model, content, light, what, coding)

    def _solve(self, content: NDArray[Any], coding: Coding) -> None:
        """Find the numbers of a frame, from those of the last."""
        if self.method in ("none", "paper-eq12"):
            self._solution = np.zeros((2, CHANNELS, TERMS))
            if self.method == "paper-eq12":
                sums = self._sums(content, self._light(), "content", coding)
                self._solution[0, :, :1] = sums
            self._last = content, coding, np.zeros((CHANNELS, 1))
            return
        tolerance = TOLERANCE_8_BIT if content.dtype == np.uint8 else TOLERANCE
        residual = self._root.follow(
            lambda value: self._residual(value, content, coding), tolerance
        )
        self._use(self._root.value)
        self._last = content, coding, residual

    def _use(self, value: Array) -> None:
        """Numbers of moments (3, T), and in (W) of what they pull."""
        terms = self._model.terms
        self._solution[0] = self.fields.numbers_of(value[:, :terms])
        self._solution[1, :, :terms] = -value[:, terms:] if value.shape[1] > terms else 0

    def _root_value(self) -> Array:
        if self.method in ("none", "paper-eq12"):
            return self._solution[0]
        return self._root.value

    def _residual(self, value: Array, content: NDArray[Any], coding: Coding) -> Array:
        """Moments of the light sent less those assumed; in (W) also the pull less what it must be.

        (W) minimises sum a (y - t)^2 / 2, y = b0 + v mono.C m, under m = sum a mono b0. With pull l, the
        multiplier of that, b0 = clip(t - v mono.C m + mono.l) and l = -C^T sum a v mono (y - t).
        """
        terms = self._model.terms
        self._use(value)
        light = self._light()
        what = "content" if self.method == "subtract" else "light"
        left = self._sums(content, light, what, coding) - value[:, :terms]
        if self.method != "least-squares":
            return left
        pull = value[:, terms:]
        error = self._sums(content, light, "excess", coding)
        error = error + np.einsum("cij,cj->ci", self.fields.painted_gram, pull)
        asked = -np.einsum("cji,cj->ci", self.fields.operator, error)
        return np.concatenate([left, asked - pull], axis=1)

    @cached_property
    def _root(self) -> Root:
        """Where all is free: the slope there, and no light."""
        fields, terms = self.fields, self._model.terms
        eye = np.eye(terms)
        answer = fields.painted_gram @ fields.operator
        if self.method != "least-squares":
            return Root(np.zeros((CHANNELS, terms)), -(eye + answer))
        slope = np.zeros((CHANNELS, 2 * terms, 2 * terms))
        slope[:, :terms, :terms] = -(eye + answer)
        slope[:, :terms, terms:] = fields.gram
        slope[:, terms:, terms:] = -(eye + answer.transpose(0, 2, 1))
        return Root(np.zeros((CHANNELS, 2 * terms)), slope)
