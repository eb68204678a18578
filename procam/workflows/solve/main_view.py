"""The main camera of a solved rig: its images, its view of the screen, and how light is measured with it."""

from collections.abc import Callable, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.files.venue.load import Venue
from procam.files.venue.masks import projector_masks
from procam.memory import return_buffers
from procam.model.provenance import Note
from procam.model.screen import Screen
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.main_camera import light_radiometer, screen_view
from procam.workflows.solve.glare import with_bounded_glare
from procam.workflows.solve.light import light_of, server_light_of
from procam.workflows.solve.long_exposure import with_long_exposure
from procam.workflows.solve.near_veil import with_near_veil
from procam.workflows.solve.plausible import check_on_screen
from procam.workflows.solve.rig import SolvedRig
from procam.workflows.solve.side_by_side import side_by_side
from procam.workflows.solve.sight import sight_bytes


@dataclass(frozen=True, slots=True)
class MainView:
    """The solved screen and rig, with the images and the view of the camera that light is measured with.

    `measure` is for the light of the projector of a name; `notes` are on exposures, glare and the rim.
    """

    screen: Screen
    geometry: GeometrySolution
    images: SessionImages
    view: ScreenView
    measure: Callable[[str], ProjectorMeasurement]
    notes: list[Note]

    def measure_into(
        self, measured: MutableMapping[str, ProjectorMeasurement], names: Sequence[str]
    ) -> Iterator[str]:
        """Measure the light of projectors; each name when it is done."""
        found = side_by_side(self.measure, names, sight_bytes(self.geometry.camera))
        for name, measured[name] in found:
            yield name
        return_buffers()  # of the light; what is assembled needs as much again


def main_view(venue: Venue, rig: SolvedRig) -> MainView:
    """What light is measured with: the main camera through its solved lens, its glare bounded."""
    images, exposure_notes = with_long_exposure(_of_main(venue, rig))
    geometry, glare_notes = with_bounded_glare(images, rig.geometry)
    images, screen = _with_glare(images, geometry), venue.screen.solved(geometry.rig.shape)
    view, masks = screen_view(venue, screen, images.radiometer), projector_masks(venue)
    notes = [*exposure_notes, *glare_notes, *check_on_screen(view, rig.found)]
    if rig.server:
        given = (rig.server, masks[rig.server.name])
        work = partial(server_light_of, screen, images, view, geometry, given)
        return MainView(screen, geometry, images, view, work, notes)
    geometry = with_near_veil(screen, images, view, geometry, rig.found)
    images = _with_glare(images, geometry)
    view = replace(view, camera=images.radiometer.camera)
    own = partial(light_of, screen, images, view, geometry, rig.found, masks)
    return MainView(screen, geometry, images, view, own, notes)


def _of_main(venue: Venue, rig: SolvedRig) -> SessionImages:
    """The session's images of the main camera, the one that sees most, through its solved lens.

    venue.toml's lens is where the solve started: directions, solid angles and vignetting read with
    it would be wrong by as much as it is.
    """
    images, camera = rig.images, rig.geometry.camera
    stated = venue.cameras[camera.name]  # as its pixels were joined when it was decoded
    return replace(images, radiometer=light_radiometer(camera, stated))


def _with_glare(images: SessionImages, geometry: GeometrySolution) -> SessionImages:
    """The images of the main camera, whose glare is known better now."""
    return replace(images, radiometer=images.radiometer.with_glare(geometry.camera.sensor))
