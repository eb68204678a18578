"""Exact compensation (P) of dome masters, and the two pictures it is compared with."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.maths.box_solver import solve_flux, solve_moments
from procam.maths.radiosity import add_interreflection, remove_interreflection_paper
from procam.maths.scatter_kernel import basis
from procam.maths.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.calibration import Calibration

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Method = Literal["exact", "paper-eq12", "none"]
CHANNELS = 3


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


class Compensator:
    """Compensates dome masters of one size for one calibration.

    Light of `protected` (N, N) places is left as it is, and counts for the rest of the dome.

    Parameters
    ----------
    calibration : with maps of the dome.
    size : edge of the square content [px].
    method : "exact" solves (P) of science.md s.5; "paper-eq12" subtracts by paper eq. 12 to the
        letter, with the lit area alone, and clamps; "none" clamps the content.
    state : name of the house state to compensate for; None for the house as it was calibrated.

    Raises
    ------
    InputError
        An unknown method, or a state that the calibration does not have.

    Notes
    -----
    In a state of ratio r and ambient light A, u becomes r u, and the room's own lamps come on top. Light
    adds up: with e what the lamps bring to the screen before any bounce, what is seen is N (b0 + e) =
    N b0 + N e, and a camera that looked while the projectors were dark saw A = N e, with all its
    bounces. So A is added to what is observed, never to the direct light `lo`, for there it would
    bounce once more. The wanted light is N b0 = t - A: (P) of science.md s.5 with t - A for t. Where A
    outshines the target that is negative, and the clip at lo holds as it does for any black. The other
    two methods know nothing of the lamps.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: int,
        method: Method = "exact",
        state: str | None = None,
    ) -> None:
        if method not in ("exact", "paper-eq12", "none"):
            raise InputError(f"method: got {method!r}, expected exact, paper-eq12 or none")
        self.method, self.size = method, size
        direction, inside = master_directions(size)
        where = master_pixels(direction, calibration.maps.size)
        maps = calibration.maps
        coverage = sample(maps.coverage, where) * inside
        self.lit = coverage > 0
        self.protected = maps.is_protected(where) & inside
        self._kept = self.protected[self.lit][:, None]
        self._solid = (master_solid_angles(size) * coverage)[self.lit]
        self._scatter = sample(maps.scatter_per_flux, where)[self.lit].astype(float)
        self._ambient = np.zeros_like(self._scatter)
        if state is not None:
            house = calibration.state(state)
            self._scatter *= house.scatter_ratio
            if house.ambient is not None:
                self._ambient = sample(house.ambient, where)[self.lit].astype(float)
        self._lo = sample(maps.lo, where)[self.lit].astype(float)
        # coverage fades hi over the border; what is lit at all can be driven to full there
        self._hi = np.maximum(
            sample(maps.hi, where)[self.lit] / np.maximum(coverage[self.lit], 0.5)[:, None],
            self._lo,
        ).astype(float)
        self._albedo = calibration.albedo.value
        even = np.ones_like(maps.coverage) if maps.falloff is None else maps.falloff
        self._falloff = sample(even, where)[self.lit][:, None].astype(float)
        self._falloff[self._kept] = 1
        self._kernel = maps.kernel
        if maps.kernel.degree:
            self._phi = basis(direction[self.lit], maps.kernel.degree)

    def frame(self, image: Image, out: Image | None = None) -> Image:
        """Direct light (N, N, 3) for content (N, N, 3); 1.0 is the reference white."""
        direct = self.solve(image).direct
        if out is None:
            return direct
        out[...] = direct
        return out

    def solve(self, image: Image) -> Compensated:
        """The compensated picture with what the audience will see and what clips."""
        if image.shape != (self.size, self.size, CHANNELS):
            raise ShapeError("content", image.shape, f"({self.size}, {self.size}, 3)")
        target = image[self.lit] * self._falloff
        lo, hi = self._limits(target)
        wanted = self._wanted(target, lo, hi)
        direct = np.clip(wanted, lo, hi)
        observed = self._add_interreflection(direct) + self._ambient
        free = (wanted > lo) & (wanted < hi)
        sent = self._spread(direct)
        sent[self.protected] = image[self.protected]
        return Compensated(
            sent,
            self._spread(observed),
            self._spread(free).astype(bool),
            self._solid @ direct,
        )

    def target(self, image: Image) -> Image:
        """What the audience should see (N, N, 3): the content under the matched white."""
        return self._spread(image[self.lit] * self._falloff)

    def _limits(self, target: Array) -> tuple[Array, Array]:
        """Least and most direct light; where it is protected they leave no choice."""
        if not self._kept.any():
            return self._lo, self._hi
        kept = np.clip(target, self._lo, self._hi)
        return np.where(self._kept, kept, self._lo), np.where(self._kept, kept, self._hi)

    def _wanted(self, target: Array, lo: Array, hi: Array) -> Array:
        """Direct light before the limits."""
        if self.method == "none":
            return target
        if self.method == "paper-eq12":
            return remove_interreflection_paper(target, self._albedo, self._solid)
        left = target - self._ambient
        each = [self._unscattered(c, left[:, c], lo[:, c], hi[:, c]) for c in range(CHANNELS)]
        return np.stack(each, axis=-1)

    def _unscattered(self, channel: int, target: Array, lo: Array, hi: Array) -> Array:
        """Target (n,) of a channel less the light that will have bounced there."""
        if not self._kernel.degree:
            scatter = self._scatter[:, channel]
            return target - scatter * solve_flux(target, scatter, self._solid, lo, hi)
        spread, collect = self._kernel_of(channel)
        return np.asarray(target - spread @ solve_moments(target, spread, collect, lo, hi))

    def _add_interreflection(self, direct: Array) -> Array:
        if not self._kernel.degree:
            return add_interreflection(direct, self._scatter, self._solid)
        scattered = [
            spread @ (collect.T @ direct[:, c])
            for c in range(CHANNELS)
            for spread, collect in [self._kernel_of(c)]
        ]
        return np.asarray(direct + np.stack(scattered, axis=-1))

    def _kernel_of(self, channel: int) -> tuple[Array, Array]:
        """U and V (n, K) of a channel, bounced light being U V^T b0 (maths.scatter_kernel)."""
        kernel = self._kernel
        paint = self._scatter[:, channel] / (self._phi @ kernel.profile[channel])
        spread = paint[:, None] * (self._phi @ kernel.matrix[channel])
        return spread, self._solid[:, None] * self._phi

    def _spread(self, values: NDArray[np.generic]) -> Image:
        image = np.zeros((self.size, self.size, CHANNELS), np.float32)
        image[self.lit] = values
        return image
