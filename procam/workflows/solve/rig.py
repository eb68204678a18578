"""The rig of a session: cameras and projectors from what cameras decode, or from a server's tags."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from procam.estimate.camera.radiance import Radiometer
from procam.estimate.geometry.apriltags import TagObservations
from procam.estimate.geometry.model import Observations, Pair
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.media_server.camera_pose import PlacedCamera
from procam.estimate.media_server.dome_master import DomeMaster
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.model.provenance import Note
from procam.model.quality import Figure
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.capture.session_plan import plan_of, server_of
from procam.workflows.events import Event, Steps
from procam.workflows.solve.apriltags import detect_tags, tag_marks, tag_notes
from procam.workflows.solve.decode import Decoded, decode_bytes, decode_projector
from procam.workflows.solve.geometry import rig_problem, solve_rig
from procam.workflows.solve.media_server import (
    placed_by_server,
    server_figures,
    server_notes,
    server_rig,
)
from procam.workflows.solve.side_by_side import side_by_side

SHAPE_FIGURES = ("sphere_variance_ratio", "shape_degree")


@dataclass(frozen=True, slots=True)
class SolvedRig:
    """A solved rig, and what else of a session its light is read with.

    `found` is what cameras saw of projectors that were decoded; `images` those of the camera that
    was read last; `notes` and `figures` those of the solve; `server` a media server, if there is one.
    """

    geometry: GeometrySolution
    images: SessionImages
    verdict: str
    notes: list[Note]
    found: Mapping[Pair, Decoded] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    server: DomeMaster | None = None

    def figures_with(self, figures: Mapping[str, Figure]) -> dict[str, Figure]:
        """Figures of a calibration and of the rig; tags cannot separate a dome's shape from a server's."""
        undetermined = SHAPE_FIGURES if self.geometry.given else ()
        return {n: f for n, f in figures.items() if n not in undetermined} | dict(self.figures)


def solve_session_rig(venue: Venue, session: Session, total: int) -> Steps[SolvedRig]:
    """The rig of a session; `total` steps are those of the solve."""
    server = server_of(venue)
    if server:
        return (yield from _rig_by_server(venue, session, server, total))
    return (yield from _rig_by_codes(venue, session, total))


def _rig_by_codes(venue: Venue, session: Session, total: int) -> Steps[SolvedRig]:
    """Cameras and projectors, from what cameras decode."""
    plan, cameras = plan_of(venue, session), venue.cameras
    found: dict[Pair, Decoded] = {}
    gathered: dict[Pair, Observations] = {}
    tags_seen: dict[str, TagObservations] = {}
    odd = list[Note]()
    for camera in cameras:
        images = SessionImages(session, plan, Radiometer(cameras[camera]))
        tags_seen[camera] = detect_tags(venue, images)
        work = partial(decode_projector, venue, images)
        for name, (seen, patches, lines) in side_by_side(
            work, venue.table.projectors, decode_bytes(cameras[camera])
        ):
            found[camera, name], gathered[camera, name] = seen, patches
            odd += lines
            text = f"{name} decoded, {seen.share:.0%} of what {camera} sees"
            yield Event("solve", len(found), total, text)
    marks = [*venue.fiducials, *tag_marks(venue, tags_seen)]
    geometry, verdict, notes = solve_rig(rig_problem(venue, gathered, marks))
    return SolvedRig(
        geometry, images, verdict, [*odd, *tag_notes(venue, plan, tags_seen), *notes], found
    )


def _rig_by_server(
    venue: Venue, session: Session, server: DomeMaster, total: int
) -> Steps[SolvedRig]:
    """Cameras, from the tags that a media server showed."""
    plan, cameras = plan_of(venue, session), venue.cameras
    placed: dict[str, PlacedCamera] = {}
    tags_seen: dict[str, TagObservations] = {}
    for camera in cameras:
        images = SessionImages(session, plan, Radiometer(cameras[camera]))
        tags_seen[camera] = detect_tags(venue, images)
        placed[camera] = placed_by_server(venue, server, camera, images)
        text = f"{camera} placed by {len(placed[camera].tags)} tags"
        yield Event("solve", len(placed), total, text)
    marks = [*venue.fiducials, *tag_marks(venue, tags_seen)]
    geometry = server_rig(venue, server, placed, marks)
    figures = server_figures(placed)
    worst = figures["server_misalignment_rms_arcmin"].value
    notes = [*tag_notes(venue, plan, tags_seen), *server_notes(venue, server, placed)]
    verdict = f"tags are {worst:.1f} arcmin off"
    return SolvedRig(geometry, images, verdict, notes, figures=figures, server=server)
