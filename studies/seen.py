"""What an audience sees of a calibration: content, compensated, sent through every projector to the scene.

The last judge of whatever makes a calibration. Maps, poses and directions may all be right while a
projector sends black, and then only the picture on the dome shows it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.compensate.compensator import Compensator
from procam.compensate.projector_frames import projector_frames
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.sphere import master_pixels
from procam.maths.warp import sample
from simulators.backend import build_scene, build_server
from simulators.scene import ALL_BANDS, DomeScene
from simulators.server import projector_drives
from simulators.sight_lines import SightLines

EDGE = 96  # of the content and of what is seen [px]
LIT = 0.01  # drive above which a panel pixel sends a picture
WHOLE = 0.999  # coverage of a place that is judged


@dataclass(frozen=True)
class Seen:
    """A picture on the dome, without camera or noise.

    Attributes
    ----------
    total, target : (N, N, 3) what is seen, and what was meant [rel]. judged : (N, N) well lit places.
    seam : (N, N) places that two projectors share by their true light.
    share_lit, mean : of each projector's panel: share of its pixels that send light; mean drive.
    """

    total: Image
    target: Image
    judged: BoolArray
    seam: BoolArray
    share_lit: Mapping[str, float]
    mean: Mapping[str, float]

    def error(self, where: BoolArray | None = None) -> float:
        """Root mean square of what is seen less what was meant, over the target's mean [-]."""
        use = self.judged if where is None else self.judged & where
        off = (self.total - self.target)[use]
        return float(np.sqrt(np.mean(off**2)) / self.target[use].mean())

    @property
    def level(self) -> float:
        """Mean of what is seen over that of what was meant [-]."""
        return float(self.total[self.judged].mean() / self.target[self.judged].mean())


def grey(level: float = 0.4) -> Image:
    """A uniform picture, which shows every seam and every dark projector."""
    return np.full((EDGE, EDGE, 3), level, np.float32)


def front(canvas: Canvas = STANDARD) -> Image:
    """Bright at the front, and at the rear brighter than the light that scatters there."""
    direction, inside = canvas.directions(EDGE)
    picture = (0.4 + 0.2 * direction[..., 0]) * inside
    return np.asarray(picture[..., None].repeat(3, axis=-1), np.float32)


def waves(canvas: Canvas = STANDARD) -> Image:
    """Waves of 30 degrees, which show where the picture is."""
    direction, inside = canvas.directions(EDGE)
    azimuth, elevation = (
        np.arctan2(direction[..., 1], direction[..., 0]),
        np.arcsin(direction[..., 2]),
    )
    picture = (0.45 + 0.2 * np.sin(12 * azimuth) * np.sin(12 * elevation)) * inside
    return np.asarray(picture[..., None].repeat(3, axis=-1), np.float32)


def seen(venue: Path, calibration: Path, content: Image, canvas: Canvas | None = None) -> Seen:
    """What the simulated venue, as it is now, shows of linear content (N, N, 3) on a canvas.

    Without one, on that of the calibration.
    """
    known, settings = load_calibration(calibration), load_venue(venue).backends["simulated"]
    scene = build_scene(settings, venue)
    server = build_server(scene, settings, venue)
    compensator = Compensator(known, len(content), "exact")
    drives = projector_frames(compensator.frame(content), known)
    direction, inside = (canvas or known.canvas).directions(len(content))
    rays = np.where(inside[..., None], direction, np.nan)
    lines = SightLines.along(scene.room, scene.lights, np.zeros(3), rays)
    sent = projector_drives(server, drives)
    light = scene.radiance_of_drives(lines, sent, dict.fromkeys(sent, 1.0), ALL_BANDS, 0)
    coverage = sample(known.maps.coverage, master_pixels(direction, known.maps.size))
    return Seen(
        light @ known.content_from_camera.T.astype(np.float32),
        compensator.target(content),
        inside & (coverage > WHOLE),
        _seams(scene, lines),
        {name: float((drive.max(axis=-1) > LIT).mean()) for name, drive in drives.items()},
        {name: float(drive.mean()) for name, drive in drives.items()},
    )


def _seams(scene: DomeScene, lines: SightLines) -> BoolArray:
    """Places that more than one projector reaches, by their true footprints."""
    reached: list[Array] = [
        lines.direct(name, light.lit.astype(np.float32)[..., None])[..., 0] > 0
        for name, light in scene.lights.items()
    ]
    return np.asarray(np.sum(reached, axis=0) > 1)
