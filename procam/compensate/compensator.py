"""Compensation of dome masters: exact (P), least squares (W), perceptual, and simpler methods for comparison.

`Fields` turns a calibration into the frame model, `FrameEquations` solves it for a picture, and the
kernels write the light to send. A `Compensator` joins them for content of any type: 8-bit content stays
as it is and goes through tables, other encoded content is decoded before and encoded after.

The module is longer than 300 lines because its public class explains all methods and what they return.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, Image
from procam.compensate.content import ContentCodec
from procam.compensate.equations import FrameEquations, Solution
from procam.compensate.fields import Fields
from procam.compensate.perceptual.settings import PERCEPTUAL, Perceptual
from procam.compensate.solved_frame import SolvedFrame, certificate
from procam.errors import InputError
from procam.kernels.frame.api import check_pictures, frame_apply, frame_sums, scattered_light
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.reference import interpolated
from procam.maths.light.transfer import transfer
from procam.model.calibration import Calibration

if TYPE_CHECKING:
    from procam.compensate.perceptual.dome import DomeTargets
    from procam.compensate.perceptual.targets import Reached

METHODS = ("exact", *PERCEPTUAL, "subtract", "least-squares", "paper-eq12", "none")
CHANNELS = 3


@dataclass(frozen=True, slots=True)
class Compensated:
    """A compensated picture, all on the content's own dome master.

    Attributes
    ----------
    direct : (N, N, 3) direct light of the projectors [rel]; 0 where nothing is lit, and the content
        itself, even beyond the limits, where it is protected.
    observed : (N, N, 3) total light as the audience sees it [rel].
    free : (N, N, 3) neither a limit nor protection holds: observed equals the target there, of the
        perceptual methods that which they chose.
    flux : (3,) direct flux [rel sr]. solved : the frame, whose `sent` is `direct`.
    """

    direct: Image
    observed: Image
    free: BoolArray
    flux: Array
    solved: SolvedFrame


class Compensator:
    """Compensates dome masters of one size for one calibration.

    Protected places are left as they are; their light counts for the rest of the dome. Frames are
    solved in turn, each from the solution of the last.

    Parameters
    ----------
    calibration : with maps of the dome.
    size : edge of the square content [px].
    method : "exact" solves (P), docs/theory/compensation.md (C2): unlimited pixels are reproduced exactly.
        "least-squares" (W) has the least squared error over the dome; floats brighter than a place can
        be count there as its brightest, see `Fields.full_white`. "perceptual" keeps local contrast where
        (P) needs negative light (docs/theory/perceptual.md), "perceptual-video" does so for frames in
        their order; a `Perceptual` holds their settings. "subtract" takes off the light
        that would be scattered without limits, then clamps (van Baar et al. 2011, eq. 12, with all
        that reflects). "paper-eq12" is that equation to the letter, with the lit area alone. "none"
        clamps.
    state : name of the venue state to compensate for; None for the venue as it was calibrated.
    strength : 0 gives the content itself, 1 the full result, mixed as encoded.
    white : luminance of content value 1.0, see `Fields.of`.
    transfer_name : the content's transfer function, see `maths.transfer`; None: srgb for integers,
        linear for floats.

    Raises
    ------
    InputError
        An unknown method, white or transfer function, a strength outside 0..1, or a state that the
        calibration does not have.

    Notes
    -----
    In a state of ratio r and ambient light A, u becomes r u, and the light of the room's own lamps is
    added. Light adds up: with e the lamps' irradiance before any bounce, the total is N (b0 + e) =
    N b0 + N e. A camera that photographs the screen while the projectors are dark measures A = N e,
    with all bounces. So A is added to the total, never to the direct light `lo`, where it would be
    scattered once more. The wanted light is N b0 = t - A: (P) with t - A for t.
    Where A exceeds the target that is negative, and the clip at lo holds as for any black. Methods
    "paper-eq12" and "none" ignore the lamps.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: int,
        method: str | Perceptual = "exact",
        state: str | None = None,
        *,
        strength: float = 1.0,
        white: str = "summed",
        transfer_name: str | None = None,
    ) -> None:
        perceptual = method if isinstance(method, Perceptual) else PERCEPTUAL.get(method)
        name = perceptual.name if perceptual else str(method)
        if name not in METHODS:
            raise InputError(f"method: {name!r} is unknown; choose one of {', '.join(METHODS)}")
        if not 0 <= strength <= 1:
            raise InputError(
                f"strength: {strength} is outside 0 (the content itself) to 1 (the full result)"
            )
        if size < 2:
            raise InputError(f"size: {size} px is too small; 2 or more are needed")
        self.method, self.size, self.strength = name, size, strength
        known = transfer(transfer_name) if transfer_name else None
        self.fields = Fields.of(calibration, size, state, white)
        equations = "exact" if perceptual else name
        self._equations = FrameEquations(self.fields, equations, calibration.albedo.value)
        self._targets: DomeTargets | None = None
        if perceptual:
            from procam.compensate.perceptual import dome  # noqa: PLC0415 - SciPy and OpenCV

            self._targets = dome.DomeTargets(
                self.fields, lambda edge: Fields.of(calibration, edge, state, white), perceptual
            )
        self._codec = ContentCodec(known, strength, self.fields.protected)

    @property
    def protected(self) -> BoolArray:
        """(N, N) where the content is sent unchanged."""
        none = np.zeros((self.size, self.size), bool)
        return none if self.fields.protected is None else self.fields.protected

    @cached_property
    def lit(self) -> BoolArray:
        """(N, N) where projectors reach."""
        return interpolated(self.fields.shown, self.fields.shown.coverage, slice(None)) > 0

    def restart(self) -> None:
        """Forget the frames before: the next one is solved as if it were the first."""
        self._equations.restart()
        if self._targets:
            self._targets.restart()

    def frame(self, image: AnyArray, out: AnyArray | None = None) -> AnyArray:
        """The light to send, encoded as the content is; `solve` gives all that is known of it."""
        return self.solve(image, out).sent

    def solve(self, image: AnyArray, out: AnyArray | None = None) -> SolvedFrame:
        """Solve a frame.

        Parameters
        ----------
        image : (N, N, 3) uint8, uint16, float16 or float32; 1.0 (255, 65535) is the white; values
            that are not finite count as black.
        out : array like it to write to, which may be `image` itself; a new one otherwise.

        Raises
        ------
        ShapeError, InputError
            Another shape or element type.
        """
        check_pictures(self.size, image, out)
        content, coding = self._decoded(image, self._codec)
        held, reached = self._codec.protected_pixels(image), None
        if self._targets:
            content, coding, reached = self._perceived(image, content, coding, self._codec)
        overwritten = out is not None and np.may_share_memory(image, out)
        to = out if content is image else None
        sent, solution = self._equations.frame(content, coding, to)
        sent = self._codec.finished(image, sent, None if content is image else coding, out, held)
        found = self._solved(sent, content, coding, solution, reached)
        return replace(found, certify=None) if overwritten else found

    def apply(self, image: AnyArray, coefficients: Array, out: AnyArray | None = None) -> AnyArray:
        """`frame` with known coefficients (3, 9), such as a track's; nothing is solved.

        Raises
        ------
        InputError
            A perceptual method, whose light depends on more than these.
        """
        check_pictures(self.size, image, out)
        if self._targets:
            raise InputError(
                f"apply: method {self.method} chooses light for each place; call frame() for each picture"
            )
        content, coding = self._decoded(image, self._codec)
        held = self._codec.protected_pixels(image)
        solution = replace(self._equations.nothing, coefficients=coefficients)
        to = out if content is image else None
        sent = self._equations.apply(content, coding, solution, to)
        return self._codec.finished(image, sent, None if content is image else coding, out, held)

    def predict(self, image: Image, top: float = np.inf) -> Compensated:
        """The compensated picture in linear light, its total as the audience sees it, where it clips.

        Parameters
        ----------
        image : (N, N, 3) float16 or float32, linear light, 1.0 is the white.
        top : the most light that will be sent [rel]: 1 if it will be integers.

        Raises
        ------
        ShapeError, InputError
            Another shape; integers, which are encoded: `frame` takes those.
        """
        check_pictures(self.size, image)
        if image.dtype.kind != "f":
            raise InputError(
                f"content: {image.dtype} is encoded; predict takes linear light as float32, frame takes codes"
            )
        linear = np.ascontiguousarray(image, np.float32)
        codec, reached = ContentCodec(transfer("linear"), 1.0, None, top), None
        content, coding = self._decoded(linear, codec)
        if self._targets:
            content, coding, reached = self._perceived(linear, content, coding, codec)
        equations = self._equations
        solution, _ = equations.solve(content, coding)
        shown, every, lit = equations.shown, slice(None), self.lit[..., None]
        light = equations.shown_light(solution)
        direct = frame_apply(shown, content, light, coding)
        wanted = self._under_white(content) - interpolated(shown, light, every)
        assert shown.hi is not None
        lo, hi = (interpolated(shown, field, every) for field in (shown.lo, shown.hi))
        free, kept = (wanted > lo) & (wanted < np.minimum(hi, top)) & lit, self.protected
        counted = np.where(kept[..., None] & lit, np.clip(content, lo, hi), direct)
        scattered = self._scattered(content, coding, solution)
        observed = np.where(lit, counted + scattered, 0)
        sums = equations.sums(content, solution, "light", coding)
        direct[kept], free[kept] = image[kept], False
        solved = self._solved(direct, content, coding, solution, reached)
        return Compensated(direct, observed.astype(np.float32), free, sums[:, 0], solved)

    def _solved(
        self,
        sent: AnyArray,
        content: AnyArray,
        coding: Coding,
        solution: Solution,
        reached: "Reached | None",
    ) -> SolvedFrame:
        certify = partial(certificate, self._equations, content, coding, solution, reached)
        chosen = reached.target if reached and reached.share > 0 else None
        return SolvedFrame(sent, solution.coefficients, chosen, certify)

    def _perceived(
        self, image: AnyArray, content: AnyArray, coding: Coding, codec: ContentCodec
    ) -> tuple[AnyArray, Coding, "Reached"]:
        """The content that (P) is to solve instead, with its coding.

        It is the content itself, as it came, where (P) reaches all of it.
        """
        assert self._targets is not None
        solution, _ = self._equations.solve(content, coding)
        limits = ("at least", "at most")
        held = [self._equations.sums(content, solution, limit, coding) for limit in limits]
        most = self.fields.full_white if image.dtype.kind == "f" else None
        linear, plain = codec.linear(image, most)
        found = self._targets.of(linear, solution.moments, plain.top, reachable=not np.any(held))
        return (found.target, plain, found) if found.share else (content, coding, found)

    def _decoded(self, image: AnyArray, codec: ContentCodec) -> tuple[AnyArray, Coding]:
        limited = self.method == "least-squares" and image.dtype.kind == "f"
        return codec.decoded(image, self.fields.full_white if limited else None)

    def target(self, image: Image) -> Image:
        """The total light to aim for (N, N, 3): the content under its white, or itself where protected."""
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

    def _scattered(self, content: Image, coding: Coding, solution: Solution) -> Array:
        """Scattered light (N, N, 3) of the light sent, whatever the method, and the lamps'."""
        equations, shown = self._equations, self.fields.shown
        model = replace(equations.model, terms=shown.terms)
        sums = frame_sums(model, content, equations.light(solution), "light", coding)
        coefficients = self.fields.coefficients_of(sums)
        return interpolated(shown, scattered_light(shown, coefficients), slice(None))
