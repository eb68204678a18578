"""Scattered light in a room of triangles, by path tracing with Mitsuba 3 (extra `sim`).

Two steps. Paths from every patch estimate the light after all bounces, with some noise. Then many more
rays from every patch gather the radiosity of the faces, direct and scattered: noise of the first step
is averaged over the whole room, and the noise of one bounce remains.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.stats import qmc

from procam.arrays import Array, Array32, IndexArray
from procam.errors import ShapeError, UnitError
from procam.maths.geometry.sphere import normalise
from simulators.mitsuba_scene import CHANNELS, GlowingMesh

BATCHES = 8  # independent repetitions, whose scatter gives the standard error
PATHS = 1 << 17  # of the first step, for all patches together, per batch
BLOCK = 1 << 20  # rays at a time
OFFSET = 1e-5  # of the extent: rays start off their face


@dataclass(frozen=True, slots=True)
class PatchedMesh:
    """A room of triangles, each of which belongs to a patch.

    Attributes
    ----------
    vertices : (V, 3) [m]. faces : (F, 3), counter-clockwise seen from inside; their backs are black.
    patch : (F,) patch 0..P-1 of each face; every patch has one.
    albedo : (F, C) reflectance, 0 to below 1.
    gloss : (F, 1) share of the reflected light that leaves in a lobe round the mirror direction.
    """

    vertices: Array
    faces: NDArray[np.integer[Any]]
    patch: IndexArray
    albedo: Array
    gloss: Array

    def __post_init__(self) -> None:
        if self.albedo.ndim != 2 or len(self.albedo) != len(self.faces):
            raise ShapeError("albedo", self.albedo.shape, f"({len(self.faces)}, C)")
        if not ((self.albedo >= 0) & (self.albedo < 1)).all():
            raise UnitError(
                f"albedo is {self.albedo.min():.3g} to {self.albedo.max():.3g}; it must be 0 to below 1, "
                "because paths in a white room never end"
            )

    def areas_m2(self) -> Array:
        """(F,) area of the faces."""
        return np.asarray(np.linalg.norm(self._crossed(), axis=1) / 2)

    def frames(self) -> Array32:
        """(F, 3, 3) two tangents and the normal of each face: unit vectors, as rows."""
        normal = normalise(self._crossed())
        # neighbouring faces get similar tangents, which keeps rays stratified across them
        helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
        first = normalise(np.cross(helper, normal))
        return np.stack([first, np.cross(normal, first), normal], axis=1).astype(np.float32)

    def _crossed(self) -> Array:
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return np.cross(b - a, c - a)


def scattered_irradiance(
    mesh: PatchedMesh, direct: Array, samples: int, seed: int = 0
) -> tuple[Array, Array]:
    """Irradiance (P, C) of scattered light, and its standard error (P, C).

    `direct` (F, C) is the radiosity of the faces after the first bounce [rel]. `samples` rays leave
    every patch, a power of two.

    Raises
    ------
    InputError
        If mitsuba is not installed.
    ShapeError, UnitError
        If the light does not belong to the mesh, or `samples` is not a power of two.
    """
    if direct.shape != mesh.albedo.shape:
        raise ShapeError("direct", direct.shape, f"{mesh.albedo.shape}, as the albedo")
    if samples < BATCHES or samples & (samples - 1):
        raise UnitError(f"samples is {samples}; it must be a power of two from {BATCHES} on")
    tracer = _Tracer(mesh, direct)
    streams = np.random.default_rng(seed).spawn(BATCHES)
    batches = [tracer.irradiance(samples // BATCHES, rng) for rng in streams]
    error = np.std(batches, axis=0, ddof=1) / np.sqrt(BATCHES)
    return np.mean(batches, axis=0), error


class _Starts:
    """Origins on the patches and directions of rays."""

    def __init__(self, mesh: PatchedMesh) -> None:
        order = np.argsort(mesh.patch, kind="stable")
        self.patches = int(mesh.patch.max()) + 1
        self._area = mesh.areas_m2()[order]
        self._upto = np.cumsum(self._area)
        last = np.searchsorted(mesh.patch[order], np.arange(self.patches), side="right") - 1
        self._patch_end = self._upto[last]
        self._patch_area = np.diff(self._patch_end, prepend=0.0)
        corners = mesh.vertices[mesh.faces[order]].astype(np.float32)
        self._corner, self._edges = corners[:, 0], np.diff(corners, axis=1)
        self._frames = mesh.frames()[order]
        self._offset = np.float32(OFFSET * np.ptp(mesh.vertices, axis=0).max())

    def rays(self, samples: int, rng: np.random.Generator) -> Iterator[tuple[Array32, Array32]]:
        """Origins and directions (K samples, 3), `samples` of one patch after the other.

        Origins are stratified, directions are distributed as the cosine to the normal.
        """
        base = qmc.Sobol(4, rng=rng).random(samples)
        step = max(1, BLOCK // samples)
        for first in range(0, self.patches, step):
            patches = slice(first, min(first + step, self.patches))
            shift = rng.random((patches.stop - first, 1, 4))
            yield self._started(patches, (base + shift) % 1.0)

    def _started(self, patches: slice, sample: Array) -> tuple[Array32, Array32]:
        share = self._patch_area[patches, None] * (1 - sample[..., 3])
        place = (self._patch_end[patches, None] - share).ravel()
        face = np.minimum(np.searchsorted(self._upto, place, side="right"), len(self._upto) - 1)
        # the remainder of a random number that has chosen a face is uniform again
        rest = 1 - (self._upto[face] - place) / self._area[face]
        root = np.sqrt(np.clip(rest, 0, 1)).astype(np.float32)[:, None]
        height, turn, across = sample[..., :3].reshape(-1, 3).astype(np.float32).T
        edges, frames = self._edges[face], self._frames[face]
        origin = self._corner[face] + root * (edges[:, 0] + across[:, None] * edges[:, 1])
        radius, angle = np.sqrt(height), np.float32(2 * np.pi) * turn
        local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - height)], 1)
        direction = np.einsum("ni,nij->nj", local, frames)
        return origin + self._offset * frames[:, 2], direction


class _Tracer:
    """A room, its direct light (F, C), and the paths in it."""

    def __init__(self, mesh: PatchedMesh, direct: Array) -> None:
        self._mesh, self._direct, self._starts = mesh, direct, _Starts(mesh)
        self._normal = mesh.frames()[:, 2]
        self._matte = mesh.albedo * (1 - mesh.gloss)
        self._lit = list(self._scenes(direct, self._matte))

    def irradiance(self, samples: int, rng: np.random.Generator) -> Array:
        """Irradiance (P, C) of all bounces, estimated once."""
        some = min(samples, 1 << (max(PATHS // self._starts.patches, 1).bit_length() - 1))
        bounced = self._by_paths(self._lit, some, rng)
        sent = self._direct + self._matte * bounced[self._mesh.patch]
        if self._mesh.gloss.any():  # its reflections have to be traced
            return self._by_paths(self._scenes(sent, np.zeros_like(sent)), samples, rng)
        return self._gathered(sent, samples, rng)

    def _scenes(self, sent: Array, matte: Array) -> Iterator[GlowingMesh]:
        """The room three channels at a time; faces send (F, C) and reflect `matte` and gloss."""
        glossy = self._mesh.albedo * self._mesh.gloss
        for first in range(0, sent.shape[1], CHANNELS):
            parts = (_three(v[:, first : first + CHANNELS]) for v in (sent, matte, glossy))
            yield GlowingMesh(self._mesh.vertices, self._mesh.faces, *parts)

    def _by_paths(
        self, scenes: Iterable[GlowingMesh], samples: int, rng: np.random.Generator
    ) -> Array:
        """Irradiance (P, C) in scenes that make up the channels, with as many bounces as there are."""
        light = []
        for scene in scenes:
            seen = [
                _means(scene.radiance(*rays, int(rng.integers(1 << 32))), samples)
                for rays in self._starts.rays(samples, rng)
            ]
            light.append(np.pi * np.concatenate(seen))
        return np.concatenate(light, axis=1)[:, : self._direct.shape[1]]

    def _gathered(self, sent: Array, samples: int, rng: np.random.Generator) -> Array:
        """Irradiance (P, C) from the radiosity (F, C) of the faces that rays hit first."""
        light = []
        for origin, direction in self._starts.rays(samples, rng):
            face = self._lit[0].first_faces(origin, direction)
            from_behind = np.einsum("ni,ni->n", direction, self._normal[face]) > 0
            share = np.where(from_behind | (face < 0), 0.0, 1 / samples)
            rows = np.arange(0, len(face) + 1, samples)
            shape = (len(rows) - 1, len(sent))
            light.append(csr_array((share, np.maximum(face, 0), rows), shape) @ sent)
        return np.concatenate(light)


def _means(seen: Array | Array32, samples: int) -> Array:
    """Means (K, C) over the samples of each patch, of values (K samples, C)."""
    return np.asarray(seen.reshape(-1, samples, seen.shape[1]).mean(axis=1, dtype=float))


def _three(values: Array) -> Array:
    """(F, 3) of up to three channels, the others dark."""
    return np.pad(values, ((0, 0), (0, CHANNELS - values.shape[1])))
