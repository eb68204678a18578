"""Gray code decoding: 22 pairs of pictures folded into code, least and most contrast."""

import tracemalloc

import cv2
import numpy as np

from benchmarks import floor
from benchmarks.measure import Goal, Report, at_least, interleaved
from procam.maths.codes.gray import encode_gray, fold_pair

SHAPE = (2160, 3840)
BITS = 11
STATE_BYTES = 8  # per pixel: code of two axes (2 + 2), least, most, white, black
PROBES = 400
LIVE = "NumPy, streaming"


def pictures(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Stack (44, H, W) uint8: pattern and inverse of 11 bits of x, then of y, finest last."""
    rng = np.random.default_rng(2)
    height, width = shape
    x = (np.arange(width) * (2**BITS - 1) // width)[None, :]
    y = (np.arange(height) * (2**BITS - 1) // height)[:, None]
    noise = rng.integers(0, 40, shape, dtype=np.uint8)
    stack = np.empty((4 * BITS, *shape), np.uint8)
    for i, (axis, bit) in enumerate((a, b) for a in (x, y) for b in reversed(range(BITS))):
        lit = (encode_gray(axis) >> bit & 1).astype(np.uint8)
        np.add(noise, 20 + 150 * lit, out=stack[2 * i], casting="unsafe")
        np.add(noise[::-1], 20 + 150 * (1 - lit), out=stack[2 * i + 1], casting="unsafe")
    return stack


class Fold:
    """The state of a streaming decoder, and the same result from a stack in memory."""

    def __init__(self, stack: np.ndarray) -> None:
        self.stack, shape = stack, stack.shape[1:]
        self.codes = np.zeros((2, *shape), np.uint16)
        self.least, self.most = np.zeros((2, *shape), np.uint8)

    def _reset(self) -> None:
        self.codes[...], self.least[...], self.most[...] = 0, 255, 0

    def streaming(self) -> None:
        """As the decoder does it while pictures arrive."""
        self._reset()
        for i in range(2 * BITS):
            state = self.codes[i // BITS], self.least, self.most
            fold_pair(*self.stack[2 * i : 2 * i + 2], BITS - 1 - i % BITS, state)

    def stacked(self) -> tuple[np.ndarray, ...]:
        """NumPy on the whole stack."""
        pattern, inverse = self.stack[::2], self.stack[1::2]
        contrast = np.maximum(pattern, inverse) - np.minimum(pattern, inverse)
        least, most = contrast.min(axis=0), contrast.max(axis=0)
        weights = (1 << np.arange(BITS)[::-1]).astype(np.uint16)
        above = pattern > inverse
        x, y = (np.einsum("k,khw->hw", weights, half) for half in (above[:BITS], above[BITS:]))
        return x, y, least, most

    def temporaries(self) -> float:
        """Bytes per pixel that the streaming fold allocates while it runs."""
        tracemalloc.start()
        self.streaming()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak / self.least.size


def int64_decode(stack: np.ndarray) -> list[np.ndarray]:
    """The method of the structuredlight package: bits to binary, binary to int64 numbers.

    Written anew; a quarter of the rows is given, so as to fit the int64 stacks in memory.
    """
    found = []
    for half in (stack[: 2 * BITS], stack[2 * BITS :]):
        gray = (half[::2] > half[1::2]).astype(int)
        binary = np.bitwise_xor.accumulate(gray, axis=0)
        found.append(np.sum(binary * (1 << np.arange(BITS)[::-1, None, None]), axis=0))
    return found


def opencv_calls(stack: np.ndarray) -> int:
    """cv2's per-pixel call at 400 places."""
    pattern = cv2.structured_light.GrayCodePattern.create(2**BITS, 2**BITS)
    images = list(stack)
    places = np.random.default_rng(3).integers(0, SHAPE[::-1], (PROBES, 2)).tolist()
    return sum(bool(pattern.getProjPixel(images, x, y)[0]) for x, y in places)


def bench() -> Report:
    """Gray 44 frames 3840x2160 uint8, streamed."""
    stack = pictures()
    fold = Fold(stack)
    runs = {
        LIVE: fold.streaming,
        "NumPy stack": fold.stacked,
        "floor": floor.Floor(stack, 6 * fold.least.size),
    }
    slow = {
        "int64 stack": (lambda: int64_decode(stack[:, : SHAPE[0] // 4]), 4.0),
        "OpenCV getProjPixel": (lambda: opencv_calls(stack), fold.least.size / PROBES),
    }
    times = interleaved(runs, slow, rounds=5)
    per_pixel = (fold.codes.nbytes + fold.least.nbytes + fold.most.nbytes) / fold.least.size
    held = per_pixel + 2 + fold.temporaries()  # white and black: a byte each
    return Report(
        "Gray code, 44 frames of 3840x2160 uint8 (22 pairs, code uint16 x2, least, most)",
        times,
        (
            at_least(times, LIVE, "int64 stack", 25),
            at_least(times, LIVE, "OpenCV getProjPixel", 500),
            Goal("state and temporaries", held, "<=", STATE_BYTES + 0.1, "B/px"),
            Goal("a pair", times[LIVE].wall_s / (2 * BITS) * 1e3, "<=", 5, "ms"),
        ),
        (
            floor.name(),
            "int64 stack: the method of the structuredlight package, written anew, on a quarter",
            f"getProjPixel: {PROBES} calls, extrapolated",
        ),
    )
