"""Large cameras measure light by blocks of pixels, and only where the lens draws a picture.

Directions need each of a camera's pixels; light does not: it is smooth, or blurred by the lens, and a block's
mean has less noise. Memory and time of all that is done with light then have a bound whatever the camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import AnyArray, BoolArray, Image
from procam.model.optics import CameraModel

MOST_PIXELS = 6e6  # of a picture of light: finer than projectors of 1920 x 1200 by six on a dome
BESIDE = 0.15  # of the circle's diameter, kept beside it: where a stated lens has it is a guess


@dataclass(frozen=True, slots=True)
class Binning:
    """A part of a camera's photographs, of which `factor` x `factor` pixels are joined to one.

    Attributes
    ----------
    factor : edge of the blocks [px]. origin : (x, y) of the part's first pixel [px].
    size : (width, height) of what it makes of a photograph [blocks].
    """

    factor: int
    origin: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def none(cls, size: tuple[int, int]) -> "Binning":
        """All pixels of photographs of `size` (width, height), each on its own."""
        return cls(1, (0, 0), size)

    @classmethod
    def of(cls, camera: CameraModel) -> "Binning":
        """What a camera's light is measured with: its image circle, with no more than so many pixels."""
        spans = [_span(camera, axis) for axis in range(2)]
        width, height = (stop - start for start, stop in spans)
        factor = int(np.ceil(np.sqrt(width * height / MOST_PIXELS)))
        return cls(factor, (spans[0][0], spans[1][0]), (width // factor, height // factor))

    def camera(self, camera: CameraModel) -> CameraModel:
        """A camera whose pixels are the blocks."""
        lens, factor = camera.lens, self.factor
        centre = (lens.centre - np.array(self.origin) + 0.5) / factor - 0.5
        lens = replace(lens, focal=lens.focal / factor, centre=centre)
        return replace(camera, lens=lens, size=self.size)

    def part(self, picture: AnyArray) -> AnyArray:
        """The pixels (h, w[, C]) of a photograph (H, W[, C]) that are joined."""
        (left, top), (width, height) = self.origin, (n * self.factor for n in self.size)
        return picture[top : top + height, left : left + width]

    def means(self, picture: AnyArray) -> Image:
        """Means (h, w[, C]) of a photograph (H, W[, C])."""
        first, *others = self._each_pixel(picture)
        total: Image = first.astype(np.float32)
        for other in others:
            total += other
        if others:
            total /= np.float32(self.factor**2)
        return total

    def largest(self, picture: AnyArray) -> AnyArray:
        """Largest values (h, w[, C]) of a photograph (H, W[, C])."""
        return np.asarray(np.maximum.reduce(list(self._each_pixel(picture))))

    def most(self, mask: BoolArray) -> BoolArray:
        """Blocks (h, w) of which half or more are pixels of `mask` (H, W)."""
        return np.asarray(2 * self.means(mask) >= 1)

    def _each_pixel(self, picture: AnyArray) -> Iterator[AnyArray]:
        """The first, second, ... pixels (h, w[, C]) of all blocks; one plane after the other saves memory."""
        part = self.part(picture)
        for row, column in np.ndindex(self.factor, self.factor):
            yield part[row :: self.factor, column :: self.factor]


def _span(camera: CameraModel, axis: int) -> tuple[int, int]:
    """First pixel along an axis, and the one after the last, that may see light: all of a pinhole's."""
    length, diameter = camera.size[axis], min(camera.size)
    wanted = int(np.ceil((1 + BESIDE) * diameter))
    if camera.lens.kind == "brown" or wanted >= length:
        return 0, length
    middle = float(camera.lens.centre[axis])
    start = int(np.clip(np.rint(middle - wanted / 2), 0, length - wanted))
    return start, start + wanted
