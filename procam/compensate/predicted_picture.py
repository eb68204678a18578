"""The picture that a calibration's own frames make on the screen, by a calibration's model.

Directions, gains and responses can each look right while a projector sends black, or twice its share in a
seam: only the sum of what all projectors send shows it. The light of every panel pixel is summed over the
dome; nothing of what makes the frames is used but the frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.compensate.any_screen import compensator_for
from procam.compensate.projector_frames import projector_frames
from procam.maths.light.curves import apply_curve
from procam.maths.warp import grow, sample
from procam.model.calibration import Calibration, ProjectorCalibration

EDGE, PANEL_PX = 64, 5  # pixels of the picture at most; of a panel, along its side, in each of them
# of white: uniform, so that no rotation of a rig shows, and other in each colour
CONTENT = 0.5, 0.4, 0.3
SENDS = 0.01  # drive of a pixel that sends light
WELL_LIT = 0.999  # coverage
RIM = 2  # pixels beside places that are lit in part
LONGEST = 480  # side of a panel [px]; of larger ones some pixels stand for those around them
LEAST = 0.05  # light [rel] that is asked where it is judged; elsewhere more is scattered
OFF = 0.1  # relative: three times what summing pixels is off by


@dataclass(frozen=True, slots=True)
class PredictedPicture:
    """Direct light of a uniform picture on the dome, without black [rel].

    Attributes
    ----------
    light : (N, N, 3) by projector. asked : (N, N, 3) what all of them should give together.
    judged : (N, N) places that are lit from edge to edge.
    share_lit : by projector, the share of its panel's valid pixels that send light.
    """

    light: Mapping[str, Image]
    asked: Image
    judged: BoolArray
    share_lit: Mapping[str, float]

    @property
    def total(self) -> Array:
        """Of all projectors (N, N, 3)."""
        return np.asarray(np.sum(list(self.light.values()), axis=0))

    @property
    def share_off(self) -> float:
        """Share of the places that are judged whose light is a tenth or more off what was asked for."""
        off = ~(np.abs(self.total - self.asked) <= OFF * self.asked)  # also where it is no number
        return float(off[self.judged].any(axis=-1).mean()) if self.judged.any() else 0.0


def predict_picture(calibration: Calibration, model: Calibration | None = None) -> PredictedPicture:
    """The uniform picture of a calibration's frames, by its own model or another's of the same panels."""
    calibration, model = coarse(calibration), coarse(model or calibration)
    widths = [len(p.blend[0]) for p in model.projectors.values()]
    edge = max(2, min(EDGE, min(widths) // PANEL_PX))
    asked, frames = _frames(calibration, edge)
    direction, inside = model.canvas.directions(edge)
    place = model.screen.canvas.pixels(direction, model.maps.size)
    asked = np.asarray(asked - sample(model.maps.lo, place), np.float32)
    lit = inside & (sample(model.maps.coverage, place) > WELL_LIT)
    return PredictedPicture(
        {n: _on_canvas(model, model.projectors[n], drive, edge) for n, drive in frames.items()},
        asked,
        grow(lit, -RIM) & (asked > LEAST).all(axis=-1),
        {n: _share(model.projectors[n], drive) for n, drive in frames.items()},
    )


def coarse(calibration: Calibration) -> Calibration:
    """The calibration with fewer pixels of large panels: enough for a picture of this size."""
    projectors = {name: thinned(p) for name, p in calibration.projectors.items()}
    return replace(calibration, projectors=projectors)


def thinned(projector: ProjectorCalibration) -> ProjectorCalibration:
    """A projector whose pixels are so many together as its panel is longer than `LONGEST`."""
    surface, photometry, blend = projector.surface, projector.photometry, projector.blend
    step = -(-max(blend.shape) // LONGEST)
    parts = {f.name: getattr(surface, f.name)[::step, ::step].copy() for f in fields(surface)}
    parts["solid_angle_sr"] = parts["solid_angle_sr"] * step**2
    exponent = photometry.exponent
    light = replace(
        photometry,
        gain=photometry.gain[::step, ::step].copy(),
        exponent=None if exponent is None else exponent[::step, ::step].copy(),
    )
    return replace(
        projector,
        surface=replace(surface, **parts),
        photometry=light,
        blend=np.ascontiguousarray(blend[::step, ::step]),
    )


def _frames(calibration: Calibration, edge: int) -> tuple[Image, dict[str, Image]]:
    """Direct light (N, N, 3) that the content asks for, and the frames for it."""
    shape = calibration.canvas.shape(edge)
    content = np.broadcast_to(np.array(CONTENT, np.float32), (*shape, 3))
    direct = compensator_for(calibration)(calibration, edge).frame(np.ascontiguousarray(content))
    return np.asarray(direct), projector_frames(direct, calibration)


def _share(projector: ProjectorCalibration, drive: Image) -> float:
    """Share of a panel's valid pixels that send light."""
    sends = (drive.max(axis=-1) > SENDS)[projector.surface.valid]
    return float(sends.mean()) if sends.size else 0.0


def _on_canvas(
    model: Calibration, projector: ProjectorCalibration, drive: Image, edge: int
) -> Image:
    """Direct light (N, N, 3) of a projector's frame, its black left out."""
    surface, photometry = projector.surface, projector.photometry
    use = surface.valid & np.isfinite(surface.direction).all(axis=-1)
    light = apply_curve(drive[use], photometry.response.levels, photometry.response.values)
    if photometry.exponent is not None:
        light = light ** photometry.exponent[use]
    light = light @ photometry.colour_mix.T * photometry.gain[use]
    flux = light * surface.solid_angle_sr[use][:, None]
    place = model.canvas.pixels(surface.direction[use], edge)
    area = np.maximum(model.canvas.weights(edge), 1e-12)
    return np.asarray(_splat(place, flux, area.shape) / area[..., None], np.float32)


def _splat(place: FloatArray, flux: Array, shape: tuple[int, ...]) -> Array:
    """Sums (H, W, C) of flux (K, C), shared among the four pixels around each place (K, 2)."""
    corner = np.floor(place).astype(np.intp)
    share = place - corner
    rows, columns = shape
    total = np.zeros((rows * columns, flux.shape[1]))
    for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
        column, row = (np.clip(corner + step, 0, [columns - 1, rows - 1])).T
        weight = np.abs(1 - np.array(step) - share).prod(axis=1)
        at = row * columns + column
        for channel in range(flux.shape[1]):
            total[:, channel] += np.bincount(at, weight * flux[:, channel], rows * columns)
    return total.reshape(rows, columns, -1)
