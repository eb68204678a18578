"""Projector frames: warp, black, blend, colour mixing, response and dither, 4096^2 to 3840x2160."""

from functools import cache

import cv2
import numpy as np

from benchmarks import floor
from benchmarks.measure import (
    Goal,
    Report,
    at_least,
    at_levels,
    at_most,
    between_levels,
    interleaved,
)
from procam import kernels
from procam.kernels.warp.reference import KNOTS, WarpPlan
from procam.maths.light.curves import srgb_decode

MASTER = 4096
SHAPE = (2160, 3840)
TURN = 0.5
STEP_PX = 0.85  # of the master per pixel of the projector, in the middle
GAMMA = 2.2
MIX = np.array([[0.95, 0.03, 0.02], [0.02, 0.96, 0.02], [0.01, 0.04, 0.95]])
CODES = srgb_decode(np.arange(256) / 255).astype(np.float32)
ENCODED = np.rint(255 * np.linspace(0, 1, 65536) ** (1 / GAMMA)).astype(np.uint8)


@cache
def numbers() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place (H, W, 2), black and share (H, W, 3) of a turned projector with edges to blend."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    u, v = (x - SHAPE[1] / 2) * STEP_PX, (y - SHAPE[0] / 2) * STEP_PX
    bulge = 0.9 + 0.1 * (u * u + v * v) / (MASTER / 2) ** 2
    place = np.stack([np.cos(TURN) * u - np.sin(TURN) * v, np.sin(TURN) * u + np.cos(TURN) * v], -1)
    place = place * bulge[..., None] + MASTER / 2
    blend = np.clip(np.minimum(x, SHAPE[1] - x) / 800, 0, 1)
    share = (blend / (1 + 0.3 * np.cos(y / 900)))[..., None] * np.array([1, 0.95, 0.9])
    black = 0.003 * (1 + 0.2 * np.cos(x / 500))[..., None] * np.ones(3)
    return tuple(a.astype(np.float32) for a in (place, black, share))


@cache
def master() -> np.ndarray:
    """Soft random light (N, N, 3), 8-bit."""
    noise = np.random.default_rng(5).integers(0, 256, (MASTER, MASTER, 3), np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2) * 3  # wraps round: edges too


def plain_drive(picture: np.ndarray, unmix: np.ndarray) -> np.ndarray:
    """The same by cv2.remap of linear light and NumPy in float32, 0..1."""
    place, black, share = numbers()
    light = cv2.remap(np.take(CODES, picture), place, None, cv2.INTER_LINEAR)
    light -= black
    light *= share
    return np.clip(light @ unmix.T, 0, 1) ** np.float32(1 / GAMMA)


def plain_frame(picture: np.ndarray, unmix: np.ndarray, tile: np.ndarray) -> np.ndarray:
    """Dithered to 8 bits."""
    return (255 * plain_drive(picture, unmix) + tile).astype(np.uint8)


def short_frame(picture: np.ndarray, unmix: np.ndarray) -> np.ndarray:
    """All in cv2 and as short as it gets: sampled as encoded, to 1/32 px; tables; no dither."""
    _, black, share = numbers()
    light = cv2.LUT(cv2.remap(picture, *_fixed(), cv2.INTER_LINEAR), CODES)
    light = cv2.transform(cv2.multiply(cv2.subtract(light, black), share), unmix)
    return cv2.LUT(cv2.multiply(light, (65535.0,) * 4, dtype=cv2.CV_16U), ENCODED)


@cache
def _fixed() -> tuple[np.ndarray, np.ndarray]:
    return cv2.convertMaps(numbers()[0], None, cv2.CV_16SC2)


@cache
def thresholds() -> np.ndarray:
    """Of the dither (64, 64)."""
    return np.random.default_rng(6).uniform(0, 1, (64, 64)).astype(np.float32)


@cache
def plan() -> WarpPlan:
    """Of the projector."""
    drives = np.repeat(KNOTS[:, None] ** (1 / GAMMA), 3, axis=1)
    return kernels.plan_warp(
        *numbers(), np.linalg.inv(MIX), drives=drives, decode=CODES, thresholds=thresholds()
    )


def bench() -> Report:
    """One 4K projector from a 4096^2 sRGB master."""
    picture, unmix = master(), np.linalg.inv(MIX).astype(np.float32)
    tile = np.tile(thresholds(), [-(-n // 64) for n in SHAPE])[: SHAPE[0], : SHAPE[1], None]
    out = kernels.warp_frame(picture, plan())
    whole = kernels.warp_frame(picture, plan(), dtype=np.uint16)
    miss = float(np.abs(whole / np.float32(257) - 255 * plain_drive(picture, unmix)).max())
    place = numbers()[0]

    def kernel() -> None:
        kernels.warp_frame(picture, plan(), out)

    move = floor.Floor.of_bytes(plan().blocks.nbytes + picture.nbytes, out.nbytes)
    runs = {
        "kernel": kernel,
        **at_levels("kernel", kernel),
        "cv2.remap + NumPy": lambda: plain_frame(picture, unmix, tile),
        "cv2 chain, no dither": lambda: short_frame(picture, unmix),
        "cv2.remap alone": lambda: cv2.remap(picture, place, None, cv2.INTER_LINEAR),
        "floor": move,
        "limit, avx2": floor.Instructions(floor.counted("a frame warped") * out[..., 0].size),
    }
    times = interleaved(runs, rounds=9)
    return Report(
        "Projector frame: 4096^2 sRGB to 3840x2160, black, blend, unmixing, response, dither",
        times,
        (
            at_least(times, "kernel", "cv2.remap + NumPy", 3.5),
            at_least(times, "kernel", "cv2 chain, no dither", 2),
            at_most(times, "kernel", "cv2.remap alone", 1.1),
            *between_levels(times, "kernel", 2.2),
            Goal("kernel, best wall", times["kernel"].best_wall_s * 1e3, "<=", 25, "ms"),
            Goal("most error before dither", miss, "<=", 1, "/255"),
        ),
        (
            floor.name(),
            "cv2.remap + NumPy: decoded by table, float32, a power for the response; dithered",
            "cv2 chain: sampled as encoded and to 1/32 px, response by table; not dithered",
            "best wall: a busy machine has the median for its own",
        ),
    )
