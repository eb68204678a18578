"""How much of its light a dome's floor returns, told by the shape of what it returns.

Light of a bare sphere spreads evenly, wherever it fell. A floor returns more to the side that it came
from: that share tells the floor's albedo, so that the screen's own can be told from feedback without
anybody holding a card to the carpet.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from procam.estimate.light.scatter_kernel import CELLS, ScatterSample
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.screen import Dome

Array = NDArray[np.float64]
RINGS, SECTORS = 16, 48  # half as many tell a floor of .3 as .28
STEP = 0.1  # of floor albedo, for slopes
ROUNDS = 2
LARGEST = 0.95
FEWEST = 4  # pictures, for a spread
UNKNOWN_DOUBT = 0.01  # where pictures are too few to tell
MODEL_SIGMA = 0.1  # of the value: seats and steps are no level floor


@dataclass(frozen=True, slots=True)
class FloorLight:
    """What a model room of one cap and one floor makes of the pictures.

    `albedo`, `sigma` of the floor. `flux_doubt`: by how much, relative, the pictures' direct light differs
    from what their bounced light asks for; gloss hides direct light from a camera, here more, there less.
    """

    albedo: float
    sigma: float
    flux_doubt: float


def measure_floor(
    scatter_samples: Sequence[ScatterSample],
    per_flux: Array,
    white: Array,
    dome: Dome,
    albedo: float,
) -> FloorLight:
    """The floor's albedo from pictures with light on parts of the dome.

    Parameters
    ----------
    lightings : pictures. per_flux : (N, C) u per cell. white : (N, C) flux of the whole dome's white.
    dome : its shape; the floor is the level plane through the rim's lowest point.
    albedo : of the screen, roughly.

    Notes
    -----
    Compares the shapes that bounced light has with those of a model room; each picture's own scale is
    free, so that gloss, drift and a wrong flux do not count. Sigma from leaving out each picture.
    """
    floor, sigma, by_floor = dome.floor_albedo, np.inf, _floor_exchange(dome)
    for _ in range(ROUNDS):
        rooms = [_Room(dome, albedo, f, by_floor) for f in (floor, floor + STEP)]
        sums = np.array([_against(rooms, x, per_flux, white) for x in scatter_samples])
        top, bottom = sums.sum(axis=0)
        if not bottom > 0:
            return FloorLight(dome.floor_albedo, np.inf, UNKNOWN_DOUBT)
        others = (top - sums[:, 0]) / np.maximum(bottom - sums[:, 1], 1e-300)
        floor = float(np.clip(floor + top / bottom, 0, LARGEST))
        sigma = float(np.sqrt((len(sums) - 1) * np.var(others)))
    doubt = _flux_inconsistency(
        _Room(dome, albedo, floor, by_floor), scatter_samples, per_flux, white
    )
    return FloorLight(floor, float(np.hypot(sigma, MODEL_SIGMA * floor)), doubt)


def _flux_inconsistency(
    room: "_Room", scatter_samples: Sequence[ScatterSample], per_flux: Array, white: Array
) -> float:
    """Spread of the pictures' bounced light over what the room makes of their direct light."""
    brought = room.returned(white.mean(axis=1)) / white.mean(axis=1).sum()
    scales = []
    for x in scatter_samples:
        known = (x.pixels > 0) & np.isfinite(x.scattered + per_flux).all(axis=1) & room.on_cap
        if known.any():
            expected = (room.returned(x.direct.mean(axis=1)) / brought)[known]
            seen = x.scattered[known].mean(axis=1) / per_flux[known].mean(axis=1)
            weight = x.pixels[known]
            scales.append((weight @ seen) / (weight @ expected))
    return float(np.std(scales)) if len(scales) >= FEWEST else UNKNOWN_DOUBT


def _against(
    rooms: Sequence["_Room"], picture: ScatterSample, per_flux: Array, white: Array
) -> tuple[float, float]:
    """Weighted products of a slope with what the first room leaves unexplained, and with itself."""
    known = (picture.pixels > 0) & np.isfinite(picture.scattered + per_flux).all(axis=1)
    known &= rooms[0].on_cap
    if not known.any():
        return 0.0, 0.0
    base = per_flux[known].mean(axis=1)
    weight = picture.pixels[known] * base**2
    light, all_light = picture.direct.mean(axis=1), white.mean(axis=1)
    seen = picture.scattered[known].mean(axis=1) / base
    expected, steeper = (
        _scaled((room.returned(light) / room.returned(all_light))[known], weight) for room in rooms
    )
    slope = (steeper - expected) / STEP
    # how bright the picture is decides how well its shape is known
    weight = weight * np.average(seen, weights=weight) ** 2
    left = _scaled(seen, weight) - expected
    return float(weight @ (slope * left)), float(weight @ slope**2)


def _scaled(ratio: Array, weight: Array) -> Array:
    return np.asarray(ratio / np.average(ratio, weights=weight))


def floor_of(dome: Dome, measured: FloorLight) -> tuple[float, float]:
    """Floor albedo and sigma from what the venue's owner knows and what was measured.

    Where they contradict each other neither is trusted to its sigma (Birge's ratio).
    """
    known = (dome.floor_albedo, max(dome.floor_albedo_sigma, 1e-6))
    weights = np.array([1 / known[1] ** 2, 1 / measured.sigma**2])
    value = np.average([known[0], measured.albedo], weights=weights)
    doubted = max(1.0, contradiction(dome, measured))
    return float(value), float(doubted * weights.sum() ** -0.5)


def contradiction(dome: Dome, measured: FloorLight) -> float:
    """How many sigmas the owner's floor and the measured one are apart."""
    return abs(measured.albedo - dome.floor_albedo) / float(
        np.hypot(max(dome.floor_albedo_sigma, 1e-6), measured.sigma)
    )


class _Room:
    """A cap of one albedo over a level floor, in cells; lengths in radii of the dome.

    `by_floor` is what the floor exchanges between cells for an albedo of 1, from `_floor_exchange`.
    """

    def __init__(self, dome: Dome, albedo: float, floor_albedo: float, by_floor: Array) -> None:
        direction, _ = master_directions(CELLS)
        self.on_cap = direction[..., 2].ravel() >= np.cos(dome.half_angle)
        # E = H (b0 + rho E), H by the sphere and by the floor
        self._exchange = 1 / (4 * np.pi) + floor_albedo * by_floor
        self._root = np.sqrt(master_solid_angles(CELLS).ravel()[self.on_cap])
        left = np.eye(len(by_floor)) - albedo * self._root[:, None] * self._exchange * self._root
        self._factor = cho_factor(left)

    def returned(self, flux: Array) -> Array:
        """Bounced light (N,) per albedo from direct light of flux (N,) per cell, all bounces."""
        light = np.full(len(self.on_cap), np.nan)
        once = self._exchange @ flux[self.on_cap]
        light[self.on_cap] = cho_solve(self._factor, self._root * once) / self._root
        return light


def _floor_exchange(dome: Dome) -> Array:
    """Light (M, M) that cells of the cap send each other by a white floor, per flux."""
    direction, _ = master_directions(CELLS)
    cap = direction.reshape(-1, 3)
    cap = cap[cap[:, 2] >= np.cos(dome.half_angle)]
    place, up, size = _floor(dome)
    apart = place[None] - cap[:, None]
    square = np.maximum(np.sum(apart**2, axis=-1), 1e-9)
    leaves = np.maximum(-np.sum(cap[:, None] * apart, axis=-1), 0)
    between = leaves * np.maximum(-(apart @ up), 0) / (np.pi * square**2)
    return np.asarray((between * size) @ between.T)


def _floor(dome: Dome) -> tuple[Array, Array, Array]:
    """Middles (Q, 3) of the floor's patches, the way up (3,), and their areas (Q,)."""
    depth = -np.cos(min(dome.half_angle + abs(dome.tilt), np.pi))
    up = np.array([-np.sin(dome.tilt), 0.0, np.cos(dome.tilt)])
    ahead, left = np.array([np.cos(dome.tilt), 0.0, np.sin(dome.tilt)]), np.array([0.0, 1.0, 0.0])
    edges = np.linspace(0, np.sqrt(1 - depth**2), RINGS + 1)
    radius, angle = (edges[1:] + edges[:-1]) / 2, 2 * np.pi * np.arange(SECTORS) / SECTORS
    r, turn = (x.ravel() for x in np.meshgrid(radius, angle, indexing="ij"))
    place = (r * np.cos(turn))[:, None] * ahead + (r * np.sin(turn))[:, None] * left - depth * up
    return place, up, np.repeat(np.pi * np.diff(edges**2) / SECTORS, SECTORS)
