"""One projector's light, measured on the pictures of a session."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.errors import OutOfModelRange
from procam.estimate.calibration import ProjectorMeasurement
from procam.estimate.camera.linearity import Linearity, linearity_error
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.inpaint import fill_light, fill_picture, pixels_without_pattern
from procam.estimate.light.projector_response import ProjectorResponseFit, fit_colour, tile_levels
from procam.estimate.light.scatter_kernel import ScatterCells, ScatterSample
from procam.estimate.light.separation import (
    MAX_BLUR,
    OVERSHOOT,
    PictureFlux,
    SeparatedLight,
    Separation,
)
from procam.estimate.light.spots import hidden_notes
from procam.estimate.light.stability import StabilityChecks
from procam.estimate.media_server.dome_master import DomeMaster, lit_by_stripes
from procam.estimate.media_server.local_response import Levels, fit_exponent, level_samples
from procam.maths.codes.shot_id import CELLS_PER_MASTER
from procam.maths.warp import grow, sample
from procam.model.mask import Mask
from procam.model.plan import Shot
from procam.model.screen import Dome
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.code_light import wave_notes
from procam.workflows.solve.decode import Decoded
from procam.workflows.solve.long_exposure import black_notes
from procam.workflows.solve.mirrored import check_not_mirrored
from procam.workflows.solve.sight import (
    GREEN,
    CameraSight,
    black_light,
    camera_sight,
    check_saturation,
    shot_id_mask,
)

# departures from exponent 1: a tone curve, refused first; then what is refused if light held still
# (drift of a percent between photographs makes 0.02)
TONE_CURVE, NOT_LINEAR = 0.3, 0.05
CERTAIN = 5.0  # sigmas


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
    sight = camera_sight(dome, images, view, geometry, found, name)
    check_not_mirrored(images, name, sight.panel, sight.lit, sight.white, sight.base)
    linearity = _linearity(images, name, sight)
    _check_linear(images, name, linearity, TONE_CURVE)
    measurement, _ = _measured(images, view, name, sight)
    _check_linear(images, name, linearity, NOT_LINEAR)  # if light held still, it is no drift
    sound = measurement.light.lit & ~sight.unpatterned
    waves = wave_notes(images, name, sight.xy, sound, sight.base, measurement)
    hidden = hidden_notes(name, sight.white, sight.unknown, view)
    measurement = replace(measurement, notes=[*measurement.notes, *waves, *hidden])
    return _without(measurement, masks[name].at(sight.xy))


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
    base = black_light(images, name) + images.dark(name)[0]
    white = images.light(images.only(name, "white")) - base
    check_saturation(white, view.on_screen, name)
    xy = view.projector_pixels(geometry.projectors[name], dome)
    pairs = ((pattern, inverse) for *_, pattern, inverse in images.stripe_pairs(name))
    lit = lit_by_stripes(white, pairs) & master.inside(xy)
    shot_ids_share = shot_id_mask(images, geometry, name, CELLS_PER_MASTER)
    unpatterned = pixels_without_pattern(shot_ids_share, xy)
    panel = np.where(unpatterned[..., None], np.float32(np.nan), master.coarse_pixels(xy))
    lit |= unpatterned
    ids_share = float(shot_ids_share.covered.mean())
    nowhere = np.zeros_like(lit)
    sight = CameraSight(xy, panel, lit, lit, unpatterned, nowhere, white, base, ids_share)
    found, levels = _measured(images, view, name, sight, master)
    samples = level_samples(levels, found.light.direct, found.colour.mix, xy, master.size)
    found = replace(found, exponent=fit_exponent(samples, found.response, master.size))
    return _without(found, unused.at(xy))


def _without(found: ProjectorMeasurement, masked: BoolArray) -> ProjectorMeasurement:
    """The measurement of a projector whose picture is not used at masked camera pixels (H, W)."""
    light = found.light
    direct = np.where(masked[..., None], np.float32(0), light.direct)
    return replace(found, light=replace(light, direct=direct, lit=light.lit & ~masked))


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


@dataclass(frozen=True, slots=True)
class _Separated:
    """Light of white by its stripes; the flux of pictures, and what of the stripes is needed later."""

    light: SeparatedLight
    flux: PictureFlux
    clear_px: int
    overshoot: float


def _separated(
    images: SessionImages,
    solid_sr: Array,
    name: str,
    sight: CameraSight,
    checks: StabilityChecks | None,
) -> _Separated:
    """Split a projector's white by its stripes; `checks` take these too, unless a server draws them.

    A server draws edges in greys, so that its stripes do not add up to white.
    """
    separation = Separation(sight.white, sight.panel, sight.lit, solid_sr, sight.maybe_lit)
    for axis, bit, pattern, inverse in images.stripe_pairs(name):
        pattern -= sight.base  # noqa: PLW2901
        inverse -= sight.base  # noqa: PLW2901
        separation.add_pair(axis, bit, pattern, inverse)
        if checks:
            checks.add(f"of stripes {axis} {bit}", [pattern, inverse], sight.shot_ids_share)
        del pattern, inverse  # before the next are read
    _check_blur(separation.blur, name)
    clear_px = separation.clear_px
    return _Separated(separation.result(), separation.flux, clear_px, separation.overshoot)


def _measured(
    images: SessionImages,
    view: DomeView,
    name: str,
    sight: CameraSight,
    master: DomeMaster | None = None,
) -> tuple[ProjectorMeasurement, list[Levels]]:
    """The light of white, split and fitted; of a server, which plays `master`, that of level pictures too."""
    coarse, solid_sr = master.coarse if master else 1, view.solid_angle_sr
    noted = black_notes(images, name)
    checks = StabilityChecks(sight.white, view.on_screen & ~sight.unpatterned, images.step(name))
    separated = _separated(images, solid_sr, name, sight, None if master else checks)
    light, flux = separated.light, separated.flux

    def direct_part(shot: Shot) -> Image:
        picture = images.light(shot)
        picture -= sight.base
        picture -= flux.share(picture).astype(np.float32) * light.scattered
        return picture

    primaries = (direct_part(shot) for shot in images.plan.of(name, "primary"))
    sound = light.lit & ~sight.unpatterned
    colour = fit_colour(primaries, np.where(sound[..., None], light.direct, 0))
    fit, steps = ProjectorResponseFit(light.direct, colour.mix), list[Levels]()
    for shot in images.plan.of(name, "levels"):
        picture = images.session.pattern(shot)[::coarse, ::coarse]
        step = direct_part(shot), tile_levels(picture, sight.panel, light.lit)
        fit.add(*step)
        if master:
            steps.append(step)
    if sight.unpatterned.any():
        light = fill_light(light, sight.white, sight.unpatterned, solid_sr)
    scatter_samples, zones = _scatter_samples(images, view, name, light, sight, separated.clear_px)
    checks.add("of parts of the panel", zones, 3 * sight.shot_ids_share)
    dim = images.dim() if master is None else None  # behind a server responses differ by place
    if dim and dim.projector == name:
        end = images.light(dim, len(dim.exposures_s) - 1) - sight.base
        checks.add_dimmed("at the end of the session", end)
    on_screen = solid_sr > 0
    black = fill_picture(black_light(images, name), sight.unpatterned & on_screen, on_screen)
    notes = [*noted, *checks.notes(name), *_sharpening_notes(separated.overshoot, name)]
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
            'camera\'s response in venue.toml ("srgb", a table of `procam lens response`, "solve")'
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
        picture = images.light(shot)
        picture -= sight.base
        found.append(cells.scatter_sample(picture, dark, light.direct * shown[..., None]))
        total += picture
    return found, [total][: len(found) - 1]
