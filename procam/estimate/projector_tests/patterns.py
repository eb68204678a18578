"""Test patterns that reveal the effects of a projector's settings.

Eight square patches in black rings, in two rows of four. One of two complementary patterns has half of the
patches white, the other the other half. Both have the same flux, hence the same scattered light, so their
difference contains direct light only.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import BoolArray, FloatArray, Image, IndexArray

COLUMNS, ROWS = 4, 2
COUNT = COLUMNS * ROWS
PATCH_SHARE = 0.05 / (COUNT / 2)  # of the panel: half of the patches make 5 %
MIN_SIDE_PX, MIN_RING_PX = 10, 4  # blur and sharpening reach 3 px from an edge
RING_SHARE = 0.125  # of a patch's side
STRIPE_PX = 6  # period along rows and columns of diagonal stripes
HALF_LIGHT = 186 / 255  # drive of about half of white's light
GREYS = (157, 210)  # about a third and two thirds of white's light
DARK_LEVELS = (0, 24, 16, 8, 16, 8, 0, 24)  # drive 0..255 by patch: each level in two columns
BRIGHT_LEVELS = (255, 157, 247, 239, 210, 247, 231, 255)
COLOUR_PAIRS = (((1, 0, 0), (0, 1, 1)), ((0, 1, 0), (1, 0, 1)), ((0, 0, 1), (1, 1, 0)))


def patch_bits(bit: int) -> BoolArray:
    """Patches (8,) whose number has this bit set: chequered, every other column, the right half."""
    row, column = np.divmod(np.arange(COUNT), COLUMNS)
    return np.asarray(((row + column) % 2, column % 2, column // 2)[bit] == 1)


def patch_codes() -> IndexArray:
    """The number (8,) of each patch, made of its three bits."""
    return np.asarray(sum(patch_bits(bit).astype(np.intp) << bit for bit in range(3)))


@dataclass(frozen=True, slots=True)
class PatchLayout:
    """Positions and sizes [px] of the patches on a panel of `size` (width, height)."""

    size: tuple[int, int]

    @property
    def side_px(self) -> int:
        """Side of a patch [px]."""
        width, height = self.size
        return max(MIN_SIDE_PX, round((PATCH_SHARE * width * height) ** 0.5))

    @property
    def ring_px(self) -> int:
        """Width of the black ring round a patch [px]."""
        return max(MIN_RING_PX, round(RING_SHARE * self.side_px))

    def picture(self, levels: FloatArray, elsewhere: float = 0.0) -> Image:
        """Drive (H, W, 3) with patches of drives (8,) or (8, 3), and `elsewhere` beyond their rings."""
        width, height = self.size
        picture = np.full((height, width, 3), elsewhere, np.float32)
        for place, level in enumerate(levels):
            self._fill(picture, place, self.side_px + 2 * self.ring_px, 0.0)
            self._fill(picture, place, self.side_px, level)
        return picture

    def bit(self, bit: int) -> Image:
        """The pattern (H, W, 3) of one bit of the patches' numbers: white where it is set."""
        return self.picture(patch_bits(bit).astype(float))

    def pair(self, elsewhere: float = 0.0) -> tuple[Image, Image]:
        """Bit 0 and its complement (H, W, 3), with the drive `elsewhere` beyond the rings."""
        first = patch_bits(0).astype(float)
        return self.picture(first, elsewhere), self.picture(1 - first, elsewhere)

    def colours(self) -> list[Image]:
        """Three patterns (H, W, 3): primaries on one half of the patches, their complements on the other.

        Their light adds up to that of the first of `pair` and twice the second. Each has the flux of
        one of the pair.
        """
        first = patch_bits(0)[:, None]
        return [self.picture(np.where(first, pure, mixed)) for pure, mixed in COLOUR_PAIRS]

    def steps(self, levels: tuple[int, ...]) -> Image:
        """Patches of drives (8,), 0..255, on black (H, W, 3)."""
        return self.picture(np.array(levels) / 255)

    def stripes(self, slant: int, low: float, high: float) -> Image:
        """Diagonal stripes (H, W, 3) of two drives; `slant` 1 falls to the left, -1 to the right."""
        width, height = self.size
        phase = (np.arange(width) + slant * np.arange(height)[:, None]) % STRIPE_PX
        grey = np.where(phase < STRIPE_PX // 2, high, low).astype(np.float32)
        return np.repeat(grey[..., None], 3, axis=2)

    def _fill(self, picture: Image, place: int, side: int, level: FloatArray | float) -> None:
        """Fill a square around the centre of a patch."""
        width, height = self.size
        row, column = divmod(place, COLUMNS)
        x = round((column + 0.5) * width / COLUMNS - side / 2)
        y = round((row + 0.5) * height / ROWS - side / 2)
        picture[max(y, 0) : y + side, max(x, 0) : x + side] = level
