"""One projector's light, measured on the pictures of a session."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.inpaint import pixels_without_pattern
from procam.estimate.light.measure import measure_light, measure_master_light
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.picture_flux import picture_flux
from procam.estimate.light.projector_images import (
    CameraSight,
    Picture,
    ProjectorImages,
    StripePair,
)
from procam.estimate.media_server.dome_master import DomeMaster, lit_by_stripes
from procam.estimate.media_server.local_response import fit_exponent, level_samples
from procam.maths.codes.shot_id import CELLS_PER_MASTER
from procam.model.mask import Mask
from procam.model.plan import Shot
from procam.model.screen import Screen
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.decode import Decoded
from procam.workflows.solve.long_exposure import black_notes
from procam.workflows.solve.sight import (
    black_light,
    camera_sight,
    check_saturation,
    shot_id_mask,
)


def light_of(
    screen: Screen,
    images: SessionImages,
    view: ScreenView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
    masks: Mapping[str, Mask],
    name: str,
) -> ProjectorMeasurement:
    """The light of projector `name` in a session."""
    sight, noted = (
        camera_sight(screen, images, view, geometry, found, name),
        black_notes(images, name),
    )
    measured = measure_light(projector_images(images, name), sight, view, masks[name])
    return replace(measured, notes=[*noted, *measured.notes])


def server_light_of(
    screen: Screen,
    images: SessionImages,
    view: ScreenView,
    geometry: GeometrySolution,
    server: tuple[DomeMaster, Mask],
    name: str,
) -> ProjectorMeasurement:
    """The light of media server `name` in a session; the mask is of its master."""
    (master, unused), noted = server, black_notes(images, name)
    sight = _server_sight(screen, images, view, geometry, master, name)
    pictures = projector_images(images, name)
    found, levels = measure_master_light(pictures, sight, view, unused, master.coarse)
    samples = level_samples(levels, found.light.direct, found.colour.mix, sight.xy, master.size)
    exponent = fit_exponent(samples, found.response, master.size)
    return replace(found, exponent=exponent, notes=[*noted, *found.notes])


def projector_images(images: SessionImages, name: str) -> ProjectorImages:
    """The pictures of projector `name`, each read from the session when its light is asked for."""
    plan, dim = images.plan, images.dim()

    def picture(shot: Shot, exposure: int = 0) -> Picture:
        drive, light = (
            partial(images.session.pattern, shot),
            partial(images.light, shot, exposure),
        )
        return Picture(shot.id, shot.purpose, drive, light)

    stripes = [
        StripePair(axis, bit, picture(pattern), picture(inverse))
        for axis, bit, pattern, inverse in images.stripes(name)
    ]
    of = {
        what: [picture(shot) for shot in plan.of(name, what)]
        for what in ("code", "primary", "levels", "zone")
    }
    return ProjectorImages(
        name,
        images.radiometer.camera.name,
        partial(black_light, images, name),
        picture(images.only(name, "white")),
        of["code"],
        stripes,
        of["primary"],
        of["levels"],
        of["zone"],
        picture(dim, len(dim.exposures_s) - 1) if dim and dim.projector == name else None,
        images.step(name),
    )


def _server_sight(
    screen: Screen,
    images: SessionImages,
    view: ScreenView,
    geometry: GeometrySolution,
    master: DomeMaster,
    name: str,
) -> CameraSight:
    """A media server as the camera sees it: its stripes determine what it lights, in the master's circle."""
    base = black_light(images, name) + images.dark(name)[0]
    white = images.light(images.only(name, "white")) - base
    check_saturation(white, view.on_screen, name)
    xy = view.projector_pixels(geometry.projectors[name], screen)
    pairs = ((pattern, inverse) for *_, pattern, inverse in images.stripe_pairs(name))
    lit = lit_by_stripes(white, pairs) & master.inside(xy)
    shot_ids_share = shot_id_mask(images, geometry, name, CELLS_PER_MASTER)
    unpatterned = pixels_without_pattern(shot_ids_share, xy)
    panel = np.where(unpatterned[..., None], np.float32(np.nan), master.coarse_pixels(xy))
    lit |= unpatterned
    ids_share = float(shot_ids_share.covered.mean())
    nowhere, flux = np.zeros_like(lit), picture_flux(screen, view, white)
    return CameraSight(xy, panel, lit, lit, unpatterned, nowhere, white, base, flux, ids_share)
