"""A media server that is fed with dome masters, as one projector with an ideal fisheye lens.

The format defines the direction of every pixel of a master (equidistant, square), so nothing of this
projector is solved for; the server's own calibration aligns the picture with the dome.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from procam.arrays import BoolArray, Image
from procam.estimate.media_server.tags import TAG_PICTURES, draw_tags, master_tags
from procam.estimate.structured_light.codes import Picture
from procam.estimate.structured_light.patterns import black_picture, light_pictures, plan_of
from procam.maths.geometry.canvas import Canvas
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose, rotation_matrix
from procam.maths.warp import blur
from procam.model.optics import ProjectorModel
from procam.model.plan import Plan, Shot

COARSE_PX = 1024  # raster of the pictures that measure light
STRIPES = 64  # finest, across the master: 3 degrees, ten times the error of a usual server
SECTORS, DISC_SHARE = 3, 0.55  # of the zones: number around the disc, and the disc's radius
LIT_SHARE = 0.35  # of the stripes' usual contrast, from which a pixel is lit
USUAL_PERCENT = 90.0  # percentile that is the usual value, as most of a dome may be unlit
LEAST_BLUR_PX = 0.7  # suppresses the noise of single camera pixels
MASTER_FROM_POLE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class DomeMaster:
    """A square dome master of `size` [px], full field of view `fov` and `rotation` [rad].

    Its bottom edge is shown at azimuth `rotation` of the dome.
    """

    name: str
    size: int
    fov: float = np.pi
    rotation: float = 0.0

    @property
    def model(self) -> ProjectorModel:
        """The projector model: theta = r fov / N is an equidistant fisheye of focal length N / fov."""
        middle = (self.size - 1) / 2
        lens = Lens(
            "kannala-brandt", np.full(2, self.size / self.fov), np.full(2, middle), np.zeros(4)
        )
        turn = MASTER_FROM_POLE @ rotation_matrix([0.0, 0.0, -self.rotation])
        return ProjectorModel(self.name, (self.size, self.size), lens, Pose(turn, np.zeros(3)))

    @property
    def canvas(self) -> Canvas:
        """The canvas that content is drawn on for it."""
        return Canvas(self.fov, self.rotation)

    @property
    def coarse(self) -> int:
        """Side of the blocks of equal pixels in pictures that measure light [px]."""
        return max(1, round(self.size / COARSE_PX))

    def coarse_pixels(self, xy: Image) -> Image:
        """Positions (..., 2) of the master [px] on the raster of these blocks."""
        return np.asarray((xy + 0.5) / self.coarse - 0.5, np.float32)

    def inside(self, xy: Image) -> BoolArray:
        """Whether positions (..., 2) [px] lie in the master's circle; NaN is outside."""
        middle = (self.size - 1) / 2
        with np.errstate(invalid="ignore"):
            return np.asarray(np.hypot(*np.moveaxis(xy - middle, -1, 0)) <= self.size / 2)

    @property
    def stripe_bits(self) -> tuple[int, int]:
        """The two finest planes of the Gray code, on the coarse raster, whose stripes are wide enough."""
        across = -(-self.size // self.coarse)
        finest = max(1, int(np.ceil(np.log2(across / STRIPES))) - 1)
        return finest, finest + 1


def plan_server(
    master: DomeMaster, exposure_s: float, black_exposure_s: float
) -> tuple[Plan, dict[str, Picture]]:
    """The plan for a server, 23 shots, and its pictures (N, N, 1 or 3) by path.

    White, black, tags at known directions, and patterns that measure light. There is no code, as the
    directions are known.
    """
    shown = _pictures(master, exposure_s, black_exposure_s)
    return plan_of({master.name: shown}, exposure_s, black_exposure_s)


def lit_by_stripes(white: Image, pairs: Iterable[tuple[Image, Image]]) -> BoolArray:
    """Camera pixels (H, W) with direct light, from stripes and their inverses, (H, W, C) each.

    `white` (H, W, C) is white minus black. Scattered light makes it bright on the whole dome; the
    difference of a stripe pattern and its inverse is direct light alone.
    """
    contrast = np.zeros(white.shape[:2], np.float32)
    for pattern, inverse in pairs:
        contrast = np.maximum(contrast, np.abs(pattern - inverse)[..., 1])
    contrast = np.nan_to_num(contrast)
    light = blur(np.maximum(np.nan_to_num(white[..., 1]), 0), LEAST_BLUR_PX)
    bright = light > 0.02 * float(np.percentile(light, USUAL_PERCENT))
    share = np.where(bright, blur(contrast, LEAST_BLUR_PX) / np.maximum(light, 1e-12), 0)
    usual = float(np.percentile(share[bright], USUAL_PERCENT)) if bright.any() else np.inf
    return np.asarray(share > LIT_SHARE * usual)


def zone_picture(size: int, zone: int) -> Picture:
    """A white zone (N, N, 1) of a master: the disc around its pole, or a third of the ring around it.

    The zones differ in height on the dome, which determines how light from high up is scattered;
    quarters of a master would not.
    """
    place = (np.arange(size) - (size - 1) / 2) / (size / 2)
    x, y = np.meshgrid(place, place)
    high = np.hypot(x, y) < DISC_SHARE
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS).clip(0, SECTORS - 1)
    lit = high if zone == 0 else ~high & (sector == zone - 1)
    return (255 * lit[..., None]).astype(np.uint8)


def _pictures(
    master: DomeMaster, exposure_s: float, black_exposure_s: float
) -> Iterator[tuple[Shot, Picture]]:
    n = master.size
    full = np.full((n, n, 1), 255, np.uint8)
    once = (exposure_s,)
    yield Shot("", "", "", "white", once), full
    yield black_picture(full, exposure_s, black_exposure_s)
    for picture in range(TAG_PICTURES):
        tags = master_tags(n, master.fov, picture)
        drawn = draw_tags(master.model, tags, master.fov)
        yield Shot("", "", "", "tags", once, "mono", {"picture": picture}), drawn
    across = -(-n // master.coarse)
    zones = (zone_picture(across, zone) for zone in range(1 + SECTORS))
    for shot, coarse in light_pictures((across, across), master.stripe_bits, zones, exposure_s):
        fine = coarse.repeat(master.coarse, axis=0).repeat(master.coarse, axis=1)
        yield shot, np.ascontiguousarray(fine[:n, :n])
