"""Change of the scattered light, and of the room's own, from photographs of full white and of the dark."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.drift.pictures import PanelGrid, VenuePhotographs
from procam.estimate.drift.room_scatter_change import (
    FEWEST,
    content_light,
    room_scatter_ratio,
)
from procam.estimate.light.audience import GREEN, AudienceView, ZoneObservation
from procam.maths.warp import sample
from procam.model.calibration import Calibration
from procam.model.screen import RoomScreen
from procam.model.transport import Measured

LEAST_SIGMA = 5e-5  # of white


def scatter_ratio(
    calibration: Calibration, before: VenuePhotographs, now: VenuePhotographs, names: Sequence[str]
) -> Measured | None:
    """Scattered light per direct light over that of before (3,), by the whites of some projectors."""
    if len(names) < FEWEST:
        return None
    if isinstance(calibration.screen, RoomScreen):
        return room_scatter_ratio(calibration, before, now, names)
    pairs = []
    for photographs in (before, now):
        view = AudienceView(calibration, photographs.view)
        pairs.append((view, [_observed(view, calibration, photographs, name) for name in names]))
    (_, old), (view, new) = pairs
    return view.scatter_ratio(new, old)


def _observed(
    view: AudienceView, calibration: Calibration, photographs: VenuePhotographs, name: str
) -> ZoneObservation:
    width, height = calibration.projectors[name].model.size
    lit = view.expected(name, np.ones((height, width, 1), np.float32)) > 0
    return view.observe(content_light(calibration, photographs.projectors[name].white), lit)


def ambient_light(
    calibration: Calibration, before: VenuePhotographs, now: VenuePhotographs
) -> Measured:
    """Rise (3,) of the light of the dark room, on the screen, and its standard error [rel]."""
    (old, old_sigma), (new, new_sigma) = (_mean(calibration, each) for each in (before, now))
    return Measured(new - old, np.hypot(np.hypot(old_sigma, new_sigma), LEAST_SIGMA))


def _mean(calibration: Calibration, photographs: VenuePhotographs) -> tuple[Array, Array]:
    """Mean (3,) of the dark over the screen, and its standard error from parts of the picture."""
    dark = content_light(calibration, photographs.dark)
    good = photographs.view.on_screen & np.isfinite(dark).all(axis=-1)
    mean = dark[good].mean(axis=0, dtype=float)
    noise = dark[good].std(axis=0, dtype=float) / np.sqrt(max(1, int(good.sum())))
    return np.asarray(mean), np.asarray(noise)


def scattered_share(calibration: Calibration, name: str, grid: PanelGrid) -> Image:
    """Share (h, w) of scattered light in what is seen of a projector's white, green.

    Scattered light is taken to be in proportion to u: to percents of itself.
    """
    projector, step = calibration.projectors[name], grid.step
    gain = projector.photometry.gain[..., GREEN] * projector.surface.valid
    flux = float(np.nansum(gain * projector.surface.solid_angle_sr, dtype=float))
    maps, canvas = calibration.maps, calibration.screen.canvas
    places = canvas.pixels(np.nan_to_num(grid.direction), maps.size)
    scattered = flux * sample(maps.scatter_per_flux[..., GREEN], places)
    direct = np.maximum(gain[::step, ::step], 1e-9)
    return np.asarray(np.clip(scattered / (direct + scattered), 0, 0.99), np.float32)
