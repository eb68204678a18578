"""Fit of the scatter kernel: how scattered light depends on where the direct light falls.

The data are `ScatterSample`s: scattered light of one picture and the flux of its direct light, both
averaged over cells of a small dome master. `solve_scatter` estimates u, the scattered light per flux of
full white at camera pixels, and with it the kernel B of docs/theory/interreflection.md (I16, I17). The
degree of B is chosen by cross-validation: each picture in turn is predicted from the others.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image, IndexArray
from procam.errors import OutOfModelRange
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.feedback import estimate_scatter_per_flux
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.light.scatter_kernel import ZoneMeasurements, basis, predicted_ratio
from procam.model.transport import ScatterKernel

CELLS = 32  # edge of the dome master of cells, 6 degrees each
HIGHEST = 2  # degree; a higher one gains nothing in furnished rooms (studies/forward.md)
SIZE = (HIGHEST + 1) ** 2
BLACK_BLUR_PX = 4.0  # Gaussian sigma in camera pixels; black light is smooth, its noise is not
MIN_PICTURES = 4  # per degree
MIN_FLUX = 0.05  # of the pictures' median flux
MIN_CELL_SHARE = 0.9  # of a cell's pixels must see scattered light alone
MAX_ERROR_RATIO = 0.9  # of a higher degree's cross-validation error to a lower one's


@dataclass(frozen=True, slots=True)
class ScatterSample:
    """Scattered light of one picture in cells of the dome.

    Attributes
    ----------
    scattered : (N, C) mean per cell; NaN where direct light falls.
    pixels : (N,) number of camera pixels in that mean.
    direct : (N, C) flux of the direct light in each cell [rel sr].
    """

    scattered: Array
    pixels: Array
    direct: Array

    @property
    def moment(self) -> Array:
        """Moments (K, C) of the direct light, up to degree `HIGHEST` [rel sr]."""
        return np.asarray(cell_basis().T @ self.direct)

    def converted(self, matrix: Array) -> "ScatterSample":
        """The sample in other channels, `matrix` (C, C) times the old ones."""
        return ScatterSample(self.scattered @ matrix.T, self.pixels, self.direct @ matrix.T)


@dataclass(frozen=True, slots=True)
class ScatterFit:
    """A kernel, and the evidence for its degree.

    `held_out`: by degree, relative rms error of the scattered light of pictures held out of the fit;
    empty if there are too few pictures.
    """

    kernel: ScatterKernel
    held_out: dict[int, float]

    def summary(self) -> str:
        """One sentence for the report: the degree, and why."""
        degree = self.kernel.degree
        if not self.held_out:
            return (
                "scattered light by one scalar: there are too few pictures to test a higher degree"
            )
        errors = ", ".join(f"{e:.2%} at degree {d}" for d, e in self.held_out.items())
        chosen = "one scalar per colour" if degree == 0 else f"degree {degree}"
        return f"error of scattered light in pictures held out of the fit: {errors}; {chosen} used"


class ScatterCells:
    """Assignment of camera pixels to cells of the dome.

    Parameters
    ----------
    direction : (H, W, 3) of the camera's pixels. solid_angle_sr : (H, W), 0 off the screen.
    """

    def __init__(self, direction: Image, solid_angle_sr: Array) -> None:
        place = np.rint(master_pixels(np.nan_to_num(direction), CELLS)).astype(np.intp)
        self._use = np.all((place >= 0) & (place < CELLS), axis=-1) & (solid_angle_sr > 0)
        self._index = place[self._use][:, 1] * CELLS + place[self._use][:, 0]
        self._all = np.bincount(self._index, minlength=CELLS**2)
        self._solid = solid_angle_sr[self._use]

    def scatter_sample(self, scattered: Image, known: BoolArray, direct: Image) -> ScatterSample:
        """Sample of scattered light (H, W, C), `known` (H, W), and its direct light (H, W, C)."""
        light = np.nan_to_num(direct[self._use])
        sums = self._sums(light * self._solid[:, None], self._index)
        mean, pixels = self.mean(scattered, known)
        return ScatterSample(mean, pixels, sums)

    def mean(self, picture: Image, known: BoolArray) -> tuple[Array, Array]:
        """Cell means (N, C), NaN where under `MIN_CELL_SHARE` is known, and pixel counts (N,)."""
        known = (known & np.isfinite(picture).all(axis=-1))[self._use]
        index = self._index[known]
        pixels = np.bincount(index, minlength=CELLS**2)
        whole = (pixels > MIN_CELL_SHARE * self._all) & (pixels > 0)
        mean = self._sums(picture[self._use][known], index) / np.maximum(pixels, 1)[:, None]
        return np.where(whole[:, None], mean, np.nan), np.where(whole, pixels, 0).astype(float)

    @staticmethod
    def _sums(values: FloatArray, index: IndexArray) -> Array:
        return np.stack([np.bincount(index, v, CELLS**2) for v in values.T], axis=1)


@cache
def cell_basis() -> Array:
    """Harmonics (CELLS^2, SIZE) at the centres of the cells."""
    direction, _ = master_directions(CELLS)
    return basis(direction.reshape(-1, 3), HIGHEST)


@dataclass(frozen=True, slots=True)
class ScatterSolution:
    """Scattered light of full white, and its dependence on the picture.

    Attributes
    ----------
    per_flux : (H, W, C) u of full white at camera pixels [1/sr]. in_cells : (N, C) its cell means.
    fit : the kernel.
    """

    per_flux: Image
    fit: ScatterFit
    in_cells: Array


def solve_scatter(
    lights: Iterable[SeparatedLight],
    samples: Sequence[ScatterSample],
    view: ScreenView,
    white: Array,
) -> ScatterSolution:
    """Estimate u, and fit the kernel with it.

    Parameters
    ----------
    lights : white of each projector. samples : of all pictures.
    white : (N, C) flux of full white on the whole dome, per cell [rel sr].
    """
    per_flux = estimate_scatter_per_flux(lights)
    mean, _ = ScatterCells(view.direction, view.weight).mean(per_flux, view.on_screen)
    return ScatterSolution(per_flux, fit_scatter(samples, mean, cell_basis().T @ white), mean)


def fit_scatter(samples: Sequence[ScatterSample], per_flux: Array, white: Array) -> ScatterFit:
    """Choose the kernel's degree by cross-validation, then fit it to all pictures.

    Parameters
    ----------
    samples : one per picture. per_flux : (N, C) scattered light of full white per unit of its flux
        [1/sr], NaN where unknown. white : (K, C) moments of full white on the whole dome.

    Raises
    ------
    OutOfModelRange
        If the light of full white is not known everywhere, or there is no scattered light.
    """
    channels, samples = white.shape[1], _bright(samples)
    if not np.isfinite(white).all():
        raise OutOfModelRange(
            "full white is unknown in some places; where its photographs are saturated, photograph "
            "with a shorter exposure_s"
        )
    if not (per_flux > 0).any():
        raise OutOfModelRange(
            "there is no scattered light above zero anywhere; check whether glare or black_level in "
            "venue.toml is too large"
        )
    each = [_Channel(samples, per_flux[:, c], white[:, c], c) for c in range(channels)]
    degrees = [d for d in range(HIGHEST + 1) if len(samples) >= max(2, MIN_PICTURES * d)]
    held_out = {d: float(np.mean([x.held_out_error(d) for x in each])) for d in degrees}
    degree = _simplest(held_out)
    fits = [x.fit(degree, np.ones(len(samples), bool)) for x in each]
    matrix, profile = (np.stack(part) for part in zip(*fits, strict=True))
    return ScatterFit(ScatterKernel(degree, matrix, profile), held_out)


def _bright(samples: Sequence[ScatterSample]) -> list[ScatterSample]:
    """The samples without pictures that hardly light the dome, such as parts of a panel that miss it."""
    flux = np.array([x.moment[0].mean() for x in samples])
    return [x for x, f in zip(samples, flux, strict=True) if f > MIN_FLUX * np.median(flux)]


def _simplest(held_out: dict[int, float]) -> int:
    """The lowest degree whose error no higher degree reduces clearly."""
    chosen = 0
    for degree, error in held_out.items():
        if error < MAX_ERROR_RATIO * held_out[chosen]:
            chosen = degree
    return chosen


class _Channel:
    """All pictures in one channel."""

    def __init__(
        self, samples: Sequence[ScatterSample], per_flux: Array, white: Array, channel: int
    ) -> None:
        on_dome = np.isfinite(per_flux) & (per_flux > 0)
        self._phi, self._white = cell_basis()[on_dome], white
        base = per_flux[on_dome]
        self._ratio = np.stack([x.scattered[on_dome, channel] / base for x in samples])
        # the variance of a cell's mean falls with its pixels; that of the ratio grows where u is small
        self._weight = np.stack([x.pixels[on_dome] * base**2 for x in samples])
        self._moment = np.stack([x.moment[:, channel] for x in samples])

    def fit(self, degree: int, pictures: BoolArray) -> tuple[Array, Array]:
        """Kernel and profile from a subset of pictures (P,)."""
        return self._measurements(degree).fit(pictures)

    def held_out_error(self, degree: int) -> float:
        """Relative rms error of each picture's scattered light, predicted from the others."""
        size = (degree + 1) ** 2
        measurements, count = self._measurements(degree), len(self._ratio)
        errors = []
        for p in range(count):
            matrix, profile = measurements.fit(np.arange(count) != p)
            expected = predicted_ratio(
                self._phi[:, :size], matrix, profile, self._moment[p : p + 1, :size]
            )[0]
            known = np.isfinite(self._ratio[p]) & (self._weight[p] > 0)
            if known.any():
                miss = (self._ratio[p] - expected)[known]
                weight = self._weight[p][known]
                scale = np.average(expected[known], weights=weight)
                errors.append(np.average(miss**2, weights=weight) / scale**2)
        return float(np.sqrt(np.mean(errors)))

    def _measurements(self, degree: int) -> ZoneMeasurements:
        size = (degree + 1) ** 2
        pictures = self._ratio, self._weight, self._moment[:, :size]
        return ZoneMeasurements.of(self._phi[:, :size], pictures, self._white[:size])
