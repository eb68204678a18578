"""Run the benchmarks, print a table, write benchmarks/results.json; exit 1 if a ratio falls short."""

import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from procam.estimate.decode import CodePair, DecodeLimits, decode_gray_pairs
from procam.maths.box_solver import solve_flux
from procam.maths.gray import bit_count, decode_gray, stripe
from procam.maths.sphere import master_solid_angles

ROUNDS = 5
SLACK = 0.75  # a ratio may fall 25 % short before it fails


def interleaved(runs: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median CPU seconds of each run, taken in turns so that all see the same machine."""
    spent: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            started = time.process_time()
            run()
            spent[name].append(time.process_time() - started)
    return {name: float(np.median(times)) for name, times in spent.items()}


def bench_solve() -> tuple[str, dict[str, float], str, str, float]:
    """Root of (P) for one channel of a 2048 px dome master, against bisection to the same tolerance."""
    rng = np.random.default_rng(1)
    solid = master_solid_angles(2048)
    solid = solid[solid > 0]
    target, u = rng.uniform(0, 1, solid.size), np.full(solid.size, 0.05)
    lo, hi = np.full(solid.size, 0.002), np.ones(solid.size)

    def bisection() -> float:
        low, high = 0.0, float(solid.sum())
        while high - low > 1e-12 * high:
            middle = (low + high) / 2
            excess = solid @ np.clip(target - u * middle, lo, hi) - middle
            low, high = (middle, high) if excess > 0 else (low, middle)
        return low

    runs = {
        "newton": lambda: solve_flux(target, u, solid, lo, hi),
        "bisection": bisection,
        "copy": target.copy,
    }
    return "exact solve, 3.3 M patches", interleaved(runs), "newton", "bisection", 3.0


def bench_decode() -> tuple[str, dict[str, float], str, str, float]:
    """Gray decoding of 42 pictures of 1600x1600, streamed, against a stack in NumPy."""
    rng = np.random.default_rng(2)
    size, shape = (1280, 800), (1600, 1600)
    x, y = rng.integers(0, size[0], shape), rng.integers(0, size[1], shape)
    bits = {"x": bit_count(size[0]), "y": bit_count(size[1])}
    planes = []
    for axis, coordinate, length in (("x", x, size[0]), ("y", y, size[1])):
        for bit in range(bits[axis]):
            bright = stripe(length, bit)[coordinate].astype(np.float32)
            planes.append((axis, bit, bright, 1 - bright))
    white, black = np.ones(shape, np.float32), np.zeros(shape, np.float32)

    def streamed() -> object:
        pairs = (CodePair(*plane) for plane in planes)
        return decode_gray_pairs(pairs, white, black, bits, DecodeLimits(0.1, 0.1))

    def stacked() -> object:
        bright = np.stack([p[2] for p in planes])
        inverse = np.stack([p[3] for p in planes])
        difference = bright - inverse
        valid = (np.abs(difference) >= 0.1).all(axis=0)
        weights = np.array([1 << p[1] for p in planes])[:, None, None]
        code = (difference > 0) * weights
        columns = decode_gray(code[: bits["x"]].sum(axis=0), bits["x"])
        rows = decode_gray(code[bits["x"] :].sum(axis=0), bits["y"])
        return np.where(valid, columns, -1), np.where(valid, rows, -1)

    copy = np.empty((len(planes), *shape), np.float32)
    runs = {
        "streamed": streamed,
        "stack": stacked,
        "copy": lambda: np.copyto(copy, 1.0),
    }
    return "Gray decode, 42 pictures of 2.6 Mpx", interleaved(runs), "streamed", "stack", 1.0


def main() -> int:
    """Run everything."""
    cv2.setNumThreads(1)
    results, failed = [], 0
    for bench in (bench_solve, bench_decode):
        title, seconds, ours, peer, goal = bench()
        ratio = seconds[peer] / max(seconds[ours], 1e-9)
        ok = ratio >= SLACK * goal
        failed += not ok
        results.append({"title": title, "cpu_s": seconds, "ratio": ratio, "goal": goal, "pass": ok})
        shown = ", ".join(f"{n} {s * 1e3:.0f} ms" for n, s in seconds.items())
        print(f"{title}: {ratio:.1f}x {peer} (goal {goal:g}x)  [{shown}]  {'' if ok else 'FAIL'}")
    document = {"machine": platform.processor() or platform.machine(), "results": results}
    Path(__file__).with_name("results.json").write_text(json.dumps(document, indent=1) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
