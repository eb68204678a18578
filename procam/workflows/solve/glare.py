"""A camera's stated veiling glare, checked by the white pictures of a session."""

from dataclasses import replace

from procam.estimate.camera.veil import bounded_glare, darkest_share, glare_notes
from procam.estimate.geometry.solve import GeometrySolution
from procam.model.provenance import Note
from procam.workflows.capture.session_images import SessionImages

GREEN = 1


def with_bounded_glare(
    images: SessionImages, geometry: GeometrySolution
) -> tuple[GeometrySolution, list[Note]]:
    """The solved rig, whose main camera has no better known glare than its pictures allow; and notes."""
    camera, seen = geometry.camera, images.radiometer.seen
    darkest = 1.0
    for name in geometry.projectors:
        dark, dark_long = images.dark(name)
        white, black = (images.light(images.only(name, what)) for what in ("white", "black"))
        light = white - dark - (black - dark_long)
        darkest = min(darkest, darkest_share(light[..., GREEN], seen))
    sensor = bounded_glare(camera.sensor, darkest)
    notes = glare_notes(camera.name, camera.sensor, sensor, darkest)
    cameras = {**geometry.rig.cameras, camera.name: replace(camera, sensor=sensor)}
    return replace(geometry, rig=replace(geometry.rig, cameras=cameras)), notes
