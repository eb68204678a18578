"""Provenance of a calibration: versions, hashes of what went in, and what a person set."""

import hashlib
import platform
from importlib.metadata import version

from procam.files.bundle.original import PACKAGES
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import manual_edits
from procam.model.provenance import Provenance


def session_provenance(venue: Venue, session: Session) -> Provenance:
    """Versions, the session, a hash over its plan, venue and captures, and what was done by hand."""
    digest = hashlib.sha256()
    digest.update((venue.directory / "venue.toml").read_bytes())  # the one that was solved with
    digest.update((session.directory / "plan.json").read_bytes())
    for camera in venue.table.cameras:
        for key, entry in sorted(session.stored(camera).items()):
            digest.update(f"{camera} {key} {entry.sha256}".encode())
    table = venue.table
    backends = {c.backend for c in table.cameras.values()}
    backends |= {p.backend for p in table.projectors.values()}
    return Provenance(
        session.directory.name,
        digest.hexdigest(),
        tuple(sorted(backends)),
        platform.python_version(),
        {name: version(name) for name in PACKAGES},
        by_hand=manual_edits(venue),
    )
