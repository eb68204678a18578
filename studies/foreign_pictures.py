"""Structured-light pictures of other programs, and photographs of them, without procam.

A drawer makes each pattern from its formula. A projector whose pixels are squares, with a gamma, a lens
out of focus and a black that is not dark, throws it through a radial lens onto a curved, painted wall.
A camera with a radial lens averages each of its pixels over an area and a disc of defocus, counts
photons, and rounds to 8 bits, in proportion to light or encoded by sRGB. `Lab` draws all of this from
a seed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PANEL, CAMERA = (192, 128), (240, 180)
FINE, PAD = 4, 16  # parts of a projector pixel along each axis; border [parts]
PARTS = 3  # of a camera pixel along each axis
GAMMA = 2.2  # for which the drawers encode light
PHOTONS = 60.0  # per count of 255 in proportion to light
CHANNELS = (0.8, 1.0, 0.7)  # red, green, blue
TOP = 225.0  # count of the brightest place in white


@dataclass(frozen=True)
class Pattern:
    """Values of one pattern along an axis (0 for columns, 1 for rows), 0 to 1."""

    line: Array
    axis: int = 0


WHITE, BLACK = Pattern(np.ones(PANEL[0])), Pattern(np.zeros(PANEL[0]))


def phases(axis: int, periods: Sequence[float], steps: int) -> list[Pattern]:
    """Equal steps of a cosine of each period."""
    x = np.arange(PANEL[axis])
    turns = [x / period - step / steps for period in periods for step in range(steps)]
    return [Pattern(0.5 + 0.5 * np.cos(2 * np.pi * turn), axis) for turn in turns]


def gray(axis: int, cell: int) -> list[Pattern]:
    """Reflected binary patterns of cells, the coarsest first: each bit is a square wave."""
    count = -(-PANEL[axis] // cell)
    bits = max(1, int(np.ceil(np.log2(count))))
    place = np.arange(PANEL[axis]) // cell
    half = [2.0 ** (bits - bit - 1) for bit in range(bits)]  # cells before a bit first rises
    return [Pattern(((place + each) // (2 * each) % 2).astype(float), axis) for each in half]


def inverted(patterns: Sequence[Pattern]) -> list[Pattern]:
    """The same with black and white exchanged."""
    return [Pattern(1 - pattern.line, pattern.axis) for pattern in patterns]


class Lab:
    """One projector, wall and camera drawn from a seed, and the noise of their photographs.

    `encoded` is how the camera's counts depend on light: by sRGB, as webcams and phones do, or in
    proportion. For a camera with sRGB, programs draw their sinusoids without regard to gamma: the
    projector's gamma and the camera's encoding nearly cancel.
    """

    def __init__(self, seed: Sequence[int], *, encoded: bool) -> None:
        rng = self._rng = np.random.default_rng(list(seed))
        self.encoded, self.gamma = encoded, rng.uniform(2.0, 2.4)
        self.ambient, self.leak = rng.uniform(0.005, 0.03), rng.uniform(1 / 2000, 1 / 400)
        self.veil = rng.uniform(0, 0.04)  # of the mean light, that the room returns
        self.defocus_px, self.blur_px = rng.uniform(0.4, 1.2), rng.uniform(0.3, 0.9)  # radii
        self._bend, self._slant = rng.uniform(-0.25, 0.25), rng.uniform(-0.2, 0.2, 2)
        self._lenses = rng.uniform(-0.12, 0.05, 2)
        self._zoom, self._side = rng.uniform(0.85, 1.25), rng.uniform(0.1, 0.35)
        self._shift = rng.uniform(-0.03, 0.03, 2)

    def photograph(self, pattern: Pattern, exposure: float = 1.0) -> NDArray[np.uint8]:
        """Photograph (H, W, 3) of a pattern."""
        light = np.asarray(cv2.blur(self._at_camera(self._emitted(pattern)), (PARTS, PARTS)))
        counts = TOP / self._brightest * exposure * light[PARTS // 2 :: PARTS, PARTS // 2 :: PARTS]
        level = counts[..., None] * np.array(CHANNELS) / max(CHANNELS)
        photons = self._rng.poisson(level * PHOTONS) / PHOTONS
        seen = photons + self._rng.normal(0, 0.4, level.shape)
        return np.clip(np.rint(_srgb(seen) if self.encoded else seen), 0, 255).astype(np.uint8)

    @cached_property
    def truth(self) -> NDArray[np.float32]:
        """Place (H, W, 2) on the panel, or in its plane beside it, at each camera pixel's centre."""
        return self._places[PARTS // 2 :: PARTS, PARTS // 2 :: PARTS].astype(np.float32)

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Camera pixels (H, W) whose centre sees the panel."""
        on = (self.truth >= -0.5) & (self.truth <= np.array(PANEL) - 0.5)
        return np.asarray(on.all(axis=-1))

    @cached_property
    def _brightest(self) -> float:
        return float(np.quantile(self._at_camera(self._emitted(WHITE)), 0.999))

    def _emitted(self, pattern: Pattern) -> NDArray[np.float32]:
        """Light of a pattern on the panel's fine grid, with its border."""
        values = pattern.line if self.encoded else pattern.line ** (1 / GAMMA)
        level = (np.rint(255 * values) / 255) ** self.gamma
        level = (level + self.leak) / (1 + self.leak)
        lines = level[None, :] if pattern.axis == 0 else level[:, None]
        flat = np.broadcast_to(lines, PANEL[::-1])
        fine = np.repeat(np.repeat(flat, FINE, axis=0), FINE, axis=1)
        shown = np.pad(fine, PAD).astype(np.float32)
        return np.asarray(cv2.filter2D(shown, -1, _disc(self.defocus_px * FINE)), np.float32)

    def _at_camera(self, emitted: NDArray[np.float32]) -> NDArray[np.float32]:
        """Light on the camera's fine grid, after its defocus."""
        where = ((self._places + 0.5) * FINE - 0.5 + PAD).astype(np.float32)
        direct = np.asarray(cv2.remap(emitted, where, None, cv2.INTER_LINEAR))
        fallen = direct * self._falloff + self.ambient + self.veil * float(emitted.mean())
        seen = (self._paint * fallen).astype(np.float32)
        return np.asarray(cv2.filter2D(seen, -1, _disc(self.blur_px * PARTS)), np.float32)

    @cached_property
    def _places(self) -> Array:
        """Projector pixel (h, w, 2) that each point of the camera's fine grid sees."""
        width, height = CAMERA[0] * PARTS, CAMERA[1] * PARTS
        x, y = np.meshgrid(
            (np.arange(width) + 0.5) / width - 0.5, (np.arange(height) + 0.5) / width
        )
        rays = _bent(np.stack([x, y - height / width / 2], axis=-1), self._lenses[0])
        # the wall z = 1 + slant . (x, y) + bend x^2, seen along (x, y, 1)
        slope = 1 - rays @ self._slant
        curve = self._bend * rays[..., 0] ** 2
        depth = 2 / (slope + np.sqrt(slope**2 - 4 * curve))
        point = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) * depth[..., None]
        angle = self._side
        turn = np.array(
            [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
        )
        seen = (point - [0, 0, 1]) @ turn.T + [0, 0, 1]
        flat = _bent(seen[..., :2] / seen[..., 2:], self._lenses[1]) + self._shift
        return np.asarray(flat * self._zoom * PANEL[0] + (np.array(PANEL) - 1) / 2)

    @cached_property
    def _falloff(self) -> Array:
        off = (self._places / (np.array(PANEL) - 1) - 0.5) ** 2
        return np.asarray(1 - 0.5 * np.minimum(off.sum(axis=-1), 1))

    @cached_property
    def _paint(self) -> Array:
        """Albedo of the wall: smooth stains and a few boards of another paint."""
        rng, (height, width) = self._rng, self._places.shape[:2]
        coarse = [rng.normal(size=(count * 3, count * 4)) for count in (2, 6, 20)]
        stains = sum(
            cv2.resize(each, (width, height), interpolation=cv2.INTER_CUBIC) for each in coarse
        )
        paint = 0.6 + 0.08 * stains
        for _ in range(5):
            left, top = rng.integers(0, width), rng.integers(0, height)
            paint[top : top + height // 4, left : left + width // 5] *= rng.uniform(0.6, 1.2)
        return np.asarray(np.clip(paint, 0.2, 0.95))


def _bent(rays: Array, bend: float) -> Array:
    return rays * (1 + bend * np.sum(rays**2, axis=-1, keepdims=True))


def _disc(radius: float) -> NDArray[np.float32]:
    """A uniform disc, its edge pixels by the share inside."""
    reach = int(np.ceil(radius))
    place = (np.arange((2 * reach + 1) * 8) + 0.5) / 8 - reach - 0.5
    inside = (place[:, None] ** 2 + place**2 <= radius**2).astype(float)
    share = inside.reshape(2 * reach + 1, 8, 2 * reach + 1, 8).mean(axis=(1, 3))
    return (share / share.sum()).astype(np.float32)


def _srgb(counts: Array) -> Array:
    light = np.clip(counts / 255, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055) * 255
