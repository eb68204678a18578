"""One projector's light, read off the pictures of a session."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procam.estimate.assemble import Measurement
from procam.estimate.bundle import Pair
from procam.estimate.geometry import GeometrySolution
from procam.estimate.glints import lens_glints
from procam.estimate.hidden import fill_light, fill_picture, hidden_pixels
from procam.estimate.photometry import ResponseFit, fit_colour, tile_levels
from procam.estimate.scatter import Lighting, ScatterCells
from procam.estimate.transport import CLEAR_CAMERA_PX, Light, Separation
from procam.estimate.view import DomeView
from procam.maths.shot_id import taken_pixels
from procam.maths.warp import grow, sample
from procam.model.correspondence import CorrespondenceMap
from procam.model.mask import Mask
from procam.model.screen import Dome
from procam.workflows.readings import Readings

Image = NDArray[np.float32]


def measure_light(
    dome: Dome,
    readings: Readings,
    view: DomeView,
    geometry: GeometrySolution,
    found: Mapping[Pair, CorrespondenceMap],
    name: str,
) -> Measurement:
    """Projector `name`'s light, split and fitted; black is measured at its own long exposure.

    Where pictures carried their numbers they showed no pattern, and where the camera looks into a
    lens it sees no screen: these places are left out of every fit, and filled from around them at
    the end.
    """
    dark, dark_long = readings.dark()
    black = readings.light(readings.only(name, "black")) - dark_long
    base = black + dark
    glints = view.on_screen & lens_glints(geometry.rig, geometry.main, readings.radiometer.rays)
    white = readings.light(readings.only(name, "white")) - base
    white = fill_picture(white, glints, view.on_screen)
    xy = view.projector_pixels(geometry.projectors[name], dome)
    hidden = glints | _under_numbers(readings, geometry, name, xy)
    xy = np.where(hidden[..., None], np.float32(np.nan), xy)
    decoded = found[geometry.main, name].valid | hidden
    separation = Separation(white, xy, decoded, view.solid_angle_sr)
    for axis, bit, pattern, inverse in readings.stripe_pairs(name):
        separation.add_pair(axis, bit, pattern - base, inverse - base)
    light = separation.result()

    def direct_part(picture: Image) -> Image:
        share = separation.flux_share(picture).astype(np.float32)
        return picture - share * light.scattered

    primaries = [direct_part(readings.light(s) - base) for s in readings.plan.of(name, "primary")]
    sound = light.lit & ~hidden
    colour = fit_colour(primaries, np.where(sound[..., None], light.direct, 0))
    fit = ResponseFit(light.direct, colour.mix)
    for shot in readings.plan.of(name, "levels"):
        level = tile_levels(readings.session.pattern(shot), xy, light.lit)
        fit.add(direct_part(readings.light(shot) - base), level)
    if hidden.any():
        on_screen = view.solid_angle_sr > 0
        light = fill_light(light, white, hidden, view.solid_angle_sr)
        black = fill_picture(black, hidden & on_screen, on_screen)
    lightings = _lightings(readings, view, name, (light, xy, base))
    return Measurement(light, black, colour, fit.curve(), lightings)


def _lightings(
    readings: Readings, view: DomeView, name: str, white: tuple[Light, Image, Image]
) -> list[Lighting]:
    """Bounced light of a projector's white and of its quarters, where nothing else is seen."""
    light, xy, base = white
    cells = ScatterCells(view.direction, view.solid_angle_sr)
    found = [cells.lighting(light.scattered, view.on_screen, light.direct)]
    for shot in readings.plan.of(name, "zone"):
        shown = sample(readings.session.pattern(shot)[..., 0], xy)
        met = light.lit & ((shown > 0) | np.isnan(xy[..., 0]))
        dark = view.on_screen & ~grow(met, CLEAR_CAMERA_PX)
        picture = readings.light(shot) - base
        found.append(cells.lighting(picture, dark, light.direct * shown[..., None]))
    return found


def _under_numbers(
    readings: Readings, geometry: GeometrySolution, name: str, xy: Image
) -> NDArray[np.bool_]:
    """Camera pixels (H, W) that see where a projector's pictures carried their numbers."""
    if "number" not in readings.only(name, "white").detail:
        return np.zeros(xy.shape[:2], bool)
    taken = Mask(name, taken_pixels(geometry.projectors[name].size))
    return hidden_pixels(taken, xy)
