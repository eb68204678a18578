"""AprilTags on the dome: looked for in what a session holds, and handed to the solver as marks."""

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry import apriltags as tags
from procam.estimate.geometry.apriltags import TagObservations
from procam.estimate.structured_light.photo_match import NUMBER
from procam.files.venue.load import Venue
from procam.model.optics import USUAL_FAMILY, Distance, Fiducial, tag_name
from procam.model.plan import Plan, Purpose
from procam.workflows.capture.session_images import SessionImages

# the blacks are exposed long: paper that is too bright in white is not in them
LIT_ALL_OVER: tuple[Purpose, ...] = ("white", "black")


def detect_tags(venue: Venue, readings: SessionImages) -> TagObservations:
    """What one camera's pictures show of the venue's tags."""
    lens, shown = readings.radiometer.camera.lens, _shown(readings.plan)
    return tags.detect_tags(_pictures(readings), lens, venue.tags, shown)


def tag_marks(venue: Venue, looks: Mapping[str, TagObservations]) -> list[Fiducial]:
    """A mark for every camera that sees a tag; `looks` by camera."""
    return tags.tag_fiducials(venue.tags, looks, venue.cameras)


def tag_notes(venue: Venue, plan: Plan, looks: Mapping[str, TagObservations]) -> list[str]:
    """What did not go well with tags, a line each."""
    shown = _shown(plan)
    lines = [
        f"{tag.name}: the pictures of this session carry that number, so it is no mark; "
        "print another number or family"
        for tag in venue.tags
        if tag.name in shown
    ]
    others = [tag for tag in venue.tags if tag.name not in shown]
    lines += tags.tag_notes(others, looks)
    known = known_distances(venue, tag_marks(venue, looks))
    left_out = [d for d in venue.distances if d not in known]
    return lines + [f"the distance from {d.a} to {d.b} is left out" for d in left_out]


def known_distances(venue: Venue, marks: Sequence[Fiducial]) -> list[Distance]:
    """The distances that somebody measured, without those to tags that no camera sees."""
    lost = {tag.name for tag in venue.tags} - {mark.name for mark in marks}
    return [d for d in venue.distances if not lost & {d.a, d.b}]


def _pictures(readings: SessionImages) -> Iterator[NDArray[np.float32]]:
    """Counts (H, W) of the whole dome lit: the pictures of all projectors together."""
    for purpose in LIT_ALL_OVER:
        shots = (shot for shot in readings.plan.shots if shot.purpose == purpose)
        yield reduce(np.add, (readings.counts(shot).astype(np.float32) for shot in shots))


def _shown(plan: Plan) -> set[str]:
    """Names of the tags that projectors draw, so that photographs tell their pictures apart."""
    lit = (shot for shot in plan.shots if shot.purpose in LIT_ALL_OVER)
    return {tag_name(USUAL_FAMILY, int(s.detail[NUMBER])) for s in lit if NUMBER in s.detail}
