"""The test of projectors' settings in photographs that people take: a round of 20 for each projector."""

import numpy as np

from procam.estimate.projector_tests.patterns import PatchLayout
from procam.files.venue.load import Venue
from procam.files.venue.tables import CaptureTable
from procam.model.optics import CameraModel
from procam.workflows.doctor.behaviour import (
    HALF,
    BehaviourTest,
    Frames,
    longer_for_dark,
    pictures_to_show,
)
from procam.workflows.doctor.findings import Diagnosis, judge_behaviour
from procam.workflows.photographs.driven import Photographer, Wanted
from procam.workflows.photographs.open import HandPhotographer


def examine_behaviour_by_hand(
    photographer: HandPhotographer, venue: Venue, camera: CameraModel, diagnosis: Diagnosis
) -> None:
    """Test the settings of all projectors, one after the other, in photographs that people took.

    Raises
    ------
    PhotographsWanted
        Not all were taken yet.
    """
    for name, table in venue.table.projectors.items():
        layout = PatchLayout(table.size)
        frames = _photographs(photographer, name, layout, venue.table.capture)
        tested = BehaviourTest(camera.name, camera.sensor, layout, frames).run()
        diagnosis.behaviour[name] = tested
        diagnosis.photographs += len(frames)
        if tested.effects:
            judge_behaviour(diagnosis, name)
        else:
            found = f"nothing that could be judged: {tested.untested[0]}"
            diagnosis.add(
                f"projector {name}", "untested", found, "its test pictures", photographer.again
            )
    photographer.end()


def _photographs(
    photographer: Photographer, projector: str, layout: PatchLayout, capture: CaptureTable
) -> Frames:
    """Photographs by name, of a panel with these patches."""
    wanted = _wanted(projector, layout, capture)
    photographer.plan(list(wanted.values()))
    return {name: photographer.take(each) for name, each in wanted.items()}


def _wanted(projector: str, layout: PatchLayout, capture: CaptureTable) -> dict[str, Wanted]:
    white_s, black_s = capture.exposure_s, capture.black_exposure_s
    black = {projector: np.zeros((*layout.size[::-1], 3), np.float32)}
    white = {projector: np.ones_like(black[projector])}
    dark_s = longer_for_dark(black_s, white_s) * white_s
    return {
        "black": Wanted(black, black_s),
        "white": Wanted(white, white_s),
        "again": Wanted(white, white_s),
        "half": Wanted(white, HALF * white_s),
        **{
            name: Wanted({projector: picture}, dark_s if name == "dark-steps" else white_s)
            for name, picture in pictures_to_show(layout).items()
        },
    }
