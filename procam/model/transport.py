"""Light transport of the screen: maps on its canvas, the scatter kernel, measured values."""

from dataclasses import dataclass, field

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Map
from procam.errors import InputError, ShapeError
from procam.model.mask import Mask


@dataclass(frozen=True, slots=True)
class Measured:
    """One value per channel with its standard error: `value` (3,), `sigma` (3,)."""

    value: Array
    sigma: Array

    def interval(self) -> tuple[Array, Array]:
        """The 95 % interval, (low, high)."""
        return self.value - 1.96 * self.sigma, self.value + 1.96 * self.sigma


@dataclass(frozen=True, slots=True)
class ScatterKernel:
    """Dependence of scattered light on where the direct light falls (`maths.light.scatter_kernel`).

    Direct light of moments M scatters u (phi.(B M)) / (phi.g) to a patch, where u is its
    scatter_per_flux and phi its K = (degree + 1)^2 harmonics (docs/theory/interreflection.md, I16).
    Degree 0 is one scalar per channel.

    Attributes
    ----------
    matrix : (C, K, K) B per channel, symmetric. profile : (C, K) g = B M of full white, per flux.
    """

    degree: int
    matrix: Array
    profile: Array

    def __post_init__(self) -> None:
        if self.degree not in (0, 1, 2):
            raise InputError(f"the scatter kernel has degree {self.degree}; it needs 0, 1 or 2")
        terms, channels = (self.degree + 1) ** 2, len(self.matrix)
        for name, shape in (("matrix", (channels, terms, terms)), ("profile", (channels, terms))):
            array = getattr(self, name)
            if array.shape != shape:
                raise ShapeError(f"kernel {name}", array.shape, f"{shape}")
            if not np.isfinite(array).all():
                raise InputError(f"kernel {name} contains NaN or infinity; it needs finite numbers")

    @classmethod
    def scalar(cls, channels: int = 3) -> "ScatterKernel":
        """The kernel of a bare sphere: one scalar per channel."""
        return cls(0, np.ones((channels, 1, 1)), np.ones((channels, 1)))


@dataclass(frozen=True, slots=True)
class ScreenMaps:
    """Maps of the screen on its canvas; of a dome, a master of 180 degrees, front at the bottom edge.

    Attributes
    ----------
    scatter_per_flux : (H, W, 3) u, scattered light per direct flux of full white [1/sr]; in a room [1/m^2].
    albedo : (H, W, 3) diffuse reflectance [-].
    lo, hi : (H, W, 3) direct light with all projectors black, and at full blended white [rel].
    coverage : (H, W) share of the pixel that a projector can light, 0..1.
    protected : (H, W) mask of the part that is never compensated; None for nowhere.
    kernel : dependence of the scattered light on the picture, on a dome.
    falloff : (H, W) of the white, 1 at its brightest; content is multiplied by it. None for uniform.
    """

    scatter_per_flux: Map
    albedo: Map
    lo: Map
    hi: Map
    coverage: Map
    protected: Mask | None = None
    kernel: ScatterKernel = field(default_factory=ScatterKernel.scalar)
    falloff: Map | None = None

    def __post_init__(self) -> None:
        plane = self.coverage.shape
        shapes = dict.fromkeys(("scatter_per_flux", "albedo", "lo", "hi"), (*plane, 3))
        for name, shape in (shapes | {"coverage": plane, "falloff": plane}).items():
            field = getattr(self, name)
            if field is not None and field.shape != shape:
                raise ShapeError(f"map {name}", field.shape, f"{shape}")

    @property
    def size(self) -> int:
        """Width of the maps [px], the edge of those of a dome."""
        return int(self.coverage.shape[1])

    def is_protected(self, where: FloatArray) -> BoolArray:
        """Whether positions (..., 2) of the maps [px] are in the part that is never compensated."""
        if self.protected is None:
            return np.zeros(where.shape[:-1], bool)
        return self.protected.at(where)
