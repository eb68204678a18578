"""Measures one projector's light: direct and scattered light of white, colour, response, black."""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import BoolArray, Image, IndexArray
from procam.errors import OutOfModelRange
from procam.estimate.camera.linearity import Linearity, linearity_error
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.code_light import wave_notes
from procam.estimate.light.inpaint import fill_light, fill_picture
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.mirrored import check_not_mirrored
from procam.estimate.light.projector_images import CameraSight, Picture, ProjectorImages
from procam.estimate.light.projector_response import ProjectorResponseFit, fit_colour, tile_levels
from procam.estimate.light.scatter_kernel import ScatterCells, ScatterSample
from procam.estimate.light.separation import (
    MAX_BLUR,
    OVERSHOOT,
    SeparatedLight,
    Separation,
)
from procam.estimate.light.spots import hidden_notes
from procam.estimate.light.stability import StabilityChecks
from procam.maths.warp import grow, sample
from procam.model.mask import Mask
from procam.model.provenance import Note

GREEN = 1
# departures from exponent 1: a tone curve, refused first; then what is refused if light held still
# (drift of a percent between photographs makes 0.02)
TONE_CURVE, NOT_LINEAR = 0.3, 0.05
CERTAIN = 5.0  # sigmas
# direct light of a picture of levels, and the level that each camera pixel sees
Step = tuple[Image, IndexArray]


def measure_light(
    images: ProjectorImages, sight: CameraSight, view: ScreenView, mask: Mask
) -> ProjectorMeasurement:
    """A projector's light, split and fitted; black is measured at its own long exposure.

    Where pictures carried their numbers they showed no pattern, and where the camera looks into a
    lens it sees no screen: these places are left out of every fit, and filled from around them at
    the end. What is masked on the panel shines here too, and counts until then.
    """
    check_not_mirrored(images, sight)
    linearity = _linearity(images, sight)
    _check_linear(images, linearity, TONE_CURVE)
    found, _ = _measured(images, sight, view, 0)
    _check_linear(images, linearity, NOT_LINEAR)  # if light held still, it is no drift
    hidden = hidden_notes(images.name, sight.white, sight.unknown, view)
    found = replace(found, notes=[*found.notes, *wave_notes(images, sight, found), *hidden])
    return _without(found, mask.at(sight.xy))


def measure_master_light(
    images: ProjectorImages, sight: CameraSight, view: ScreenView, mask: Mask, coarse: int
) -> tuple[ProjectorMeasurement, list[Step]]:
    """The same for a media server, whose pictures are drawn on squares of `coarse` px of its master.

    Also the light of its pictures of levels, because responses differ by place.
    """
    found, levels = _measured(images, sight, view, coarse)
    return _without(found, mask.at(sight.xy)), levels


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


def _sharpening_notes(overshoot: float, name: str) -> list[Note]:
    if overshoot <= OVERSHOOT:
        return []
    text = (
        f"its stripes are {overshoot:.0%} brighter beside their edges than further inside; the camera or the "
        "projector sharpens its picture, so directions may be off by more than is stated. Switch that off, "
        "or photograph raw"
    )
    return [Note("sharpening", f"projector {name}", text, overshoot / OVERSHOOT)]


@dataclass(frozen=True, slots=True)
class _Separated:
    """Light of white by its stripes; the flux of pictures, and what of the stripes is needed later."""

    light: SeparatedLight
    clear_px: int
    overshoot: float


def _separated(
    images: ProjectorImages, sight: CameraSight, checks: StabilityChecks | None
) -> _Separated:
    """Split a projector's white by its stripes; `checks` take these too, unless a server draws them.

    A server draws edges in greys, so that its stripes do not add up to white.
    """
    separation = Separation(sight.white, sight.panel, sight.lit, sight.flux, sight.maybe_lit)
    for pair in images.stripes:
        pattern, inverse = pair.lights(sight.base)
        separation.add_pair(pair.axis, pair.bit, pattern, inverse)
        if checks:
            stripes = f"of stripes {pair.axis} {pair.bit}"
            checks.add(stripes, [pattern, inverse], sight.shot_ids_share)
        del pattern, inverse  # before the next are read
    _check_blur(separation.blur, images.name)
    clear_px = separation.clear_px
    return _Separated(separation.result(), clear_px, separation.overshoot)


def _measured(
    images: ProjectorImages, sight: CameraSight, view: ScreenView, coarse: int
) -> tuple[ProjectorMeasurement, list[Step]]:
    """The light of white, split and fitted; of a server (`coarse` > 0) that of pictures of levels too."""
    solid_sr, levels = view.weight, list[Step]()
    checks = StabilityChecks(sight.white, view.on_screen & ~sight.unpatterned, images.step)
    separated = _separated(images, sight, None if coarse else checks)
    light, flux = separated.light, sight.flux

    def direct_part(picture: Picture) -> Image:
        shown = picture.light()
        shown -= sight.base
        shown -= flux.share(shown).astype(np.float32) * light.scattered
        return shown

    sound = light.lit & ~sight.unpatterned
    primaries = (direct_part(picture) for picture in images.primaries)
    colour = fit_colour(primaries, np.where(sound[..., None], light.direct, 0))
    fit, every = ProjectorResponseFit(light.direct, colour.mix), max(coarse, 1)
    for picture in images.levels:
        drive = picture.drive()[::every, ::every]
        step = direct_part(picture), tile_levels(drive, sight.panel, light.lit)
        fit.add(*step)
        levels += [step] if coarse else []
    if sight.unpatterned.any():
        light = fill_light(light, sight.white, sight.unpatterned, solid_sr)
    samples, zones = _scatter_samples(images, view, light, sight, separated.clear_px)
    checks.add("of parts of the panel", zones, 3 * sight.shot_ids_share)
    if images.dim and not coarse:  # behind a server responses differ by place
        end = images.dim.light() - sight.base
        checks.add_dimmed("at the end of the session", end)
    on_screen = solid_sr > 0
    black = fill_picture(images.read_black(), sight.unpatterned & on_screen, on_screen)
    notes = [*checks.notes(images.name), *_sharpening_notes(separated.overshoot, images.name)]
    found = ProjectorMeasurement(
        light, black, colour, fit.curve(), samples, notes=notes, moved_px=checks.shift_px
    )
    return found, levels


def _linearity(images: ProjectorImages, sight: CameraSight) -> Linearity:
    """How far the light of a stripe picture and its inverse is from that of white."""
    white, pattern, inverse = (
        np.where(sight.unpatterned, np.float32(np.nan), picture[..., GREEN])
        for picture in (sight.white, *images.stripes[0].lights(sight.base))
    )
    return linearity_error(white, np.zeros_like(white), pattern, inverse)


def _check_linear(images: ProjectorImages, found: Linearity, limit: float) -> None:
    """Refuse photographs whose light does not add up: a tone curve missing from venue.toml."""
    if abs(found.exponent - 1) > max(limit, CERTAIN * found.exponent_sigma):
        raise OutOfModelRange(
            f"camera {images.camera}: photographs of projector {images.name} are not linear: their counts go "
            f"with the power {1 / found.exponent:.2f} of the light; photograph raw, or state the "
            'camera\'s response in venue.toml ("srgb", a table of `procam lens response`, "solve")'
        )


def _scatter_samples(
    images: ProjectorImages,
    view: ScreenView,
    light: SeparatedLight,
    sight: CameraSight,
    clear_px: int,
) -> tuple[list[ScatterSample], list[Image]]:
    """Scattered light of a projector's white and of parts of it, where nothing else is seen.

    Also the sum of the parts, if there are any, which should be white.
    """
    total = np.zeros_like(sight.white)
    cells = ScatterCells(view.direction, view.weight)
    found = [cells.scatter_sample(light.scattered, view.on_screen, light.direct)]
    for zone in images.zones:
        shown = sample(zone.drive()[..., 0], sight.xy)
        met = (light.lit | sight.maybe_lit) & ((shown > 0) | sight.unpatterned)
        dark = view.on_screen & ~grow(met, clear_px)
        picture = zone.light()
        picture -= sight.base
        found.append(cells.scatter_sample(picture, dark, light.direct * shown[..., None]))
        total += picture
    return found, [total][: len(found) - 1]
