"""Compensating a dome master on a dome as a calibration gives it: solve and apply."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import OpenImageIO as oiio

from benchmarks import floor
from benchmarks.measure import Goal, Report, at_least, at_levels, interleaved, over_floor
from procam.compensate.equations import FrameEquations, Solution
from procam.compensate.fields import Fields
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.model import FrameModel
from procam.kernels.native.arrays import aligned_empty
from procam.maths.codes.dither import threshold_tile
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.scatter_kernel import basis
from procam.maths.light.transfer import transfer

NODES = 1024
STRIP = 0.1  # unlit share of the half sphere, along its rim
FEEDBACK = 0.25
DIM = 0.95  # from where on along x projectors cannot show white: a cell of a hundred, as in calibrations
PAN_PX = 2  # between frames, as in a slow shot
MAPS = 4 * 3 + 1  # numbers that a node has: spread, limits, direction, coverage


@cache
def content(size: int) -> np.ndarray:
    """Soft light with edges (N, N, 3), 8 bits."""
    noise = np.random.default_rng(5).integers(0, 256, (size // 4, size // 4, 3), np.uint8)
    picture = cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)
    u, v = np.meshgrid(*[np.linspace(0.2, 1, size, dtype=np.float32)] * 2)
    return (picture * (u * v)[..., None]).astype(np.uint8)


@cache
def dome(size: int, measured: bool) -> Fields:
    """A uniform dome of one scalar, or one with maps and a kernel of degree 2."""
    rng = np.random.default_rng(6)
    direction, inside = master_directions(NODES)
    lit = inside & (direction[..., 2] > STRIP)
    coverage = lit.astype(np.float32)
    area = master_solid_angles(NODES) * lit
    one = np.ones((NODES, NODES, 3), np.float32)
    wave = 1 + 0.05 * direction[..., :1] * direction[..., 1:2] if measured else 1.0
    grain = 1 + 0.01 * rng.standard_normal(one.shape) if measured else 1.0
    dim = np.where(direction[..., :1] > DIM, 0.9, 1) if measured else 1.0
    model = FrameModel(
        size,
        (one * wave * grain * FEEDBACK / area.sum()).astype(np.float32),
        (0.001 * one * grain).astype(np.float32),
        (1.1 * one * wave * dim).astype(np.float32),
        None,
        None,
        coverage,
        (area * (NODES / size) ** 2).astype(np.float32),
        np.ascontiguousarray(np.moveaxis(direction, -1, 0), np.float32),
        9 if measured else 1,
    )
    terms, bend = model.terms, np.diag([1.0, *[0.05] * (model.terms - 1)])
    some = direction[lit][:: max(1, lit.sum() // 500)]
    x, y, z = some.T
    mono = (np.ones_like(x), x, y, z, x * y, y * z, x * z, x * x - y * y, z * z)[:terms]
    change = np.linalg.lstsq(np.stack(mono, axis=1), basis(some, int(terms**0.5) - 1), rcond=None)
    operator = change[0] @ bend @ change[0].T
    return Fields(model, model, np.stack([operator] * 3), None)


@dataclass
class Show:
    """Frames of a slow pan, each solved from the last one's solution."""

    equations: FrameEquations
    coding: Coding
    frames: list[np.ndarray]
    out: np.ndarray
    shown: int = 0
    solution: Solution | None = None

    @classmethod
    def of(cls, size: int, measured: bool, kind: type, solved: bool = True) -> "Show":
        """A pan of 8-bit or linear content, its first frame shown if `solved`."""
        first = content(size)
        known = transfer("srgb" if kind is np.uint8 else "linear")
        if kind is not np.uint8:
            first = (np.float32(1 / 255) * first).astype(kind)
        frames = [aligned_empty(first.shape, first.dtype) for _ in range(2)]
        for k, frame in enumerate(frames):
            frame[:] = np.roll(first, k * PAN_PX, axis=1)
        top = 1.0 if kind is np.uint8 else np.inf
        coding = Coding(known.decode, known.encode, threshold_tile(), 1.0, top)
        fields = dome(size, measured)
        show = cls(
            FrameEquations(fields, "exact", np.ones(3)),
            coding,
            frames,
            aligned_empty(first.shape, first.dtype),
        )
        if solved:
            show()
        return show

    def __call__(self) -> None:
        """Solve the next frame and write it."""
        frame = self.frames[self.shown % 2]
        self.shown += 1
        _, self.solution = self.equations.frame(frame, self.coding, self.out)

    def once(self) -> None:
        """One sum and one write: the cost of a frame whose coefficients hardly change."""
        assert self.solution is not None
        self.equations.sums(self.frames[0], self.solution, "light", self.coding)
        self.equations.apply(self.frames[0], self.coding, self.solution, self.out)


def _moved(show: Show) -> floor.Floor:
    """The lit part read twice, the maps too, all written once."""
    lit = float((show.equations.model.coverage > 0).mean())
    read = int(2 * lit * show.out.nbytes) + 2 * 4 * NODES * NODES * MAPS
    return floor.Floor.of_bytes(read, show.out.nbytes)


def _by_cv2(show: Show) -> Callable[[], None]:
    """The same of float light by OpenCV: area-weighted sums, subtraction, limits; maps as large as it."""
    size = show.out.shape[0]
    assert show.solution is not None
    model, picture = show.equations.model, show.frames[0].astype(np.float32)
    grow = {"dsize": (size, size), "interpolation": cv2.INTER_LINEAR}
    light, lo, hi = (
        cv2.resize(m, **grow) for m in (show.equations.light(show.solution), model.lo, model.hi)
    )
    weight = cv2.resize(np.repeat(model.solid_angle_sr[..., None], 3, axis=2), **grow)
    less, product = np.empty_like(picture), np.empty_like(picture)

    def run() -> None:
        for _ in range(2):  # to sum it, and to write it
            cv2.subtract(picture, light, less)
            cv2.max(less, lo, less)
            cv2.min(less, hi, less)
        cv2.multiply(less, weight, product)
        cv2.sumElems(product)

    return run


def _by_oiio(show: Show) -> Callable[[], None]:
    """Only the subtraction and clamp, by OpenImageIO."""
    picture = oiio.ImageBuf(np.ascontiguousarray(show.frames[0]))
    assert show.solution is not None
    light = show.equations.light(show.solution)
    light = oiio.ImageBuf(cv2.resize(light, show.out.shape[:2]))

    def run() -> None:
        less = oiio.ImageBufAlgo.sub(picture, light)
        oiio.ImageBufAlgo.clamp(less, min=0.001, max=1.0)

    return run


def bench_codes(size: int) -> Report:
    """8 bits on a measured dome: a slow pan, each frame solved from the last one's solution and written."""
    show, table = Show.of(size, True, np.uint8), np.arange(256, dtype=np.uint8)
    values = float((show.equations.model.coverage > 0).mean()) * show.out.size
    count = floor.counted("sums of a frame") + floor.counted("a frame written")

    def all_cores() -> None:
        cv2.setNumThreads(-1)
        cv2.LUT(show.frames[0], table, show.out)
        cv2.setNumThreads(1)

    runs = at_levels("measured dome", show) | {
        "floor with maps": _moved(show),
        "limit, avx2": floor.Instructions(count * values),
        "cv2.LUT alone, all cores": all_cores,
    }
    times = interleaved(runs)
    goals = over_floor(times, "measured dome", "floor with maps", {"avx512": 2.5, "avx2": 5})
    goals += over_floor(times, "measured dome", "limit, avx2", {"avx2": 2})
    note = (
        "a slow pan, each frame from the last one's solution: one sum and one write; "
        f"limit: {count:.1f} instructions per lit value"
    )
    return Report(f"Compensate {size}^2, 8 bits", times, goals, (floor.name(), note))


def bench_light() -> Report:
    """Float and half, 4096^2, on a measured dome."""
    single, half = (Show.of(4096, True, kind) for kind in (np.float32, np.float16))
    runs = {
        **at_levels("float, one pass", single.once),
        **at_levels("half, one pass", half.once),
        "float, to 2e-9": single,
        "cv2": _by_cv2(single),
        "OpenImageIO, sub and clamp alone": _by_oiio(single),
        "floor, float": _moved(single),
        "floor, half": _moved(half),
    }
    times = interleaved(runs)
    best = min(("cv2", "OpenImageIO, sub and clamp alone"), key=lambda n: times[n].wall_s)
    goals: list[Goal] = []
    for kind in ("float", "half"):
        runs_of = [
            name for name in times if name.startswith(f"{kind}, one pass") and "base" not in name
        ]
        goals += [at_least(times, name, best, 6) for name in runs_of]
        limits = {"avx512": 1.8, "avx2": 2.5}
        goals += over_floor(times, f"{kind}, one pass", f"floor, {kind}", limits)
    return Report("Compensate 4096^2, light", times, tuple(goals), (floor.name(),))
