"""The depth of linear counts that are decoded from encoded photographs.

A photograph of 8 bits, encoded by a tone curve, resolves the dark half of its light far better than linear
counts of 8 bits do. So decoded counts have 16 bits, whatever `bits` of venue.toml says of the camera.
"""

from procam.files.session import Session
from procam.files.venue.load import Venue

DECODED_BITS = 16


def with_decoded_bits(venue: Venue, session: Session | None = None) -> Venue:
    """The venue, whose cameras have the depth of the counts that `session` has of them, or will have.

    Counts that an earlier version decoded, and those of a driven camera, have the depth of venue.toml.
    """
    bits = dict[str, int]()
    for name, camera in venue.table.cameras.items():
        known = session is not None and bool(session.stored(name))
        if session is not None and known:
            bits[name] = session.bits(name) or camera.bits
        elif camera.response != "linear":
            bits[name] = DECODED_BITS
    return venue.with_bits(bits)
