"""Solves where cameras stood that photographed a dome behind a media server."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array32
from procam.errors import FileFormatError
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.media_server.camera_pose import (
    ALIGNED_ARCMIN,
    PlacedCamera,
    check_rotation,
    find_master_tags,
    place_camera,
    server_geometry,
)
from procam.estimate.media_server.dome_master import DomeMaster
from procam.estimate.media_server.tags import TAG_PICTURES
from procam.files.venue.load import Venue
from procam.model.optics import Fiducial
from procam.model.provenance import Note
from procam.model.quality import Figure
from procam.workflows.capture.session_images import SessionImages

WELL_ALIGNED_ARCMIN = 3 * ALIGNED_ARCMIN
SAME_FOCAL = 0.02  # of a lens that was a guess; more may be the master's angle


def placed_by_server(
    venue: Venue, master: DomeMaster, camera: str, images: SessionImages
) -> PlacedCamera:
    """One camera, placed by the tags that the server showed."""
    shots = images.plan.of(master.name, "tags")
    if [shot.detail.get("picture") for shot in shots] != list(range(TAG_PICTURES)):
        raise FileFormatError(
            f"{images.session.directory / 'plan.json'}: {len(shots)} shots 'tags' of projector "
            f"{master.name} instead of {TAG_PICTURES}; restore the file"
        )
    pictures: list[Array32] = [images.counts(s).astype(np.float32) for s in shots]
    model, table = venue.cameras[camera], venue.table.cameras[camera]
    tags = find_master_tags(model, master, pictures)
    return place_camera(model, table.intrinsics, venue.screen.shape.radius_m, tags)


def server_rig(
    venue: Venue, master: DomeMaster, placed: dict[str, PlacedCamera], marks: Sequence[Fiducial]
) -> GeometrySolution:
    """The solved rig, its turn about the pole checked against the marks on the dome."""
    geometry = server_geometry(master, venue.screen.shape.radius_m, placed)
    check_rotation(geometry, master, marks)
    return geometry


def server_notes(venue: Venue, master: DomeMaster, placed: dict[str, PlacedCamera]) -> list[Note]:
    """Notes on the tags."""
    far = "{} left out, far from where the others place them"
    notes = [
        Note("tags dropped", f"camera {name}", far.format(", ".join(each.dropped)))
        for name, each in placed.items()
        if each.dropped
    ]
    free = (
        "its lens was solved from the server's tags, which fit a master of another angle as well; measure it "
        'with `procam lens board` and set intrinsics = "fixed"'
    )
    notes += [
        Note("lens by tags", f"camera {name}", free)
        for name in placed
        if venue.table.cameras[name].intrinsics != "fixed"
    ]
    for name, each in placed.items():
        ratio = float(np.mean(each.camera.lens.focal / venue.cameras[name].lens.focal))
        if abs(ratio - 1) > SAME_FOCAL:
            text = (
                f"f was solved to {ratio:.3f} times the value in venue.toml; if that was right, the master "
                f"spans {np.degrees(master.fov) * ratio:.0f} degrees and not "
                f"{np.degrees(master.fov):.0f}: the tags alone do not determine it"
            )
            amount = abs(ratio - 1) / SAME_FOCAL
            notes.append(Note("lens contradicts", f"camera {name}", text, amount))
    worst = max(each.rms_arcmin for each in placed.values())
    if worst > WELL_ALIGNED_ARCMIN:
        text = (
            f"tags are {worst:.1f} arcmin rms off, more than a well aligned server's; it is warped badly, or "
            "the camera's lens is not that of venue.toml"
        )
        amount = worst / WELL_ALIGNED_ARCMIN
        notes.append(Note("server misaligned", f"projector {master.name}", text, amount))
    return notes


def server_figures(placed: dict[str, PlacedCamera]) -> dict[str, Figure]:
    """How well a server is aligned, as its cameras measure it."""
    count = sum(len(each.tags) for each in placed.values())
    worst = max(each.rms_arcmin for each in placed.values())
    note = "tags, shown against seen; the camera's lens errs in it too"
    return {"server_misalignment_rms_arcmin": Figure(worst, "arcmin", None, count, note)}
