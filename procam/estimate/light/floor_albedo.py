"""Albedo of the floor under the dome, from the spatial distribution of the light that it reflects.

Feedback alone cannot separate a bright screen over a dark floor from a darker one over a bright floor.
But scattered light of a bare sphere is uniform, wherever the direct light falls, while a floor returns
more to the side that the light came from. So the scattered light of each picture is compared with that
of a model room, a cap of one albedo over one level floor, and the floor's albedo follows by linear
least squares (docs/theory/photometry.md, "The floor's albedo"). The scale of each picture is free, so that
gloss, drift and a wrong flux do not bias the result.

Light from a floor that lies lower, below a wall, comes back more evenly, like that of a brighter screen,
and so does what the wall itself returns. Neither depth nor brightness of the wall is known: several
combinations are fitted and averaged by likelihood, and their spread is in the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray
from procam.errors import OutOfModelRange
from procam.estimate.light.model_room import Below, ModelRoom, below_rim
from procam.estimate.light.scatter_kernel import ScatterSample
from procam.model.provenance import Note
from procam.model.screen import Dome

ROUNDS = 3
MAX_ALBEDO = 0.95
MIN_PICTURES = 4  # for a standard deviation
INDEPENDENT = 5  # values of a picture's scattered light, which is smooth: few harmonics
INCONSISTENT = 0.06  # relative; 3 % of gloss cause half of it
MAX_INCONSISTENT = 0.5  # relative; a person in all photographs makes 0.18 (studies/mistakes.json)
UNKNOWN_INCONSISTENCY = 0.01  # relative, with fewer pictures
DROPS = (0.05, 0.1, 0.2, 0.35, 0.5)  # of a floor below the rim's lowest point [radii]
WALLS = (0.05, 0.25)  # albedo of the wall between, which is dark or grey
MODEL_SIGMA = 0.15  # of the albedo, or of `LEAST_ALBEDO`: seats, steps and walls are no level floor
LEAST_ALBEDO = 0.1
MIN_SIGMA = 1e-6  # of a floor albedo in venue.toml
MAX_DISCREPANCY = 3.0  # sigmas, between the floor albedo in venue.toml and the measured one


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorAt:
    """The floor at one depth.

    `albedo`, `sigma` by the pictures. `share`: the light that it returns to the screen, over that of a
    floor of the same albedo in the rim's plane; `wall`: the albedo of a floor there that returns what the
    wall does. `misfit`: sum of squares that it leaves of the pictures. `weight`: of this depth.
    """

    albedo: float
    sigma: float
    share: float = 1.0
    wall: float = 0.0
    misfit: float = 0.0
    weight: float = 1.0


@dataclass(frozen=True, slots=True)
class FloorLight:
    """Result of comparing the pictures with the model room.

    `depths` has the floor at the rim, and at each of `DROPS` below each of `WALLS`. `flux_inconsistency`:
    relative spread of the ratio of the pictures' scattered light to their direct light; gloss hides direct
    light from a camera, unevenly.
    """

    depths: Sequence[FloorAt]
    flux_inconsistency: float

    @property
    def albedo(self) -> float:
        """Weighted mean over depths."""
        return self.mixture([(at.albedo, at.sigma) for at in self.depths])[0]

    @property
    def sigma(self) -> float:
        """Standard error of `albedo`."""
        return self.mixture([(at.albedo, at.sigma) for at in self.depths])[1]

    def mixture(self, each: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Mean and standard deviation over depths of values with standard errors."""
        weights = np.array([at.weight for at in self.depths])
        value, sigma = np.array(each).T
        mean = np.average(value, weights=weights)
        return float(mean), float(
            np.sqrt(np.average(sigma**2 + (value - mean) ** 2, weights=weights))
        )


def measure_floor(
    samples: Sequence[ScatterSample], per_flux: Array, white: Array, dome: Dome, albedo: float
) -> FloorLight:
    """Estimate the floor's albedo from pictures with light on parts of the dome.

    Parameters
    ----------
    samples : one per picture. per_flux : (N, C) u per cell. white : (N, C) flux of full white.
    dome : its shape; the floor is the level plane through the rim's lowest point.
    albedo : of the screen, roughly.

    Notes
    -----
    The standard error is a jackknife over the pictures, plus `MODEL_SIGMA`.
    """
    lights = np.stack([*(x.direct.mean(axis=1) for x in samples), white.mean(axis=1)], axis=1)
    pictures = _Pictures(samples, per_flux, lights, albedo)
    lower = [below_rim(dome, drop) for drop in DROPS]
    below = [below_rim(dome, 0.0), *(replace(b, wall_albedo=wall) for b in lower for wall in WALLS)]
    depths = [_floor_at(pictures, dome, each, below[0]) for each in below]
    room = ModelRoom(dome, albedo, depths[0].albedo, below[0])
    return FloorLight(_weighted(dome, depths, len(samples)), _flux_inconsistency(room, pictures))


@dataclass(frozen=True, slots=True)
class _Pictures:
    """What `measure_floor` is given of the pictures and of the screen.

    `lights` (N, P + 1) is the direct flux of each picture, and of full white, in each cell.
    """

    samples: Sequence[ScatterSample]
    per_flux: Array
    lights: Array
    screen_albedo: float

    def known(self, sample: ScatterSample) -> BoolArray:
        """Cells (N,) in which scattered light of a picture and of white is known."""
        finite = np.isfinite(sample.scattered + self.per_flux).all(axis=1)
        return np.asarray((sample.pixels > 0) & finite)


def _floor_at(pictures: _Pictures, dome: Dome, below: Below, at_rim: Below) -> FloorAt:
    """The floor at one depth."""
    floor, sigma, misfit = dome.floor_albedo, np.inf, 0.0
    returned = below.by_floor, below.wall_albedo * below.by_wall
    share, wall = (float(e.sum() / at_rim.by_floor.sum()) for e in returned)
    for _ in range(ROUNDS):
        room = ModelRoom(dome, pictures.screen_albedo, floor, below)
        expected, slope = room.over_white(pictures.lights)
        both = zip(pictures.samples, expected.T, slope.T, strict=True)
        each = np.array([_normal_equation(pictures, *one) for one in both])
        top, bottom, misfit = each.sum(axis=0)  # stationary: the last change hardly alters it
        if not bottom > 0:
            sigma = np.inf
            break
        others = (top - each[:, 0]) / np.maximum(bottom - each[:, 1], 1e-300)
        floor = float(np.clip(floor + top / bottom, 0, MAX_ALBEDO))
        sigma = float(np.sqrt((len(each) - 1) * np.var(others)))
    sigma = float(np.hypot(sigma, MODEL_SIGMA * max(floor, LEAST_ALBEDO)))
    return FloorAt(albedo=floor, sigma=sigma, share=share, wall=wall, misfit=misfit)


def _weighted(dome: Dome, depths: Sequence[FloorAt], pictures: int) -> list[FloorAt]:
    """The depths with their weights, which sum to 1."""
    off = np.array([_discrepancy(dome, at) for at in depths])
    sigma = np.array([_difference_sigma(dome, at) for at in depths])
    misfit = np.maximum([at.misfit for at in depths], 1e-300)
    off2 = off**2 + INDEPENDENT * pictures * np.log(misfit / misfit.min())
    likely = np.exp(-0.5 * (off2 - off2.min())) / np.where(np.isfinite(sigma), sigma, 1.0)
    return [
        replace(at, weight=float(w)) for at, w in zip(depths, likely / likely.sum(), strict=True)
    ]


def _flux_inconsistency(room: ModelRoom, pictures: _Pictures) -> float:
    """Relative spread of the pictures' scattered light over that of the room for their direct light."""
    all_expected = room.over_white(pictures.lights)[0] * pictures.lights[:, -1].sum()
    scales = []
    for x, expected in zip(pictures.samples, all_expected.T, strict=True):
        known = pictures.known(x) & room.on_cap
        if known.any():
            seen = x.scattered[known].mean(axis=1) / pictures.per_flux[known].mean(axis=1)
            weight = x.pixels[known]
            scales.append((weight @ seen) / (weight @ expected[known]))
    return float(np.std(scales)) if len(scales) >= MIN_PICTURES else UNKNOWN_INCONSISTENCY


def _normal_equation(
    pictures: _Pictures, sample: ScatterSample, expected: Array, slope: Array
) -> tuple[float, float, float]:
    """Right and left side of one picture's normal equation for the change of floor albedo, and its misfit.

    `expected` (N,) is its scattered light over that of white in the model room, and `slope` its derivative
    by the floor's albedo; NaN off the cap.
    """
    known = pictures.known(sample) & np.isfinite(expected)
    if not known.any():
        return 0.0, 0.0, 0.0
    base = pictures.per_flux[known].mean(axis=1)
    weight = sample.pixels[known] * base**2
    seen = sample.scattered[known].mean(axis=1) / base
    scale = np.average(expected[known], weights=weight)
    model = expected[known] / scale
    slope = (slope[known] - model * np.average(slope[known], weights=weight)) / scale
    mean = np.average(seen, weights=weight)
    residual = seen / mean - model
    weight = weight * mean**2  # a brighter picture has a smaller relative error
    return (
        float(weight @ (slope * residual)),
        float(weight @ slope**2),
        float(weight @ residual**2),
    )


def combined_floor_albedo(dome: Dome, measured: FloorLight) -> tuple[float, float]:
    """Albedo of the floor in the rim's plane that returns as much light, and its standard error.

    At each depth it is the weighted mean of the value in venue.toml and the measured one. If they differ by
    more than their errors, both get the same further variance, which explains it (DerSimonian and Laird
    1986, doi:10.1016/0197-2456(86)90046-2). Where they agree at a lower depth alone, the floor may as well
    lie at the rim and venue.toml be wrong: the error covers both.
    """
    each = []
    for at in measured.depths:
        value, sigma = _combined(dome, at)
        each.append((at.wall + at.share * value, at.share * sigma))
    mean, spread = measured.mixture(each)
    at_rim = measured.depths[0]
    if _discrepancy(dome, at_rim) < MAX_DISCREPANCY:
        return mean, spread
    return mean, float(np.hypot(spread, (1 - at_rim.weight) * (mean - at_rim.albedo)))


def _combined(dome: Dome, at: FloorAt) -> tuple[float, float]:
    """Mean of the floor albedo in venue.toml and the measured one, and its standard error."""
    variance = np.array([max(dome.floor_albedo_sigma, MIN_SIGMA), at.sigma]) ** 2
    further = max(0.0, ((at.albedo - dome.floor_albedo) ** 2 - float(variance.sum())) / 2)
    weights = 1 / (variance + further)
    value = np.average([dome.floor_albedo, at.albedo], weights=weights)
    return float(value), float(weights.sum() ** -0.5)


def _discrepancy(dome: Dome, at: FloorAt) -> float:
    """Difference between the floor albedo in venue.toml and the measured one [sigmas]."""
    return abs(at.albedo - dome.floor_albedo) / _difference_sigma(dome, at)


def _difference_sigma(dome: Dome, at: FloorAt) -> float:
    return float(np.hypot(max(dome.floor_albedo_sigma, MIN_SIGMA), at.sigma))


def flux_notes(measured: FloorLight) -> list[Note]:
    """A note for the report if direct and scattered light of the pictures contradict each other.

    Raises
    ------
    OutOfModelRange
        If they do so much that the pictures cannot be those that were shown.
    """
    if measured.flux_inconsistency < INCONSISTENT:
        return []
    if measured.flux_inconsistency > MAX_INCONSISTENT:
        raise OutOfModelRange(
            f"direct and scattered light of pictures disagree by {measured.flux_inconsistency:.0%}, more "
            f"than {MAX_INCONSISTENT:.0%}: some photographs are not of the pictures that were to be shown. "
            "Check that no projector was mirrored, blanked or exchanged meanwhile, and photograph again"
        )
    text = (
        f"direct and scattered light of pictures disagree by {measured.flux_inconsistency:.0%}, more than "
        "paint's gloss explains, so m and albedo are hardly known: check vignetting and black_level"
    )
    return [Note("flux disagrees", "", text, measured.flux_inconsistency / INCONSISTENT)]


def floor_notes(dome: Dome, measured: FloorLight) -> list[Note]:
    """A note for the report if the measured albedo of a floor at the rim contradicts venue.toml."""
    at_rim, nearest = measured.depths[0], min(_discrepancy(dome, at) for at in measured.depths)
    if _discrepancy(dome, at_rim) < MAX_DISCREPANCY:
        return []
    stated = f"floor_albedo is {dome.floor_albedo:g} +- {dome.floor_albedo_sigma:g} in venue.toml"
    found = f"{at_rim.albedo:.2f} +- {at_rim.sigma:.2f}"
    text = (
        f"{stated}, which the light agrees with if the floor lies well below the dome's rim; if it does not, "
        f"it is {found}: compare it with a grey card"
        if nearest < MAX_DISCREPANCY
        else f"{stated}, but {found} by the light that the floor returns; only the albedo of the screen "
        "depends on it"
    )
    return [Note("floor albedo", "", text, _discrepancy(dome, at_rim) / MAX_DISCREPANCY)]
