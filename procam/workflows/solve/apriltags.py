"""AprilTags on the dome: detected in the pictures of a session, and given to the solver as fiducials."""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce

import numpy as np

from procam.arrays import Array32
from procam.estimate.geometry import apriltags as tags
from procam.estimate.geometry.apriltags import TagObservations
from procam.estimate.structured_light.photo_match import NUMBER
from procam.files.venue.load import Venue
from procam.model.optics import USUAL_FAMILY, Distance, Fiducial, tag_name
from procam.model.plan import Plan, Purpose
from procam.model.provenance import Note
from procam.workflows.capture.session_images import SessionImages

# the blacks are exposed long: paper that is too bright in white is not in them
LIT_ALL_OVER: tuple[Purpose, ...] = ("white", "black")


def detect_tags(venue: Venue, images: SessionImages) -> TagObservations:
    """What one camera's pictures show of the venue's tags."""
    lens, shown = images.radiometer.camera.lens, _shown(images.plan)
    return tags.detect_tags(_pictures(images), lens, venue.tags, shown)


def tag_marks(venue: Venue, tags_seen: Mapping[str, TagObservations]) -> list[Fiducial]:
    """A fiducial for every camera that sees a tag; `tags_seen` by camera."""
    return tags.tag_fiducials(venue.tags, tags_seen, venue.cameras)


def tag_notes(venue: Venue, plan: Plan, tags_seen: Mapping[str, TagObservations]) -> list[Note]:
    """Notes on the tags."""
    shown = _shown(plan)
    text = "the pictures of this session carry that number, so it is no mark; print another number or family"
    notes = [Note("tag is a number", tag.name, text) for tag in venue.tags if tag.name in shown]
    others = [tag for tag in venue.tags if tag.name not in shown]
    notes += tags.tag_notes(others, tags_seen)
    known = known_distances(venue, tag_marks(venue, tags_seen))
    return notes + [
        Note("distance left out", "", f"the distance from {d.a} to {d.b} is left out")
        for d in venue.distances
        if d not in known
    ]


def known_distances(venue: Venue, marks: Sequence[Fiducial]) -> list[Distance]:
    """The distances that somebody measured, without those to tags that no camera sees."""
    lost = {tag.name for tag in venue.tags} - {mark.name for mark in marks}
    return [d for d in venue.distances if not lost & {d.a, d.b}]


def _pictures(images: SessionImages) -> Iterator[Array32]:
    """Counts (H, W) of the whole dome lit: the pictures of all projectors together."""
    for purpose in LIT_ALL_OVER:
        shots = (shot for shot in images.plan.shots if shot.purpose == purpose)
        yield reduce(np.add, (images.counts(shot).astype(np.float32) for shot in shots))


def _shown(plan: Plan) -> set[str]:
    """Names of the tags that projectors draw, by which photographs are assigned to shots."""
    lit = (shot for shot in plan.shots if shot.purpose in LIT_ALL_OVER)
    return {tag_name(USUAL_FAMILY, int(s.detail[NUMBER])) for s in lit if NUMBER in s.detail}
