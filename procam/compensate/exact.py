"""Compensation of dome masters: exact (P), least squares (W), and what they are compared with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.equations import Equations
from procam.compensate.fields import Fields
from procam.errors import InputError
from procam.kernels.frame import (
    bounced_light,
    check_pictures,
    frame_apply,
    frame_sums,
)
from procam.kernels.frame.coding import WHOLE, Coding
from procam.kernels.frame.reference import interpolated
from procam.maths.dither import threshold_tile
from procam.maths.transfer import transfer
from procam.model.calibration import Calibration

Array = NDArray[np.float64]
Image = NDArray[np.float32]
METHODS = ("exact", "subtract", "least-squares", "paper-eq12", "none")
CHANNELS = 3
DARKEST = 1e-5  # light [rel sr] that what a certificate tells is relative to, of a black frame


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
    """What a compensated frame is worth, told from the light of its full result, whatever the strength.

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
        self._equations = Equations(self.fields, method, calibration.albedo.value)
        self._codings: dict[tuple[str, float, float], Coding] = {}
        self._last: tuple[NDArray[Any], Coding] | None = None

    @property
    def numbers(self) -> Array:
        """(3, 9) of the last frame: the polynomial of its bounced light (`Fields.numbers_of`)."""
        return self._equations.solution[0]

    @property
    def protected(self) -> NDArray[np.bool_]:
        """(N, N) where the content goes out as it came."""
        none = np.zeros((self.size, self.size), bool)
        return none if self.fields.protected is None else self.fields.protected

    @cached_property
    def lit(self) -> NDArray[np.bool_]:
        """(N, N) where projectors reach."""
        return interpolated(self.fields.shown, self.fields.shown.coverage, slice(None)) > 0

    def frame(self, image: NDArray[Any], out: NDArray[Any] | None = None) -> NDArray[Any]:
        """The light to send, encoded as the content is.

        Parameters
        ----------
        image : (N, N, 3) uint8, uint16, float16 or float32; 1.0 (255, 65535) is the white; what is
            not finite is taken for black.
        out : array like it to write to, which may be `image` itself.

        Raises
        ------
        ShapeError, InputError
            Another shape or element type.
        """
        check_pictures(self.size, image, out)
        coded = self._coded(image)
        self._last = None
        sent = self._applied(image, coded, out, self._equations.frame)
        if out is None or not np.may_share_memory(image, out):
            self._last = coded
        return sent

    def apply(
        self, image: NDArray[Any], numbers: Array, out: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """`frame` with known numbers (3, 9), such as a track's; nothing is solved."""
        check_pictures(self.size, image, out)
        self._last = None
        self._equations.solution = np.stack([numbers, np.zeros_like(numbers)])
        return self._applied(image, self._coded(image), out, self._equations.apply)

    @property
    def certificate(self) -> Certificate:
        """Of the last frame; costs a few looks at it."""
        if self._last is None:
            raise InputError(
                "certificate: got no frame that is still there, expected one; call frame() first, "
                "and do not write over its content"
            )
        content, coding = self._last
        equations = self._equations
        light = equations.light(equations.model)
        at = {w: equations.sums(content, light, w, coding)[:, 0] for w in ("at least", "at most")}
        sent = equations.sums(content, light, "light", coding)
        lit = float(self.fields.gram[0, 0])
        moments = max(np.abs(sent).max(), DARKEST)
        residual = equations.left(content, sent, coding)
        # of (P) and (W) the residual is that of the equations that make the optimum
        optimal = self.method in ("exact", "least-squares")
        return Certificate(
            float(np.abs(residual).max() / moments) if optimal else float("nan"),
            float(np.abs(sent - equations.assumed()).max() / moments),
            at["at least"] / lit,
            at["at most"] / lit,
            equations.sums(content, np.zeros_like(light), "content", coding)[:, 0],
            sent[:, 0],
        )

    def solve(self, image: Image) -> Compensated:
        """The compensated picture in linear light, what the audience will see of it, what clips."""
        check_pictures(self.size, image)
        content, self._last = np.ascontiguousarray(image, np.float32), None
        equations, coding = self._equations, self._coding("linear", np.inf, 1.0)
        equations.solve(content, coding)
        self._last = content, coding
        shown, every, lit = equations.shown, slice(None), self.lit[..., None]
        light = equations.light(shown)
        direct = frame_apply(shown, content, light, coding)
        wanted = self._under_white(content) - interpolated(shown, light, every)
        assert shown.hi is not None
        lo, hi = (interpolated(shown, field, every) for field in (shown.lo, shown.hi))
        free, kept = (wanted > lo) & (wanted < hi) & lit, self.protected
        counted = np.where(kept[..., None] & lit, np.clip(content, lo, hi), direct)
        observed = np.where(lit, counted + self._bounced(content, coding), 0)
        sums = equations.sums(content, equations.light(equations.model), "light", coding)
        direct[kept], free[kept] = image[kept], False
        return Compensated(direct, observed.astype(np.float32), free, sums[:, 0])

    def target(self, image: Image) -> Image:
        """What the audience should see (N, N, 3): the content under its white, or as it is kept."""
        wanted = np.where(self.lit[..., None], self._under_white(image), 0).astype(np.float32)
        kept = self.protected & self.lit
        wanted[kept] = image[kept]
        return wanted

    def _under_white(self, image: Image) -> Image:
        gain = self.fields.shown.gain
        if gain is None:
            return image
        return image * interpolated(self.fields.shown, gain, slice(None))[..., None].astype(
            np.float32
        )

    def _bounced(self, content: Image, coding: Coding) -> Array:
        """What really bounces of the light sent, and the lamps' (N, N, 3)."""
        equations, shown = self._equations, self.fields.shown
        model = replace(equations.model, terms=shown.terms)
        sums = frame_sums(model, content, equations.light(equations.model), "light", coding)
        return interpolated(shown, bounced_light(shown, self.fields.numbers_of(sums)), slice(None))

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
        asked = name, top, strength
        if asked not in self._codings:
            known = transfer(name)
            made = Coding(known.decode, known.encode, threshold_tile(), strength, top)
            self._codings[asked] = made
        return self._codings[asked]

    def _applied(
        self,
        image: NDArray[Any],
        coded: tuple[NDArray[Any], Coding],
        out: NDArray[Any] | None,
        write: Callable[[NDArray[Any], Coding, NDArray[Any] | None], NDArray[Any]],
    ) -> NDArray[Any]:
        content, coding = coded
        kept = self.fields.protected
        held = None if kept is None else image[kept]
        if content is image:
            sent = write(content, coding, out)
        else:
            sent = self._encoded(image, write(content, coding, None), coding)
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
