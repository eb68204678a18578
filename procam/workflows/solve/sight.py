"""A projector's picture as the main camera sees it."""

from collections.abc import Mapping

import numpy as np

from procam.arrays import BoolArray, Image
from procam.errors import OutOfModelRange
from procam.estimate.camera.binning import Binning
from procam.estimate.geometry.camera_view import ScreenView, lens_glints
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.direct_light import well_inside
from procam.estimate.light.inpaint import fill_picture, pixels_without_pattern
from procam.estimate.light.picture_flux import picture_flux
from procam.estimate.light.projector_images import CameraSight
from procam.maths.codes.shot_id import CELLS_PER_PANEL, shot_id_pixels
from procam.model.mask import Mask
from procam.model.optics import CameraModel
from procam.model.screen import Screen
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.decode import Decoded
from procam.workflows.solve.direct_light import check_decoded

GREEN = 1
BYTES_PER_PIXEL, BYTES_OF_PHOTOGRAPH = 270, 14  # of the light, and of a photograph while it is read
SATURATED = 0.005  # of the screen: white paper on it, glints


def sight_bytes(camera: CameraModel) -> float:
    """Memory that measuring a projector's light takes with a camera [byte]."""
    pixels, photographed = (float(np.prod(size)) for size in (Binning.of(camera).size, camera.size))
    return BYTES_PER_PIXEL * pixels + BYTES_OF_PHOTOGRAPH * photographed


def camera_sight(
    screen: Screen,
    images: SessionImages,
    view: ScreenView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
    name: str,
) -> CameraSight:
    """A projector as the main camera sees it."""
    base = black_light(images, name) + images.dark(name)[0]
    glints = view.on_screen & lens_glints(geometry.rig, view.camera, images.radiometer.rays)
    white = images.light(images.only(name, "white")) - base
    check_saturation(white, view.on_screen & ~glints, name)
    white = fill_picture(white, glints, view.on_screen)
    xy = view.projector_pixels(geometry.projectors[name], screen)
    shot_ids_share = shot_id_mask(images, geometry, name, CELLS_PER_PANEL)
    unpatterned = glints | pixels_without_pattern(shot_ids_share, xy)
    panel = np.where(unpatterned[..., None], np.float32(np.nan), xy)
    inside, seen = np.isfinite(xy[..., 0]), found[geometry.main, name]
    shown = inside & seen.direct.seen
    check_decoded(images, name, seen.valid | ~seen.direct.dim, shown & ~unpatterned)
    lit = seen.valid | unpatterned | well_inside(shown)
    maybe_lit = inside & ~seen.direct.absent
    share = float(shot_ids_share.covered.mean())
    unknown = maybe_lit & ~seen.direct.seen & ~unpatterned
    flux = picture_flux(screen, view, white)
    return CameraSight(xy, panel, lit, maybe_lit, unpatterned, unknown, white, base, flux, share)


def check_saturation(white: Image, on_screen: BoolArray, name: str) -> None:
    """Refuse a white whose brightest part is not known: its scattered light is, so m would be too large."""
    share = float(np.isnan(white[on_screen]).any(axis=-1).mean())
    if share > SATURATED:
        raise OutOfModelRange(
            f"white of projector {name}: {share:.1%} of the screen is saturated, more than "
            f"{SATURATED:.1%}; photograph with a shorter exposure_s"
        )


def black_light(images: SessionImages, name: str) -> Image:
    """A projector's black (H, W, 3), without the light of the room."""
    black = images.light(images.only(name, "black"))
    black -= images.dark(name)[1]
    return black


def shot_id_mask(images: SessionImages, geometry: GeometrySolution, name: str, cells: int) -> Mask:
    """Where a projector's pictures carried their numbers."""
    width, height = geometry.projectors[name].size
    if "number" not in images.only(name, "white").detail:
        return Mask(name, np.zeros((height, width), bool))
    return Mask(name, shot_id_pixels((width, height), cells))
