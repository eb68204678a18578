"""Model room for the floor's albedo: a cap of one albedo over a level floor, and the wall between them.

Lengths are in radii of the dome, cells those of `scatter_kernel` (docs/theory/photometry.md, "The floor's
albedo").
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from procam.arrays import Array
from procam.estimate.light.scatter_kernel import CELLS
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.screen import Dome

RINGS, SECTORS = 16, 48  # of the floor's patches; half as many give 0.28 for a floor of 0.3
WALL_RINGS = 4


@dataclass(frozen=True, slots=True)
class Below:
    """What lies below the rim: irradiance (M, M) of the cap's cells per flux of each, by one reflection.

    `by_floor` for a white floor, `by_wall` for a white wall, whose albedo is `wall_albedo`.
    """

    by_floor: Array
    by_wall: Array
    wall_albedo: float = 0.0


class ModelRoom:
    """Scattered light in the cells of a cap of one albedo, over a floor and a wall.

    Irradiance E = H (b0 + rho E), with H of the sphere, the floor and the wall.
    """

    def __init__(self, dome: Dome, albedo: float, floor_albedo: float, below: Below) -> None:
        direction, _ = master_directions(CELLS)
        self.on_cap = direction[..., 2].ravel() >= np.cos(dome.half_angle)
        returned = floor_albedo * below.by_floor + below.wall_albedo * below.by_wall
        self._albedo, self._by_floor = albedo, below.by_floor
        self._exchange = 1 / (4 * np.pi) + returned
        # symmetric by the square root of the cells' areas, for a Cholesky factor
        self._root = np.sqrt(master_solid_angles(CELLS).ravel()[self.on_cap])
        reflected = albedo * self._root[:, None] * self._exchange * self._root
        self._factor = cho_factor(np.eye(len(reflected)) - reflected)

    def over_white(self, lights: Array) -> tuple[Array, Array]:
        """Scattered light (N, P) of direct flux (N, P + 1) over that of the last; NaN off the cap.

        Also its derivative (N, P) by the floor's albedo.
        """
        direct, root = lights[self.on_cap], self._root[:, None]
        light = cho_solve(self._factor, root * (self._exchange @ direct))
        leaving = direct + self._albedo * root * light
        change = cho_solve(self._factor, root * (self._by_floor @ leaving))
        ratio, slope = np.full((2, len(self.on_cap), lights.shape[1] - 1), np.nan)
        ratio[self.on_cap] = light[:, :-1] / light[:, -1:]
        slope[self.on_cap] = change[:, :-1] - ratio[self.on_cap] * change[:, -1:]
        slope[self.on_cap] /= light[:, -1:]
        return ratio, slope


def below_rim(dome: Dome, drop: float) -> Below:
    """A floor `drop` below the rim's lowest point, at the end of a black wall."""
    depth = -np.cos(min(dome.half_angle + abs(dome.tilt), np.pi))
    radius = np.sqrt(1 - depth**2)
    floor, wall = _floor(radius, depth + drop), _wall(radius, depth, depth + drop)
    return Below(_exchange(dome, *floor), _exchange(dome, *wall))


def _floor(radius: float, depth: float) -> tuple[Array, Array, Array]:
    """Centres (Q, 3), normals (Q, 3) and areas (Q,) of patches of a level disc; the third axis points up."""
    edges = np.linspace(0, radius, RINGS + 1)
    r, turn = _rings((edges[1:] + edges[:-1]) / 2)
    centre = np.stack([r * np.cos(turn), r * np.sin(turn), np.full(len(r), -depth)], axis=1)
    normal = np.broadcast_to([0.0, 0.0, 1.0], centre.shape)
    return centre, normal, np.repeat(np.pi * np.diff(edges**2) / SECTORS, SECTORS)


def _wall(radius: float, top: float, bottom: float) -> tuple[Array, Array, Array]:
    """The same of an upright round wall between two depths."""
    edges = np.linspace(top, bottom, WALL_RINGS + 1)
    depth, turn = _rings((edges[1:] + edges[:-1]) / 2)
    outwards = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], axis=1)
    area = 2 * np.pi * radius * (bottom - top) / (WALL_RINGS * SECTORS)
    centre = radius * outwards - depth[:, None] * [0.0, 0.0, 1.0]
    return centre, -outwards, np.full(len(centre), area)


def _rings(place: Array) -> tuple[Array, Array]:
    """Place of each ring and angle of each sector (Q,) [rad], for every patch."""
    all_places, turn = np.meshgrid(place, 2 * np.pi * np.arange(SECTORS) / SECTORS, indexing="ij")
    return all_places.ravel(), turn.ravel()


def _exchange(dome: Dome, centre: Array, normal: Array, area: Array) -> Array:
    """Irradiance (M, M) of the cap's cells per flux of each, by one reflection from white patches."""
    direction, _ = master_directions(CELLS)
    cap = direction.reshape(-1, 3)
    cap = cap[cap[:, 2] >= np.cos(dome.half_angle)]
    along = cap @ (centre @ _level_axes(dome)).T
    square = np.maximum(1 + np.sum(centre**2, axis=1) - 2 * along, 1e-9)
    leaving = np.maximum(1 - along, 0)
    height = cap @ (normal @ _level_axes(dome)).T - np.sum(centre * normal, axis=1)
    between = leaving * np.maximum(height, 0) / (np.pi * square**2)
    return np.asarray((between * area) @ between.T)


def _level_axes(dome: Dome) -> Array:
    """Rows: ahead, left and up of the room, in the dome's frame."""
    sin, cos = np.sin(dome.tilt), np.cos(dome.tilt)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
