"""The forms of inter-reflection that the study `forward` compares, on patches of a dome."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.estimate.light.scatter_kernel import CELLS, ScatterSample, cell_basis, fit_scatter
from procam.maths.geometry.sphere import direction_from_angles, master_pixels
from procam.maths.light.radiosity import add_interreflection, sphere_scatter
from procam.maths.light.scatter_kernel import basis, moments, predicted_ratio
from simulators.transport import DOME_RINGS, DOME_SECTORS
from studies.closed_forms import add_interreflection_paper, add_zoned_interreflection

Array = NDArray[np.float64]
PATCHES = DOME_RINGS * DOME_SECTORS
RING, SECTOR = np.divmod(np.arange(PATCHES), DOME_SECTORS)


@dataclass(frozen=True)
class Dome:
    """The inputs of a form: `solid_angle_sr` and `albedo` (N, 1) of a dome's patches, which are `lit`.

    `returned` is the share of light that the floor returns.
    """

    name: str
    kind: str
    solid_angle_sr: Array
    albedo: Array
    lit: NDArray[np.bool_]
    returned: float


@dataclass(frozen=True)
class Picture:
    """Direct and scattered radiosity (N, 1) of the patches, with the standard error of the latter."""

    name: str
    direct: Array
    scattered: Array
    error: Array


@dataclass(frozen=True)
class Form:
    """A prediction of scattered radiosity (N, 1) from a dome, training pictures and direct light.

    Training pictures are white on each of twelve zones; together they are full white.
    """

    name: str
    predict: Callable[[Dome, Sequence[Picture], Array], Array]


def paper_eq_10(dome: Dome, training: Sequence[Picture], direct: Array) -> Array:
    """Paper eq. 10 with the lit area alone."""
    lit, scattered = dome.lit, np.full_like(direct, np.nan)
    albedo = float(dome.albedo[lit].mean())
    total = add_interreflection_paper(direct[lit], albedo, dome.solid_angle_sr[lit])
    scattered[lit] = total - direct[lit]
    return scattered


def one_scalar(dome: Dome, training: Sequence[Picture], direct: Array) -> Array:
    """The closed form with all that reflects and the floor's mean."""
    scatter = sphere_scatter(dome.albedo, dome.solid_angle_sr, dome.returned)
    return add_interreflection(direct, scatter, dome.solid_angle_sr) - direct


def measured(dome: Dome, training: Sequence[Picture], direct: Array) -> Array:
    """The scattered light of full white per flux."""
    white = sum(t.direct for t in training)
    scatter = sum(t.scattered for t in training) / (dome.solid_angle_sr @ white)
    return add_interreflection(direct, scatter, dome.solid_angle_sr) - direct


def measured_by_zones(dome: Dome, training: Sequence[Picture], direct: Array) -> Array:
    """The scattered light of white on each zone per flux."""
    scatter = np.stack([t.scattered / (dome.solid_angle_sr @ t.direct) for t in training])
    collect = np.stack([(t.direct[:, 0] > 0) * dome.solid_angle_sr for t in training])
    return add_zoned_interreflection(direct, scatter, collect) - direct


def chosen_by_evidence(dome: Dome, training: Sequence[Picture], direct: Array) -> Array:
    """The scatter kernel with the degree that held-out pictures choose, as in a calibration.

    Two projectors share the dome and show six zones each; from their whites, stripes separate the
    scattered light also where direct light falls.
    """
    flux = dome.solid_angle_sr @ sum(t.direct for t in training)
    per_flux = sum(t.scattered for t in training) / flux
    zones = [_sample(dome, t, t.direct[:, 0] == 0) for t in training]
    white, everywhere = sum(x.direct for x in zones), np.ones(PATCHES, bool)
    halves = [training[i : i + len(training) // 2] for i in (0, len(training) // 2)]
    samples = zones + [_sample(dome, _together(h), everywhere) for h in halves]
    kernel = fit_scatter(samples, _in_cells(per_flux), cell_basis().T @ white).kernel
    phi = basis(patch_directions(), kernel.degree)
    moment = moments(direct, dome.solid_angle_sr, phi)[:, 0]
    ratio = predicted_ratio(phi, kernel.matrix[0], kernel.profile[0], moment[None])
    return per_flux * ratio.T


def _together(pictures: Sequence[Picture]) -> Picture:
    """Several pictures shown at once."""
    direct, scattered = sum(p.direct for p in pictures), sum(p.scattered for p in pictures)
    return Picture("together", direct, scattered, np.zeros_like(scattered))


def _sample(dome: Dome, picture: Picture, dark: NDArray[np.bool_]) -> ScatterSample:
    """A picture as a camera measures it: scattered light where no other light is."""
    seen = _in_cells(np.where(dark[:, None], picture.scattered, np.nan))
    flux = picture.direct[:, 0] * dome.solid_angle_sr
    direct = np.bincount(_cell(), flux, CELLS**2)[:, None]
    pixels = np.isfinite(seen[:, 0]) * np.bincount(_cell(), minlength=CELLS**2)
    return ScatterSample(seen, pixels.astype(float), direct)


def _in_cells(values: Array) -> Array:
    """Means (K, 1) of patches (N, 1) over the cells of a calibration's fit; NaN where one is unknown."""
    count = np.bincount(_cell(), minlength=CELLS**2)
    sums = np.bincount(_cell(), values[:, 0], CELLS**2)
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)[:, None]


def _cell() -> NDArray[np.intp]:
    place = np.rint(master_pixels(patch_directions(), CELLS)).astype(np.intp)
    column, row = place.clip(0, CELLS - 1).T
    return row * CELLS + column


def patch_directions() -> Array:
    """Unit vectors (N, 3) to the patches' centres."""
    z, azimuth = 1 - (RING + 0.5) / DOME_RINGS, (SECTOR + 0.5) / DOME_SECTORS * 2 * np.pi
    return direction_from_angles(azimuth, np.arcsin(z))


FORMS = (
    Form("paper eq. 10, lit area alone", paper_eq_10),
    Form("closed form, all that reflects", one_scalar),
    Form("measured from white", measured),
    Form("measured from zones", measured_by_zones),
    Form("chosen by held-out zones", chosen_by_evidence),
)
