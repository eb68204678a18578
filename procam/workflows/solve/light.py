"""One projector's light, measured on the pictures of a session."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import BoolArray, Image
from procam.errors import OutOfModelRange
from procam.estimate.calibration import ProjectorMeasurement
from procam.estimate.camera.linearity import Linearity, linearity_error
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.lens_glints import lens_glints
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.direct_light import well_inside
from procam.estimate.light.inpaint import fill_light, fill_picture, pixels_without_pattern
from procam.estimate.light.projector_response import ProjectorResponseFit, fit_colour, tile_levels
from procam.estimate.light.scatter_kernel import ScatterCells, ScatterSample
from procam.estimate.light.separation import MAX_BLUR, OVERSHOOT, SeparatedLight, Separation
from procam.estimate.light.stability import StabilityChecks
from procam.estimate.media_server.dome_master import DomeMaster, lit_by_stripes
from procam.estimate.media_server.local_response import Levels, fit_exponent, level_samples
from procam.maths.codes.shot_id import CELLS_PER_MASTER, CELLS_PER_PANEL, shot_id_pixels
from procam.maths.warp import grow, sample
from procam.model.mask import Mask
from procam.model.plan import Shot
from procam.model.screen import Dome
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.code_light import wave_notes
from procam.workflows.solve.direct_light import Decoded, check_decoded
from procam.workflows.solve.long_exposure import black_notes
from procam.workflows.solve.mirrored import check_not_mirrored

GREEN = 1
# departures from exponent 1: a tone curve, refused first; then what is refused if light held still
# (drift of a percent between photographs makes 0.02)
TONE_CURVE, NOT_LINEAR = 0.3, 0.05
CERTAIN = 5.0  # sigmas
SATURATED = 0.005  # of the screen: white paper on it, glints


@dataclass(frozen=True, slots=True)
class CameraSight:
    """One projector as the main camera sees it.

    Attributes
    ----------
    xy : (H, W, 2) panel pixel, NaN where there is none. panel : its pixels on the raster that stripes
        and levels are drawn on, NaN also where they are hidden.
    lit : (H, W) sees the projector's picture. maybe_lit : (H, W) may see it, or see a pixel of it in part.
    unpatterned : (H, W) sees no pattern, because of a shot mark or a glint of the lens.
    white, base : (H, W, 3) white less the base; black and room light at white's exposure.
    shot_ids_share : share of the panel that its pictures' numbers take.
    """

    xy: Image
    panel: Image
    lit: BoolArray
    maybe_lit: BoolArray
    unpatterned: BoolArray
    white: Image
    base: Image
    shot_ids_share: float


def measure_light(
    dome: Dome,
    images: SessionImages,
    view: DomeView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
    masks: Mapping[str, Mask],
    name: str,
) -> ProjectorMeasurement:
    """Projector `name`'s light, split and fitted; black is measured at its own long exposure.

    Where pictures carried their numbers they showed no pattern, and where the camera looks into a
    lens it sees no screen: these places are left out of every fit, and filled from around them at
    the end. What is masked on the panel shines here too, and counts until then.
    """
    black, sight = camera_sight(dome, images, view, geometry, found, name)
    check_not_mirrored(images, name, sight.panel, sight.lit, sight.white, sight.base)
    linearity = _linearity(images, name, sight)
    _check_linear(images, name, linearity, TONE_CURVE)
    measurement, _ = _measured(images, view, name, black, sight)
    _check_linear(images, name, linearity, NOT_LINEAR)  # if light held still, it is no drift
    sound = measurement.light.lit & ~sight.unpatterned
    waves = wave_notes(images, name, sight.xy, sound, sight.base, measurement)
    measurement = replace(measurement, notes=[*measurement.notes, *waves])
    return _without(measurement, masks[name].at(sight.xy))


def camera_sight(
    dome: Dome,
    images: SessionImages,
    view: DomeView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
    name: str,
) -> tuple[Image, CameraSight]:
    """A projector's black (H, W, 3), and the projector as the camera sees it."""
    black, base = _black(images, name)
    glints = view.on_screen & lens_glints(geometry.rig, geometry.main, images.radiometer.rays)
    white = images.light(images.only(name, "white")) - base
    _check_saturation(white, view.on_screen & ~glints, name)
    white = fill_picture(white, glints, view.on_screen)
    xy = view.projector_pixels(geometry.projectors[name], dome)
    shot_ids_share = _shot_id_mask(images, geometry, name, CELLS_PER_PANEL)
    unpatterned = glints | pixels_without_pattern(shot_ids_share, xy)
    panel = np.where(unpatterned[..., None], np.float32(np.nan), xy)
    inside, seen = np.isfinite(xy[..., 0]), found[geometry.main, name]
    shown = inside & seen.direct.seen
    check_decoded(images, name, seen.map.valid | ~seen.direct.dim, shown & ~unpatterned)
    lit = seen.map.valid | unpatterned | well_inside(shown)
    maybe_lit = inside & ~seen.direct.absent
    share = float(shot_ids_share.covered.mean())
    return black, CameraSight(xy, panel, lit, maybe_lit, unpatterned, white, base, share)


def measure_server_light(
    dome: Dome,
    images: SessionImages,
    view: DomeView,
    geometry: GeometrySolution,
    server: tuple[DomeMaster, Mask],
    name: str,
) -> ProjectorMeasurement:
    """The light of media server `name`, split and fitted, as `measure_light` does a projector's.

    The stripes determine what it lights, in the master's circle; the mask is of the master.
    """
    master, unused = server
    black, base = _black(images, name)
    white = images.light(images.only(name, "white")) - base
    _check_saturation(white, view.on_screen, name)
    xy = view.projector_pixels(geometry.projectors[name], dome)
    pairs = ((pattern, inverse) for *_, pattern, inverse in images.stripe_pairs(name))
    lit = lit_by_stripes(white, pairs) & master.inside(xy)
    shot_ids_share = _shot_id_mask(images, geometry, name, CELLS_PER_MASTER)
    unpatterned = pixels_without_pattern(shot_ids_share, xy)
    panel = np.where(unpatterned[..., None], np.float32(np.nan), master.coarse_pixels(xy))
    lit |= unpatterned
    ids_share = float(shot_ids_share.covered.mean())
    sight = CameraSight(xy, panel, lit, lit, unpatterned, white, base, ids_share)
    found, levels = _measured(images, view, name, black, sight, master)
    samples = level_samples(levels, found.light.direct, found.colour.mix, xy, master.size)
    found = replace(found, exponent=fit_exponent(samples, found.response, master.size))
    return _without(found, unused.at(xy))


def _without(found: ProjectorMeasurement, masked: BoolArray) -> ProjectorMeasurement:
    """The measurement of a projector whose picture is not used at masked camera pixels (H, W)."""
    light = found.light
    direct = np.where(masked[..., None], np.float32(0), light.direct)
    return replace(found, light=replace(light, direct=direct, lit=light.lit & ~masked))


def _check_saturation(white: Image, on_screen: BoolArray, name: str) -> None:
    """Refuse a white whose brightest part is not known: its scattered light is, so m would be too large."""
    share = float(np.isnan(white[on_screen]).any(axis=-1).mean())
    if share > SATURATED:
        raise OutOfModelRange(
            f"white of projector {name}: {share:.1%} of the screen is saturated, more than "
            f"{SATURATED:.1%}; photograph with a shorter exposure_s"
        )


def _check_blur(blur: float, name: str) -> None:
    """Refuse stripes so blurred that their direct light would count as scattered light."""
    if blur > MAX_BLUR:
        raise OutOfModelRange(
            f"projector {name}: edges of its stripes are blurred by {blur:.1f} pixels (standard "
            f"deviation), more than {MAX_BLUR:g}; focus the projector and the camera"
        )


def _sharpening_notes(overshoot: float, name: str) -> list[str]:
    if overshoot <= OVERSHOOT:
        return []
    return [
        f"projector {name}: its stripes are {overshoot:.0%} brighter beside their edges than further inside; "
        "the camera or the projector sharpens its picture, so directions may be off by more than is stated. "
        "Switch that off, or photograph raw"
    ]


def _black(images: SessionImages, name: str) -> tuple[Image, Image]:
    """A projector's black (H, W, 3), and that with the room's light at the other shots' exposure."""
    dark, dark_long = images.dark(name)
    black = images.light(images.only(name, "black")) - dark_long
    return black, black + dark


def _measured(
    images: SessionImages,
    view: DomeView,
    name: str,
    black: Image,
    sight: CameraSight,
    master: DomeMaster | None = None,
) -> tuple[ProjectorMeasurement, list[Levels]]:
    """The light of white, split and fitted, and that of level pictures; `master` of a server."""
    coarse, solid_sr = master.coarse if master else 1, view.solid_angle_sr
    separation = Separation(sight.white, sight.panel, sight.lit, solid_sr, sight.maybe_lit)
    checks = StabilityChecks(sight.white, view.on_screen & ~sight.unpatterned, images.step(name))
    for axis, bit, pattern, inverse in images.stripe_pairs(name):
        pattern, inverse = pattern - sight.base, inverse - sight.base  # noqa: PLW2901
        separation.add_pair(axis, bit, pattern, inverse)
        if master is None:  # a server draws edges in greys, which do not add up to white
            checks.add(f"of stripes {axis} {bit}", [pattern, inverse], sight.shot_ids_share)
    light = separation.result()
    _check_blur(separation.blur, name)

    def direct_part(shot: Shot) -> Image:
        picture = images.light(shot) - sight.base
        share = separation.flux_share(picture).astype(np.float32)
        return picture - share * light.scattered

    primaries = [direct_part(shot) for shot in images.plan.of(name, "primary")]
    sound = light.lit & ~sight.unpatterned
    colour = fit_colour(primaries, np.where(sound[..., None], light.direct, 0))
    fit, steps = ProjectorResponseFit(light.direct, colour.mix), list[Levels]()
    for shot in images.plan.of(name, "levels"):
        picture = images.session.pattern(shot)[::coarse, ::coarse]
        steps.append((direct_part(shot), tile_levels(picture, sight.panel, light.lit)))
        fit.add(*steps[-1])
    if sight.unpatterned.any():
        on_screen = solid_sr > 0
        light = fill_light(light, sight.white, sight.unpatterned, solid_sr)
        black = fill_picture(black, sight.unpatterned & on_screen, on_screen)
    scatter_samples, zones = _scatter_samples(images, view, name, light, sight, separation.clear_px)
    checks.add("of parts of the panel", zones, 3 * sight.shot_ids_share)
    dim = images.dim() if master is None else None  # behind a server responses differ by place
    if dim and dim.projector == name:
        end = images.light(dim, len(dim.exposures_s) - 1) - sight.base
        checks.add_dimmed("at the end of the session", end)
    notes = [
        *black_notes(images, name),
        *checks.notes(name),
        *_sharpening_notes(separation.overshoot, name),
    ]
    found = ProjectorMeasurement(
        light, black, colour, fit.curve(), scatter_samples, notes=notes, moved_px=checks.shift_px
    )
    return found, steps


def _linearity(images: SessionImages, name: str, sight: CameraSight) -> Linearity:
    """How far the light of a stripe picture and its inverse is from that of white."""
    _, _, *pair = next(images.stripe_pairs(name))
    white, pattern, inverse = (
        np.where(sight.unpatterned, np.float32(np.nan), picture[..., GREEN])
        for picture in (sight.white, *(p - sight.base for p in pair))
    )
    return linearity_error(white, np.zeros_like(white), pattern, inverse)


def _check_linear(images: SessionImages, name: str, found: Linearity, limit: float) -> None:
    """Refuse photographs whose light does not add up: a tone curve missing from venue.toml."""
    if abs(found.exponent - 1) > max(limit, CERTAIN * found.exponent_sigma):
        camera = images.radiometer.camera.name
        raise OutOfModelRange(
            f"camera {camera}: photographs of projector {name} are not linear: their counts go "
            f"with the power {1 / found.exponent:.2f} of the light; photograph raw, or state the "
            'camera\'s response in venue.toml ("srgb", a table of `procam response`, "solve")'
        )


def _scatter_samples(
    images: SessionImages,
    view: DomeView,
    name: str,
    light: SeparatedLight,
    sight: CameraSight,
    clear_px: int,
) -> tuple[list[ScatterSample], list[Image]]:
    """Scattered light of a projector's white and of parts of it, where nothing else is seen.

    Also the sum of the parts, if there are any, which should be white.
    """
    total = np.zeros_like(sight.white)
    cells = ScatterCells(view.direction, view.solid_angle_sr)
    found = [cells.scatter_sample(light.scattered, view.on_screen, light.direct)]
    for shot in images.plan.of(name, "zone"):
        shown = sample(images.session.pattern(shot)[..., 0], sight.xy)
        met = (light.lit | sight.maybe_lit) & ((shown > 0) | sight.unpatterned)
        dark = view.on_screen & ~grow(met, clear_px)
        picture = images.light(shot) - sight.base
        found.append(cells.scatter_sample(picture, dark, light.direct * shown[..., None]))
        total += picture
    return found, [total][: len(found) - 1]


def _shot_id_mask(images: SessionImages, geometry: GeometrySolution, name: str, cells: int) -> Mask:
    """Where a projector's pictures carried their numbers."""
    width, height = geometry.projectors[name].size
    if "number" not in images.only(name, "white").detail:
        return Mask(name, np.zeros((height, width), bool))
    return Mask(name, shot_id_pixels((width, height), cells))
