"""What the dome does to light, sampled on a dome master."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.model.mask import Mask

Map = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Measured:
    """A number per channel with its standard error: `value` (3,), `sigma` (3,)."""

    value: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def interval(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The 95 % interval, (low, high)."""
        return self.value - 1.96 * self.sigma, self.value + 1.96 * self.sigma


@dataclass(frozen=True, slots=True)
class ScatterKernel:
    """How bounced light depends on where the direct light falls (maths.scatter_kernel).

    A place of scatter_per_flux u gets u (phi.(B M)) / (phi.g) of direct light of moments M; phi are the
    harmonics up to `degree` at the place, K = (degree + 1)^2 of them. Degree 0 is one scalar.

    Attributes
    ----------
    matrix : (C, K, K) B per channel, symmetric. profile : (C, K) g, of full white's light.
    """

    degree: int
    matrix: NDArray[np.float64]
    profile: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.degree not in (0, 1, 2):
            raise InputError(f"kernel: got degree {self.degree}, expected 0, 1 or 2")
        terms, channels = (self.degree + 1) ** 2, len(self.matrix)
        for name, shape in (("matrix", (channels, terms, terms)), ("profile", (channels, terms))):
            array = getattr(self, name)
            if array.shape != shape:
                raise ShapeError(f"kernel {name}", array.shape, f"{shape}")
            if not np.isfinite(array).all():
                raise InputError(f"kernel {name}: got NaN or infinity, expected numbers")

    @classmethod
    def scalar(cls, channels: int = 3) -> "ScatterKernel":
        """One scalar per colour."""
        return cls(0, np.ones((channels, 1, 1)), np.ones((channels, 1)))


@dataclass(frozen=True, slots=True)
class DomeMaps:
    """Maps of the dome on an equidistant dome master of 180 degrees, front at the bottom edge.

    Attributes
    ----------
    scatter_per_flux : (N, N, 3) u, scattered radiance per direct flux of full white [1/sr].
    albedo : (N, N, 3) diffuse reflectance [-].
    lo, hi : (N, N, 3) direct radiance with all projectors black and at full blended white [rel].
    coverage : (N, N) share of the pixel that a projector can light, 0..1.
    protected : (N, N) where the picture is left as it is, never compensated; None for nowhere.
    kernel : what bounced light of other pictures than full white is like.
    falloff : (N, N) of the white, 1 at its brightest: content is multiplied with it; None for even.
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
        plane = 2 * self.coverage.shape[:1]
        shapes = dict.fromkeys(("scatter_per_flux", "albedo", "lo", "hi"), (*plane, 3))
        for name, shape in (shapes | {"coverage": plane, "falloff": plane}).items():
            field = getattr(self, name)
            if field is not None and field.shape != shape:
                raise ShapeError(f"map {name}", field.shape, f"{shape}")

    @property
    def size(self) -> int:
        """Edge of the maps [px]."""
        return int(self.coverage.shape[0])

    def is_protected(self, where: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Whether the picture is left as it is at places (..., 2) of the maps [px]."""
        if self.protected is None:
            return np.zeros(where.shape[:-1], bool)
        return self.protected.at(where)
