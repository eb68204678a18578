"""How bounced light depends on where the direct light falls, as far as pictures show it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from procam.errors import OutOfModelRange
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.light.separation import SeparatedLight, scatter_per_flux
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.light.scatter_kernel import ZoneMeasurements, basis, predicted_ratio
from procam.maths.warp import sample
from procam.model.transport import ScatterKernel

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
CELLS = 32  # edge of the dome master whose pixels gather camera pixels: 6 degrees
HIGHEST = 2  # degree; above it nothing is earned in furnished rooms (studies/forward.md)
SIZE = (HIGHEST + 1) ** 2
ROUNDS = 2
BLACK_BLUR_PX = 4.0  # Gaussian sigma in camera pixels: black light is smooth, its noise is not
FEWEST = 4  # pictures per degree
DIM = 0.05  # of the pictures' median flux
WHOLE = 0.9  # of a cell's pixels must show nothing but bounced light
CLEARLY = 0.9  # a higher degree must err by less than this share of the lower one's error


@dataclass(frozen=True, slots=True)
class ScatterSample:
    """Bounced light of one picture in cells of the dome.

    Attributes
    ----------
    scattered : (N, C) mean per cell; NaN where direct light mixes in.
    pixels : (N,) camera pixels behind it.
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
        """The same in other channels, `matrix` (C, C) times the old ones."""
        return ScatterSample(self.scattered @ matrix.T, self.pixels, self.direct @ matrix.T)


@dataclass(frozen=True, slots=True)
class ScatterFit:
    """The kernel that the evidence chose.

    `held_out` by degree: rms error of the bounced light of pictures that took no part in the fit,
    relative to it. Empty where there were too few pictures to hold any out.
    """

    kernel: ScatterKernel
    held_out: dict[int, float]

    def explained(self) -> str:
        """One sentence for people: what was chosen, and on which evidence."""
        degree = self.kernel.degree
        if not self.held_out:
            return "bounced light by one scalar: there are too few pictures to test anything finer"
        errors = ", ".join(f"{e:.2%} at degree {d}" for d, e in self.held_out.items())
        chosen = "one scalar per colour" if degree == 0 else f"degree {degree}"
        return f"bounced light of pictures held out of the fit errs by {errors}: {chosen} taken"


class ScatterCells:
    """Camera pixels gathered into cells of the dome.

    Parameters
    ----------
    direction : (H, W, 3) what the camera's pixels see. solid_angle_sr : (H, W), 0 off the screen.
    """

    def __init__(self, direction: Image, solid_angle_sr: Array) -> None:
        place = np.rint(master_pixels(np.nan_to_num(direction), CELLS)).astype(np.intp)
        self._use = np.all((place >= 0) & (place < CELLS), axis=-1) & (solid_angle_sr > 0)
        self._index = place[self._use][:, 1] * CELLS + place[self._use][:, 0]
        self._all = np.bincount(self._index, minlength=CELLS**2)
        self._solid = solid_angle_sr[self._use]

    def scatter_sample(self, scattered: Image, known: Mask, direct: Image) -> ScatterSample:
        """Bounced light (H, W, C) where it is `known` (H, W), and the direct light behind it."""
        light = np.nan_to_num(direct[self._use])
        sums = self._sums(light * self._solid[:, None], self._index)
        mean, pixels = self.mean(scattered, known)
        return ScatterSample(mean, pixels, sums)

    def mean(self, picture: Image, known: Mask) -> tuple[Array, Array]:
        """Cell means (N, C), NaN where less than `WHOLE` of a cell is known, and pixels (N,)."""
        known = (known & np.isfinite(picture).all(axis=-1))[self._use]
        index = self._index[known]
        pixels = np.bincount(index, minlength=CELLS**2)
        whole = (pixels > WHOLE * self._all) & (pixels > 0)
        mean = self._sums(picture[self._use][known], index) / np.maximum(pixels, 1)[:, None]
        return np.where(whole[:, None], mean, np.nan), np.where(whole, pixels, 0).astype(float)

    @staticmethod
    def _sums(values: NDArray[np.floating], index: NDArray[np.intp]) -> Array:
        return np.stack([np.bincount(index, v, CELLS**2) for v in values.T], axis=1)


@cache
def cell_basis() -> Array:
    """Harmonics (CELLS^2, SIZE) at the cells' middles."""
    direction, _ = master_directions(CELLS)
    return basis(direction.reshape(-1, 3), HIGHEST)


@dataclass(frozen=True, slots=True)
class ScatterSolution:
    """Where bounced light goes.

    `per_flux` (H, W, C) u of full white at camera pixels [1/sr]; `strengths`, one (H, W, C) per
    projector, by how much more a unit of its white's flux brings; `fit` the kernel; `in_cells` (N, C)
    means of u.
    """

    per_flux: Image
    strengths: list[Image]
    fit: ScatterFit
    in_cells: Array


def solve_scatter(
    lights: Sequence[SeparatedLight],
    scatter_samples: Sequence[Sequence[ScatterSample]],
    view: DomeView,
    white: Array,
) -> ScatterSolution:
    """Fit u and the kernel in turn: what white brings is told by projectors that are not all of it.

    `scatter_samples` of each projector, its white first; `white` (N, C) flux of the whole dome's white.
    """
    moment = cell_basis().T @ white
    cells = ScatterCells(view.direction, view.solid_angle_sr)
    places = master_pixels(np.nan_to_num(view.direction), CELLS)
    strengths: list[Image] | None = None
    for _ in range(ROUNDS):
        per_flux = scatter_per_flux(lights, strengths)
        mean, _ = cells.mean(per_flux, view.on_screen)
        fit = fit_scatter([x for each in scatter_samples for x in each], mean, moment)
        whites = [each[0].moment for each in scatter_samples]
        strengths = [sample(_relative_gain(fit.kernel, m), places, 1.0) for m in whites]
    per_flux = scatter_per_flux(lights, strengths)
    return ScatterSolution(per_flux, strengths or [], fit, cells.mean(per_flux, view.on_screen)[0])


def _relative_gain(kernel: ScatterKernel, moment: Array) -> Image:
    """By how much more than full white's a unit of flux of these moments brings to each cell."""
    size = (kernel.degree + 1) ** 2
    phi = cell_basis()[:, :size]
    each = [
        predicted_ratio(phi, b, g, moment[None, :size, c])[0] / moment[0, c]
        for c, (b, g) in enumerate(zip(kernel.matrix, kernel.profile, strict=True))
    ]
    return np.stack(each, axis=-1).reshape(CELLS, CELLS, -1).astype(np.float32)


def fit_scatter(
    scatter_samples: Sequence[ScatterSample], per_flux: Array, white: Array
) -> ScatterFit:
    """Choose the kernel's degree by pictures held out, then fit it to all.

    Parameters
    ----------
    lightings : pictures. per_flux : (N, C) bounced light that a unit of white's flux brings [1/sr],
        NaN where unknown. white : (K, C) moments of full white on all the dome.
    """
    channels, scatter_samples = white.shape[1], _bright(scatter_samples)
    if not np.isfinite(white).all():
        raise OutOfModelRange(
            "full white: got light that is not known in places, expected all of it; where white is "
            "saturated, photograph with a shorter exposure_s"
        )
    if not (per_flux > 0).any():
        raise OutOfModelRange(
            "bounced light: got none above zero anywhere; is glare or black_level in venue.toml too large?"
        )
    each = [_Channel(scatter_samples, per_flux[:, c], white[:, c], c) for c in range(channels)]
    degrees = [d for d in range(HIGHEST + 1) if len(scatter_samples) >= max(2, FEWEST * d)]
    held_out = {d: float(np.mean([x.held_out_error(d) for x in each])) for d in degrees}
    degree = _simplest(held_out)
    fits = [x.fit(degree, np.ones(len(scatter_samples), bool)) for x in each]
    matrix, profile = (np.stack(part) for part in zip(*fits, strict=True))
    return ScatterFit(ScatterKernel(degree, matrix, profile), held_out)


def _bright(scatter_samples: Sequence[ScatterSample]) -> list[ScatterSample]:
    """Without pictures that hardly light the dome: parts of a panel that miss it."""
    flux = np.array([x.moment[0].mean() for x in scatter_samples])
    return [x for x, f in zip(scatter_samples, flux, strict=True) if f > DIM * np.median(flux)]


def _simplest(held_out: dict[int, float]) -> int:
    """The lowest degree that no higher one beats clearly."""
    chosen = 0
    for degree, error in held_out.items():
        if error < CLEARLY * held_out[chosen]:
            chosen = degree
    return chosen


class _Channel:
    """One colour of all pictures."""

    def __init__(
        self, scatter_samples: Sequence[ScatterSample], per_flux: Array, white: Array, channel: int
    ) -> None:
        on_dome = np.isfinite(per_flux) & (per_flux > 0)
        self._phi, self._white = cell_basis()[on_dome], white
        base = per_flux[on_dome]
        self._ratio = np.stack([x.scattered[on_dome, channel] / base for x in scatter_samples])
        # noise of a cell falls with its pixels; the ratio's grows where little bounces
        self._weight = np.stack([x.pixels[on_dome] * base**2 for x in scatter_samples])
        self._moment = np.stack([x.moment[:, channel] for x in scatter_samples])

    def fit(self, degree: int, pictures: Mask) -> tuple[Array, Array]:
        """Kernel and profile from some pictures."""
        return self._evidence(degree).fit(pictures)

    def held_out_error(self, degree: int) -> float:
        """Rms relative error of each picture's bounced light, predicted from the others."""
        size = (degree + 1) ** 2
        evidence, count = self._evidence(degree), len(self._ratio)
        errors = []
        for p in range(count):
            matrix, profile = evidence.fit(np.arange(count) != p)
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

    def _evidence(self, degree: int) -> ZoneMeasurements:
        size = (degree + 1) ** 2
        pictures = self._ratio, self._weight, self._moment[:, :size]
        return ZoneMeasurements.of(self._phi[:, :size], pictures, self._white[:size])
