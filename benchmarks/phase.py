"""The search for columns over several periods of sinusoids."""

import numpy as np

from benchmarks import floor
from benchmarks.measure import Goal, Report, at_least, at_levels, between_levels, interleaved
from procam import kernels

SHAPE = (2160, 3840)
LENGTH = 3840.0
FIRST = 128.0
EXTRAS = (137.0, 149.0, 111.0, 101.0, 119.0)
PEER_PIXELS = 100


def waves(shape: tuple[int, int], periods: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Frames (K, H, W) uint8 of random columns: offset 100, amplitude 76, noise of 1 count."""
    rng = np.random.default_rng(4)
    x = rng.uniform(0, LENGTH, shape).astype(np.float32)
    noise = rng.normal(0.5, 1, shape).astype(np.float32)
    stack = np.empty((len(periods), *shape), np.uint8)
    for frame, period, shift in zip(stack, periods, shifts, strict=True):
        angle = x * np.float32(2 * np.pi / period) - np.float32(shift)
        np.add(
            100 + 76 * np.cos(angle), np.roll(noise, int(shift * 999)), out=frame, casting="unsafe"
        )
    return stack


def plan(extras: int) -> tuple[np.ndarray, ...]:
    """Periods, shifts, modulation, harmonic of 3 + `extras` frames."""
    periods = np.array([FIRST] * 3 + list(EXTRAS[:extras]))
    shifts = np.concatenate([np.arange(3) * 2 * np.pi / 3, np.linspace(0, 2, extras)])
    return periods, shifts, np.ones(len(periods)), np.zeros(len(periods))


def exhaustive(stack: np.ndarray, terms: tuple[np.ndarray, ...]) -> np.ndarray:
    """Every column against every pixel of the first row: offset and amplitude from the base."""
    periods, shifts = terms[:2]
    columns = np.cos(2 * np.pi * np.arange(LENGTH)[:, None] / periods - shifts)
    frames = stack[:, 0, :PEER_PIXELS].astype(float)
    cosine, sine = np.stack([np.cos(shifts[:3]), np.sin(shifts[:3])]) @ frames[:3] * 2 / 3
    normal = (frames - frames[:3].mean(axis=0)) / np.hypot(cosine, sine)
    apart = ((normal.T[:, None, :] - columns[None]) ** 2).sum(axis=-1)
    return apart.argmin(axis=1)


def bench_search(extras: int) -> Report:
    """Micro phase shifting, one axis, 3840x2160 uint8, 31 periods."""
    terms = plan(extras)
    stack = waves(SHAPE, *terms[:2])
    times = interleaved(
        {
            "kernel": lambda: kernels.search_phase(stack, *terms, 3, LENGTH),
            **at_levels("kernel", lambda: kernels.search_phase(stack, *terms, 3, LENGTH)),
            "limit, avx2": floor.Instructions(floor.counted("search") * stack[0].size),
            "kernel, one step": lambda: kernels.search_phase(stack, *terms, 3, LENGTH, 1),
            "kernel, no refinement": lambda: kernels.search_phase(stack, *terms, 3, LENGTH, 0),
        },
        {"NumPy exhaustive": (lambda: exhaustive(stack, terms), stack[0].size / PEER_PIXELS)},
        rounds=5,
    )
    return Report(
        f"Search over 31 periods, {3 + extras} frames of 3840x2160 uint8, two Gauss-Newton steps",
        times,
        (
            Goal("kernel, best wall", times["kernel"].best_wall_s * 1e3, "<=", 90, "ms"),
            at_least(times, "kernel", "NumPy exhaustive", 500),
            *between_levels(times, "kernel", 2.2),
        ),
        (
            "best wall: a busy machine has the median for its own",
            f"exhaustive: {PEER_PIXELS} pixels, extrapolated",
        ),
    )


def bench_growth() -> Report:
    """CPU time per pixel at 1, 4 and 16 megapixels."""
    terms = plan(4)
    sizes = {"1 MP": (1024, 1024), "4 MP": (2048, 2048), "16 MP": (4096, 4096)}
    runs = {}
    for name, shape in sizes.items():
        stack = waves(shape, *terms[:2])
        runs[name] = lambda s=stack: kernels.search_phase(s, *terms, 3, LENGTH)
    times = interleaved(runs)
    each = [times[name].cpu_s / (shape[0] * shape[1]) for name, shape in sizes.items()]
    return Report(
        "Search, growth with the number of pixels",
        times,
        (Goal("most over least time per pixel", max(each) / min(each), "<=", 1.35),),
        (
            ", ".join(
                f"{name}: {t * 1e9:.1f} core-ns/px" for name, t in zip(sizes, each, strict=True)
            ),
        ),
    )
