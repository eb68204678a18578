"""Scattered light by every forward model of procam, against path tracing in the same room.

Both get the direct light; the light that the room adds to it is compared over the lit patches. The
table is in `forward_table`.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.maths.geometry.sphere import cap_solid_angle, direction_from_angles
from procam.maths.light.radiosity import floor_return
from procam.maths.mesh.form_factors import form_factors
from procam.maths.mesh.radiosity import add_mesh_interreflection
from simulators.mitsuba_paths import scattered_irradiance
from simulators.mitsuba_scene import load_mitsuba
from simulators.mitsuba_venue import room_mesh, scattered_radiosity
from simulators.presets import IDEAL, Preset
from simulators.surface import Surface
from simulators.transport import DOME_RINGS, DOME_SECTORS
from studies.forms import (
    FORMS,
    PATCHES,
    RING,
    SECTOR,
    Array,
    Dome,
    Picture,
    one_scalar,
    patch_directions,
)
from studies.forward_table import table
from studies.measure import write

SAMPLES = 1 << 14  # rays from each patch, and from each face of a mesh
SEED = 1  # of the pictures judged
TRAINING_SEEDS = (2, 3)  # of those that models are fitted to, twice
STRIPS = (0.0, 0.1, 0.2, 0.4)
# albedo and its variation; 0.8 +-30 % would exceed 1
PAINTS = ((0.3, 0.0), (0.3, 0.3), (0.5, 0.0), (0.5, 0.3), (0.8, 0.0), (0.8, 0.2))
TILTS_DEG = (15.0, 30.0)  # of a bare dome, where they have no effect
FURNISHED = ((0.3, 15.0), (0.5, 0.0), (0.5, 15.0), (0.5, 30.0), (0.8, 15.0))  # albedo, tilt
SPOT = direction_from_angles(np.radians(40.0), np.radians(50.0))
SPOT_RADIUS = np.radians(20.0)
SECTORS = 6  # of the dome, high and low: twelve zones, as those of two projectors
SIGMAS = 2  # standard errors that an error must exceed to be resolved
LOW_RING = 13  # halves of the area lit with a strip of 10 %


def main() -> None:
    """Trace all rooms and write studies/forward.json and .md; takes up to an hour, and needs LLVM.

    Raises
    ------
    InputError
        If there is no LLVM.
    """
    variant = load_mitsuba().variant()
    if not variant.startswith("llvm"):
        raise InputError(
            f"study forward: Mitsuba's variant is {variant}, which takes hours; install libLLVM 19 or "
            "newer for its LLVM variant"
        )
    rows = []
    for row in chain(_dome_rows(), _mesh_rows()):
        print(row, flush=True)
        rows.append(row)
    document = {
        "variant": variant,
        "samples": SAMPLES,
        "pictures": list(_pictures()),
        "patches": [DOME_RINGS, DOME_SECTORS],
        "rows": rows,
    }
    write("forward", document, table(document))


def _dome_rows() -> Iterator[dict]:
    bare = replace(IDEAL, floor_albedo=0.0, tilt_deg=0.0)
    for albedo, smooth in PAINTS:
        yield from _rows(replace(bare, albedo=albedo, albedo_smooth=smooth), "bare", STRIPS)
    for tilt in TILTS_DEG:
        preset = replace(bare, tilt_deg=tilt, albedo_smooth=0.3)
        yield from _rows(preset, "bare", STRIPS[1:2])
    for albedo, tilt in FURNISHED:
        preset = replace(bare, albedo=albedo, tilt_deg=tilt, floor_albedo=0.2, pod=True)
        yield from _rows(preset, "furnished", STRIPS[1:2])


def _rows(preset: Preset, kind: str, strips: Sequence[float]) -> Iterator[dict]:
    """One dome with several unlit strips; the light of all is traced at once."""
    started = time.perf_counter()
    surface = Surface.build(preset)
    mesh = room_mesh(surface)
    area = mesh.areas_m2()
    paint = np.bincount(mesh.patch, area * mesh.albedo[:, 0]) / np.bincount(mesh.patch, area)
    albedo = paint[:PATCHES, None]
    lit = [RING < DOME_RINGS * (1 - strip) for strip in strips]
    shown = [{n: m & where for n, m in _pictures().items()} for where in lit]
    fitted = [{n: m & where for n, m in _training().items()} for where in lit]
    judged = iter(_traced(surface, albedo, [m for s in shown for m in s.values()], SEED))
    zones = [mask for areas in fitted for mask in areas.values()]
    trained = [iter(_traced(surface, albedo, zones, seed)) for seed in TRAINING_SEEDS]
    seconds = (time.perf_counter() - started) / len(strips)
    tilt = np.radians(preset.tilt_deg)
    solid = np.full(PATCHES, cap_solid_angle(surface.half_angle) / PATCHES)
    for strip, where, names, areas in zip(strips, lit, shown, fitted, strict=True):
        name = (
            f"albedo {preset.albedo:g} +-{100 * preset.albedo_smooth:g} %, "
            f"strip {100 * strip:g} %, tilt {preset.tilt_deg:g} deg"
        )
        returned = floor_return(surface.half_angle, tilt, preset.floor_albedo)
        dome = Dome(name, kind, solid, albedo, where, returned)
        pictures = [Picture(n, *next(judged)) for n in names]
        training = [[Picture(n, *next(light)) for n in areas] for light in trained]
        yield {**_judge(dome, training, pictures), "seconds": seconds}


def _pictures() -> dict[str, NDArray[np.bool_]]:
    azimuth = (SECTOR + 0.5) / DOME_SECTORS * 2 * np.pi
    return {
        "white": np.ones(PATCHES, bool),
        "left half": np.sin(azimuth) > 0,
        "front wedge of 60 deg": np.cos(azimuth) > np.cos(np.radians(30)),
        "upper half": RING < DOME_RINGS // 2,
        "low ring": RING >= DOME_RINGS // 2,
        "spot": patch_directions() @ SPOT > np.cos(SPOT_RADIUS),
    }


def _training() -> dict[str, NDArray[np.bool_]]:
    sector, low = SECTOR * SECTORS // DOME_SECTORS, RING >= LOW_RING
    zones = 2 * sector + low
    return {f"zone {i}": zones == i for i in range(2 * SECTORS)}


def _traced(
    surface: Surface, albedo: Array, lit: Sequence[NDArray[np.bool_]], seed: int
) -> list[tuple[Array, Array, Array]]:
    """Direct, scattered and its error (N, 1) of white light on each of some areas (N,)."""
    areas, place = np.unique(np.stack(lit), axis=0, return_inverse=True)  # some strips are equal
    mesh = room_mesh(surface, len(areas))
    whole = np.zeros((mesh.patch.max() + 1, len(areas)))
    whole[:PATCHES] = albedo * areas.T
    light, error = scattered_irradiance(mesh, whole[mesh.patch], SAMPLES, seed)
    columns = [slice(i, i + 1) for i in place.ravel()]
    on_dome = (whole[:PATCHES], albedo * light[:PATCHES], albedo * error[:PATCHES])
    return [tuple(v[:, c] for v in on_dome) for c in columns]


def _judge(dome: Dome, training: Sequence[Sequence[Picture]], pictures: Sequence[Picture]) -> dict:
    """Relative rms error of every form per picture, its resolution, and the tracer's noise.

    The forms are fitted to two tracings of the training pictures, which share no ray.
    """
    lit, z, noise = dome.lit, {}, {}
    error, resolution = {f.name: {} for f in FORMS}, {f.name: {} for f in FORMS}
    for picture in pictures:
        true, sigma = picture.scattered[lit], picture.error[lit]
        noise[picture.name] = _rms(sigma) / true.mean()
        exact = one_scalar(dome, training[0], picture.direct)[lit]
        z[picture.name] = _rms((exact - true) / sigma)
        for form in FORMS:
            first, second = (form.predict(dome, t, picture.direct)[lit] - true for t in training)
            # independent noise of the fits has no part in the product; the tracer's is subtracted
            figures = _root(first * second - sigma**2, true.mean())
            error[form.name][picture.name], resolution[form.name][picture.name] = figures
    return {
        "kind": dome.kind,
        "room": dome.name,
        "noise": noise,
        "z": z,
        "error": error,
        "resolution": resolution,
    }


def _root(squares: Array, mean: float) -> tuple[float, float]:
    """Root of the mean of unbiased squares of errors, and the smallest that is not noise, over `mean`.

    The latter is the root of `SIGMAS` standard errors of the mean square.
    """
    error = np.sqrt(max(float(squares.mean()), 0.0))
    resolution = np.sqrt(SIGMAS * float(squares.std(ddof=1)) / np.sqrt(squares.size))
    return float(error / mean), float(resolution / mean)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mesh_rows() -> Iterator[dict]:
    """Rooms of any shape: form factors against path tracing."""
    for name, (vertices, faces) in {"box 5 x 3 x 2 m": _box(), "cylinder": _cylinder()}.items():
        started = time.perf_counter()
        middle = vertices[faces].mean(axis=1)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        on_floor = middle[:, 2] < low[2] + 1e-6
        albedo = np.where(on_floor, 0.2, 0.6)
        far = np.linalg.norm(middle - [high[0], 0, middle[:, 2].mean()], axis=1)
        areas = {"all but the floor": ~on_floor, "left half": ~on_floor & (middle[:, 1] > 0)}
        areas["spot"] = far <= np.sort(far)[len(far) // 40]
        direct = np.stack([area * albedo for area in areas.values()], axis=1)
        albedos = np.repeat(albedo[:, None], len(areas), axis=1)
        found = add_mesh_interreflection(direct, albedos, form_factors(vertices, faces)) - direct
        true, sigma = scattered_radiosity(vertices, faces, albedos, direct, SAMPLES, SEED)
        mean, squares = true.mean(axis=0), (found - true) ** 2 - sigma**2
        figures = {n: _root(squares[:, i], mean[i]) for i, n in enumerate(areas)}
        yield {
            "kind": "mesh",
            "room": f"{name}, {len(faces)} faces",
            "noise": {n: _rms(sigma[:, i]) / mean[i] for i, n in enumerate(areas)},
            "error": {"form factors": {n: e for n, (e, _) in figures.items()}},
            "resolution": {"form factors": {n: r for n, (_, r) in figures.items()}},
            "seconds": time.perf_counter() - started,
        }


Mesh = tuple[Array, NDArray[np.intp]]


def _box() -> Mesh:
    """A box about the origin, its walls squares of a quarter metre."""
    half, walls = np.array([2.5, 1.5, 1.0]), []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1, 1):
            counts = [int(8 * half[i]) + 1 for i in (u, v)]
            grid = np.empty((*counts, 3))
            grid[..., axis] = side * half[axis]
            grid[..., u] = np.linspace(-half[u], half[u], counts[0])[:, None]
            grid[..., v] = np.linspace(-half[v], half[v], counts[1])
            walls.append(grid if side < 0 else grid[:, ::-1])
    return _joined(walls)


def _cylinder() -> Mesh:
    """A closed cylinder of 36 sides, 3 m across and 4 m high."""
    turn = np.linspace(0, 2 * np.pi, 37)
    around = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.array([0, 0, 1.0])
    rows = [(r, -2.0) for r in np.linspace(0, 1.5, 7)]
    rows += [(1.5, z) for z in np.linspace(-2, 2, 17)[1:]]
    rows += [(r, 2.0) for r in np.linspace(1.5, 0, 7)[1:]]
    return _joined([np.stack([r * around + z * up for r, z in rows])])


def _joined(grids: Sequence[Array]) -> Mesh:
    """Triangles over grids of points (R, C, 3); equal points are merged."""
    corners = []
    for grid in grids:
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        corners += [np.stack(three, axis=2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))]
    flat = np.concatenate(corners)
    normal = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    flat = flat[np.linalg.norm(normal, axis=1) > 1e-9]
    _, first, place = np.unique(
        flat.reshape(-1, 3).round(9), axis=0, return_index=True, return_inverse=True
    )
    return flat.reshape(-1, 3)[first], place.reshape(-1, 3)
