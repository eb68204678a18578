"""The veil near its light in a camera's lens, measured on the stripes of a session."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import groupby

from procam.estimate.camera.near_veil import NearVeilFit
from procam.estimate.geometry.camera_view import DomeView
from procam.estimate.geometry.model import Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.separation import Separation
from procam.model.optics import Sensor
from procam.model.screen import Dome
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.direct_light import Decoded
from procam.workflows.solve.light import GREEN, camera_sight

MIN_PERIODS = 2  # of stripes over a panel: on fewer, light that a floor returns looks like a veil
GLARE_SIGMAS = 2.0  # by which the veil may exceed the stated one


def with_near_veil(
    dome: Dome,
    images: SessionImages,
    view: DomeView,
    geometry: GeometrySolution,
    found: Mapping[Pair, Decoded],
) -> GeometrySolution:
    """The solved rig, whose main camera has the part of its veil that stays near its light."""
    fit = NearVeilFit(images.radiometer.seen)
    for name, projector in geometry.projectors.items():
        _, sight = camera_sight(dome, images, view, geometry, found, name)
        separation = Separation(
            sight.white, sight.panel, sight.lit, view.solid_angle_sr, sight.maybe_lit
        )
        for axis, pairs in groupby(images.stripe_pairs(name), key=lambda pair: pair[0]):
            for _, bit, *pair in pairs:
                pictures = [picture - sight.base for picture in pair]
                where = separation.add_pair(axis, bit, *pictures)
                if projector.size[axis == "y"] < MIN_PERIODS * 2 ** (bit + 1):
                    continue
                for picture, dark in zip(pictures, where, strict=True):
                    share = float(separation.flux_share(picture)[GREEN])
                    fit.add(picture[..., GREEN], dark, share)
            fit.end_group()
    camera = geometry.camera
    sensor = _with_veil(camera.sensor, fit.result())
    cameras = {**geometry.rig.cameras, camera.name: replace(camera, sensor=sensor)}
    return replace(geometry, rig=replace(geometry.rig, cameras=cameras))


def _with_veil(sensor: Sensor, parts: list[tuple[float, float]]) -> Sensor:
    """The sensor with its near veil, of which there is no more than glare was stated."""
    most = sensor.glare + GLARE_SIGMAS * sensor.glare_sigma
    scale = min(1.0, most / max(sum(share for share, _ in parts), 1e-9))
    near = tuple((scale * share, spread) for share, spread in parts if scale)
    return replace(sensor, near_glare=near)
