"""Path-traced light in a room, of a dome as built or of any mesh (extra `sim`).

It checks `simulators.transport`, with which it shares the layout of the patches and nothing else: the
room is a mesh of triangles, and Mitsuba traces its light.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, IndexArray
from procam.maths.geometry.sphere import normalise
from simulators import transport
from simulators.mitsuba_paths import PatchedMesh, scattered_irradiance
from simulators.surface import GORES, Surface
from simulators.transport import Deck, Room

Faces = NDArray[np.integer[Any]]
SAMPLES = 1 << 15  # rays from each patch, for 0.1 % of the light
COLUMNS = 15 * GORES  # of faces round the room, so that edges of panels are edges of faces
DOME_STEP = np.radians(1.5)  # height of a face
POD_STEP = np.radians(2.0)
PAINT_CUTS = 5  # a face's albedo is the mean over 25 places: seams are narrower than faces


@dataclass(frozen=True)
class PathTracedRoom(Room):
    """A room whose scattered light is path-traced whenever it is asked for.

    It replaces the `Room` it was made of. `samples`, a power of two, is how many rays leave
    each patch; a room of the usual size takes a minute for 32768, with LLVM on two cores.
    """

    samples: int = SAMPLES
    seed: int = 0

    @classmethod
    def of(cls, room: Room, samples: int = SAMPLES, seed: int = 0) -> "PathTracedRoom":
        """The same room with another tracer."""
        return cls(
            room.surface, room.exchange, room.area_m2, room.albedo, room.scatter, samples, seed
        )

    def repainted(self, surface: Surface) -> "PathTracedRoom":
        """The same room with the paint of `surface`."""
        return PathTracedRoom.of(super().repainted(surface), self.samples, self.seed)

    def irradiance(self, direct_flux: Array) -> Array:
        """Scattered irradiance (P, C) after all bounces from direct reflected flux (P, C)."""
        return self.irradiance_and_error(direct_flux)[0]

    def irradiance_and_error(self, direct_flux: Array) -> tuple[Array, Array]:
        """Scattered irradiance (P, C) from direct reflected flux (P, C), and its standard error."""
        if not self.surface.preset.bounces:
            return np.zeros(direct_flux.shape), np.zeros(direct_flux.shape)
        mesh = room_mesh(self.surface, direct_flux.shape[1])
        area = np.bincount(mesh.patch, mesh.areas_m2())
        direct = (direct_flux / area[:, None])[mesh.patch]
        return scattered_irradiance(mesh, direct, self.samples, self.seed)


def scattered_radiosity(
    vertices: Array, faces: Faces, albedo: Array, direct: Array, spp: int, seed: int = 0
) -> tuple[Array, Array]:
    """Scattered radiosity (F, C), the mean over each face, and its standard error (F, C).

    Parameters
    ----------
    vertices : (V, 3). faces : (F, 3), counter-clockwise seen from inside; their backs are black.
    albedo : (F, C) reflectance, 0 to below 1.
    direct : (F, C) radiosity after the first bounce.
    spp : rays from each face, a power of two.

    Raises
    ------
    InputError
        If mitsuba is not installed, or the arrays do not belong together.
    """
    matte = np.zeros((len(faces), 1))
    mesh = PatchedMesh(vertices, faces, np.arange(len(faces)), albedo, matte)
    light, error = scattered_irradiance(mesh, direct, spp, seed)
    return albedo * light, albedo * error


def room_mesh(surface: Surface, channels: int = 1) -> PatchedMesh:
    """Dome, deck, wall and pod of a venue as built, over the patches of `transport.Room`."""
    preset = surface.preset
    deck = Deck.under(preset)
    parts, albedos = [_deck(deck)], [preset.floor_albedo]
    if deck.wall_m:
        parts, albedos = [*parts, _wall(deck)], [*albedos, preset.wall_albedo]
    if preset.pod:
        parts, albedos = [*parts, _pod()], [*albedos, transport.POD_ALBEDO]
    plain = [np.full(len(p.corners), a) for p, a in zip(parts, albedos, strict=True)]
    parts = [_dome(surface), *parts]
    corners = [part.corners for part in parts]
    albedo = [_mean_albedo(surface, corners[0]), *plain]
    first = np.cumsum([0, *(part.patches for part in parts)])
    patch = [part.patch + start for part, start in zip(parts, first[:-1], strict=True)]
    every = np.concatenate(corners)
    paint = np.repeat(np.concatenate(albedo)[:, None], channels, axis=1)
    on_dome = np.arange(len(every)) < len(corners[0])
    return PatchedMesh(
        every.reshape(-1, 3),
        np.arange(3 * len(every)).reshape(-1, 3),
        np.concatenate(patch),
        paint,
        np.where(on_dome[:, None], preset.gloss, 0.0),
    )


@dataclass(frozen=True)
class _Part:
    """Triangles: `corners` (F, 3, 3) [m], and which of the part's patches each belongs to."""

    corners: Array
    patch: IndexArray
    patches: int


def _part(points: Array, ring: IndexArray, sectors: int, inward: Array) -> _Part:
    """Triangles over a grid of points (R + 1, COLUMNS + 1, 3) whose rows belong to rings (R,).

    `inward` (R, COLUMNS, 3) is roughly their normal.
    """
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    corners = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], axis=2)
    normal = np.cross(
        corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    )
    if np.sum(normal * inward[:, :, None]) < 0:
        corners = corners[..., ::-1, :]
    sector = np.arange(COLUMNS) * sectors // COLUMNS
    patch = np.repeat((ring[:, None] * sectors + sector)[..., None], 2, axis=2)
    area = np.linalg.norm(normal, axis=-1)
    kept = area > 1e-6 * area.max()  # the row at a pole has triangles without area
    return _Part(corners[kept], patch[kept], (int(ring[-1]) + 1) * sectors)


def _dome(surface: Surface) -> _Part:
    cosines = np.linspace(1, np.cos(surface.half_angle), transport.DOME_RINGS + 1)
    direction, ring = _round(np.arccos(cosines), DOME_STEP)
    points = surface.radius(direction)[..., None] * direction
    return _part(points, ring, transport.DOME_SECTORS, -direction[1:, 1:])


def _pod() -> _Part:
    cosines = np.linspace(1, -1, transport.POD_RINGS + 1)
    normal, ring = _round(np.arccos(cosines), POD_STEP)
    points = transport.POD_CENTRE_M + transport.POD_RADIUS_M * normal
    return _part(points, ring, transport.POD_SECTORS, normal[1:, 1:])


def _deck(deck: Deck) -> _Part:
    radius = np.linspace(0, deck.radius_m, transport.FLOOR_RINGS + 1)[:, None, None]
    turn, (first, second) = _turn()[:, None], deck.axes()
    around = np.cos(turn) * first + np.sin(turn) * second
    points = radius * around - deck.depth_m * deck.up
    ring = np.arange(transport.FLOOR_RINGS)
    up = np.broadcast_to(deck.up, (len(ring), COLUMNS, 3))
    return _part(points, ring, transport.FLOOR_SECTORS, up)


def _wall(deck: Deck) -> _Part:
    height = np.linspace(0, deck.wall_m, transport.WALL_RINGS + 1)[:, None, None]
    turn, (first, second) = _turn()[:, None], deck.axes()
    around = np.cos(turn) * first + np.sin(turn) * second
    points = deck.radius_m * around + (height - deck.depth_m) * deck.up
    ring = np.arange(transport.WALL_RINGS)
    inwards = np.broadcast_to(-around[1:], (len(ring), COLUMNS, 3))
    return _part(points, ring, transport.WALL_SECTORS, inwards)


def _round(edges: Array, step: float) -> tuple[Array, IndexArray]:
    """Directions (R + 1, COLUMNS + 1, 3) of rows no higher than `step`, and the ring of each row.

    `edges` are the rings' polar angles [rad].
    """
    rows = np.ceil(np.diff(edges) / step).astype(int)
    spans = zip(edges[:-1], edges[1:], rows, strict=True)
    cuts = [np.linspace(upper, lower, n, endpoint=False) for upper, lower, n in spans]
    theta = np.concatenate([*cuts, edges[-1:]])[:, None]
    turn = _turn()
    horizontal = np.sin(theta)
    direction = np.stack(
        [horizontal * np.cos(turn), horizontal * np.sin(turn), np.cos(theta) + 0 * turn], axis=-1
    )
    return direction, np.repeat(np.arange(len(rows)), rows)


def _turn() -> Array:
    return np.linspace(0, 2 * np.pi, COLUMNS + 1)


def _mean_albedo(surface: Surface, corners: Array) -> Array:
    """Mean albedo (F,) over each triangle (F, 3, 3), from the centres of its equal parts."""
    n = PAINT_CUTS
    up = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    down = [(3 * i + 2, 3 * j + 2) for i in range(n) for j in range(n - 1 - i)]
    total = np.zeros(len(corners))
    for i, j in up + down:
        weight = np.array([i, j, 3 * n - i - j]) / (3 * n)
        total += surface.albedo(normalise(weight @ corners))
    return np.asarray(total / n**2)
