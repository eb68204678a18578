"""Test pictures for judging a calibrated room by eye, on its canvas."""

from collections.abc import Callable, Mapping

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.maths.light.curves import srgb_decode
from procam.model.screen import RoomScreen
from procam.workflows.sample_content import BLACK_TEXT, HALF_SKY_TEXT, half_sky

LINE_M, LINE_PX = 0.03, 2.0  # whichever is wider
PATCH_M = 0.5
GREY, INK = 0.2, 0.9  # of the grid [rel]
STEPS = 16  # of the ramp


def grid(size: int, screen: RoomScreen) -> Image:
    """Lines every metre of the canvas: (H, W, 3) linear, as all pictures here."""
    x, y, lit = _metres(size, screen)
    wide = max(LINE_M, LINE_PX * screen.room.size_m[0] / size)
    off = [np.abs(at - np.round(at)) for at in (x, y)]
    return _grey(np.where(np.minimum(*off) < wide / 2, INK, GREY), lit)


def soft_checker(size: int, screen: RoomScreen) -> Image:
    """Patches of half a metre, light and dark, with soft edges."""
    x, y, lit = _metres(size, screen)
    waves = np.sin(np.pi * x / PATCH_M) * np.sin(np.pi * y / PATCH_M)
    return _grey(0.4 + 0.2 * np.tanh(4 * waves), lit)


def ramp(size: int, screen: RoomScreen) -> Image:
    """Sixteen steps of grey from the left end of the canvas to the right."""
    x, _, lit = _metres(size, screen)
    step = np.minimum(np.floor(x / screen.room.size_m[0] * STEPS), STEPS - 1) / (STEPS - 1)
    return _grey(srgb_decode(step), lit)


def white(size: int, screen: RoomScreen) -> Image:
    """Full white."""
    _, _, lit = _metres(size, screen)
    return _grey(np.ones(lit.shape), lit)


def black(size: int, screen: RoomScreen) -> Image:
    """Black."""
    return np.zeros((*screen.canvas.shape(size), 3), np.float32)


# picture, and what to look for in it
ROOM_STILLS: Mapping[str, tuple[Callable[[int, RoomScreen], Image], str]] = {
    "grid": (
        grid,
        "Lines every metre from the upper left corner of the canvas. They must be single and unbroken where "
        "projectors meet, straight on flat walls, and go on at the edges between walls.",
    ),
    "checker": (
        soft_checker,
        "Soft light and dark patches. Dark patches must be equally dark on all walls, in corners too, "
        "without seams. Without compensation they are paler, most of all in corners.",
    ),
    "half-sky": (
        half_sky,
        HALF_SKY_TEXT,
    ),
    "ramp": (
        ramp,
        "Sixteen steps of grey from left to right. Steps must be neutral in colour. The darkest ones look "
        "alike, because the light of the bright ones falls on them.",
    ),
    "white": (
        white,
        "Full white. No seam, no spot, no colour from one projector to the next, no bright corner. With "
        "compensation it is darker, as the scattered light is part of it.",
    ),
    "black": (
        black,
        BLACK_TEXT,
    ),
}


def _metres(size: int, screen: RoomScreen) -> tuple[Array, Array, BoolArray]:
    """Metres to the right and down from the canvas's upper left corner (H, W), and what is lit."""
    y, x = np.indices(screen.canvas.shape(size))
    scale = screen.room.size_m[0] / size
    across, down = (np.asarray((at + 0.5) * scale, float) for at in (x, y))
    return across, down, screen.canvas.raster(size).lit


def _grey(light: FloatArray, lit: BoolArray) -> Image:
    return np.repeat((light * lit)[..., None], 3, axis=-1).astype(np.float32)
