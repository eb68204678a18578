"""The veil near its light in a camera's lens, measured on the stripes of a session."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from procam.estimate.camera.veil import NearVeilFit
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.projector_images import CameraSight
from procam.estimate.light.separation import Separation
from procam.model.optics import ProjectorModel, Sensor
from procam.model.screen import Screen
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.decode import Decoded
from procam.workflows.solve.side_by_side import side_by_side
from procam.workflows.solve.sight import GREEN, camera_sight, sight_bytes

MIN_PERIODS = 2  # of stripes over a panel: on fewer, light that a floor returns looks like a veil
GLARE_SIGMAS = 2.0  # by which the veil may exceed the stated one


def with_near_veil(
    screen: Screen,
    images: SessionImages,
    view: ScreenView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
) -> GeometrySolution:
    """The solved rig, whose main camera has the part of its veil that stays near its light."""

    def measured(name: str) -> NearVeilFit:
        sight = camera_sight(screen, images, view, geometry, found, name)
        return _fitted(images, geometry.projectors[name], sight)

    fit = NearVeilFit(images.radiometer.seen)
    for _, one in side_by_side(measured, geometry.projectors, sight_bytes(geometry.camera)):
        fit.extend(one)
    camera = geometry.camera
    sensor = _with_veil(camera.sensor, fit.result())
    cameras = {**geometry.rig.cameras, camera.name: replace(camera, sensor=sensor)}
    return replace(geometry, rig=replace(geometry.rig, cameras=cameras))


def _fitted(images: SessionImages, projector: ProjectorModel, sight: CameraSight) -> NearVeilFit:
    """The veil of one projector's stripes, a group for each axis."""
    fit = NearVeilFit(images.radiometer.seen)
    separation = Separation(sight.white, sight.panel, sight.lit, sight.flux, sight.maybe_lit)
    axis_before = ""
    for axis, bit, *pair in images.stripe_pairs(projector.name):
        if axis_before not in ("", axis):
            fit.end_group()
        axis_before = axis
        pictures = [np.subtract(picture, sight.base, out=picture) for picture in pair]
        where = separation.add_pair(axis, bit, *pictures)
        if projector.size[axis == "y"] >= MIN_PERIODS * 2 ** (bit + 1):
            for picture, dark in zip(pictures, where, strict=True):
                fit.add(picture[..., GREEN], dark, sight.flux.share(picture)[..., GREEN])
        del pair, pictures  # before the next are read
    fit.end_group()
    return fit


def _with_veil(sensor: Sensor, parts: list[tuple[float, float]]) -> Sensor:
    """The sensor with its near veil, of which there is no more than glare was stated."""
    most = sensor.glare + GLARE_SIGMAS * sensor.glare_sigma
    scale = min(1.0, most / max(sum(share for share, _ in parts), 1e-9))
    near = tuple((scale * share, spread) for share, spread in parts if scale)
    return replace(sensor, near_glare=near)
