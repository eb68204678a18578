"""The plan of a capture session: projectors one after the other, or a media server as one."""

import numpy as np

from procam.errors import InputError
from procam.estimate.media_server.dome_master import DomeMaster, plan_server
from procam.estimate.structured_light.codes import Picture
from procam.estimate.structured_light.patterns import plan_session
from procam.files.images.pixels import read_header
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.server_checks import DOME_MASTER
from procam.model.plan import Plan


def server_of(venue: Venue) -> DomeMaster | None:
    """The media server of a venue, if its projectors are behind one."""
    for name, entry in venue.table.projectors.items():
        if entry.kind == DOME_MASTER:
            fov, rotation = (float(np.radians(a)) for a in (entry.fov_deg, entry.rotation_deg))
            return DomeMaster(name, entry.size[0], fov, rotation)
    return None


def plan_of_session(venue: Venue) -> tuple[Plan, dict[str, Picture]]:
    """The plan of a venue's capture session, and its pictures (H, W, 1 or 3) by path."""
    server, capture = server_of(venue), venue.table.capture
    if server is not None:
        return plan_server(server, capture.exposure_s, capture.black_exposure_s)
    sizes = {name: entry.size for name, entry in venue.table.projectors.items()}
    return plan_session(sizes, capture.exposure_s, capture.black_exposure_s)


def plan_of(venue: Venue, session: Session) -> Plan:
    """The plan of a session, whose pictures are those of the venue's projectors.

    Raises
    ------
    InputError
        venue.toml has other projectors than when the pictures were made.
    """
    plan = session.read_plan()
    for name, entry in venue.table.projectors.items():
        shot = next((s for s in plan.shots if s.projector == name and s.pattern), None)
        found, wanted = "no pictures", "names it"
        if shot is not None:
            header = read_header(session.directory / shot.pattern)
            if (header.width, header.height) == tuple(entry.size):
                continue
            found = f"pictures of {header.width}x{header.height} px"
            wanted = f"says {entry.size[0]}x{entry.size[1]} px"
        raise InputError(
            f"{session.directory} has {found} for projector {name}, but venue.toml {wanted}. Undo the "
            "change to venue.toml, or make new pictures (`procam session capture`, by hand `plan`) and "
            "photograph those"
        )
    return plan
