"""Which causes are named, and which of several explanations is taken."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.drift.camera_motion import CameraMotion
from procam.estimate.drift.changes import VenueChange
from procam.estimate.drift.displacement import Motion, unmoved
from procam.estimate.drift.dome_change import DomeChange
from procam.estimate.drift.findings import name_causes
from procam.estimate.drift.projector_change import ProjectorChange
from procam.estimate.drift.response_change import ResponseChange
from procam.model.calibration import Calibration
from procam.model.photometry import Departure
from procam.model.transport import Measured

SHAPE = 30, 48
Named = Callable[..., set[tuple[str, str]]]
SAME = ProjectorChange(
    1.0,
    motion=unmoved(SHAPE),
    moved_px=0.001,
    moved_sigma=0.003,
    blur_px2=0.01,
    blur_sigma=0.02,
    response=ResponseChange(1.0, 0.001, np.ones(3), np.full(3, 0.002)),
    black=1.0,
    black_sigma=0.02,
    trend_sigma=1e-4,
    light=np.zeros(3),
    light_sigma=np.full(3, 5e-4),
)

UNLIKE = Departure(0.1, 0.002, 0.5, 1)


def responding(**change: object) -> ProjectorChange:
    """A projector whose response changed."""
    return replace(SAME, response=replace(SAME.response, **change))  # type: ignore[type-var, arg-type]


def moved(**terms: float) -> ProjectorChange:
    """A projector whose picture moved by some of the terms a0, a1, a2, b0, b1, b2, g, h."""
    order = ("a0", "a1", "a2", "b0", "b1", "b2", "g", "h")
    values = np.array([terms.get(name, 0.0) for name in order])
    motion = Motion(SHAPE, values, np.eye(8) * 1e-10)
    length = float(np.linalg.norm(values)) * 24
    return replace(SAME, motion=motion, moved_px=length, moved_sigma=0.003, edge_follows=1.0)


@pytest.fixture
def venue(calibration: Calibration) -> Named:
    """Causes that are named where the projectors of the calibration, and others, changed as given."""

    def named(
        scatter: float = 1.0,
        ambient: float = 0.0,
        seen: tuple[str, ...] = (),
        **changes: ProjectorChange,
    ) -> set[tuple[str, str]]:
        projectors = {"south": SAME, "north": SAME} | changes
        known = {
            n: calibration.projectors.get(n, calibration.projectors["south"]) for n in projectors
        }
        change = VenueChange(
            projectors,
            CameraMotion(calibration.cameras["zenith"], bool(seen), 0.3, 0.01, unmoved=seen),
            DomeChange(None, None),
            Measured(np.full(3, scatter), np.full(3, 0.004)),
            Measured(np.full(3, ambient), np.full(3, 1e-4)),
        )
        found = name_causes(replace(calibration, projectors=known), change)
        assert all(each.text and each.advice for each in found)
        return {(each.cause, each.subject) for each in found}

    return named


def log(*ratios: float) -> np.ndarray:
    return np.log(np.array(ratios))


def test_nothing(venue: Named) -> None:
    assert venue() == set()


def test_levels_of_a_picture_that_is_drawn_anew_are_not_judged(
    venue: Named,
) -> None:
    bent = replace(moved(h=0.03), response=responding(exponent=1.3).response, black=3.0, raised=0.1)
    assert venue(south=bent) == {("picture setting", "south"), ("black level", "south")}


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (moved(a0=0.05), "moved"),
        (moved(a1=0.01, b2=0.01), "moved"),
        (replace(moved(a1=0.02, b2=0.02), edge_follows=0.0), "picture setting"),
        (moved(a1=0.03, b2=0.0), "picture setting"),
        (moved(h=0.03), "picture setting"),
        (replace(SAME, turned_over="mirrored", motion=None), "picture setting"),
        (replace(SAME, motion=None), "another picture"),
        (replace(SAME, shows=0.01, motion=None), "no picture"),
        (replace(SAME, blur_px2=2.0), "focus"),
        (replace(SAME, blur_px2=-1.0), "focus"),
        (replace(SAME, light=log(0.9, 0.9, 0.9)), "light"),
        (replace(SAME, light=log(1.0, 1.0, 0.9)), "colour"),
        (replace(SAME, light=log(1.0, 1e-4, 1.0)), "dead channel"),
        (replace(SAME, trend=0.02), "warming up"),
        (replace(SAME, trend=0.02, light=log(0.8, 0.8, 0.8)), "warming up"),
        (replace(SAME, black=2.0, raised=0.03), "black level"),
        (replace(SAME, black=0.5), "dynamic setting"),
        (replace(SAME, response=replace(SAME.response, span=np.full(3, 0.8))), "dynamic setting"),  # type: ignore[type-var]
        (responding(exponent=1.1), "gamma setting"),
        (responding(each=np.array([1, 1, 0.9]), each_sigma=np.full(3, 1e-3)), "gamma setting"),
        (responding(clipping=UNLIKE, rest=UNLIKE), "signal range"),
        (responding(rest=UNLIKE), "gamma setting"),
        (responding(span=np.full(3, 0.96)), "dynamic setting"),
        (replace(responding(clipping=UNLIKE), black=2.0, raised=0.03), "black level"),
        (replace(SAME, response=None), "not seen"),
    ],
)
def test_of_one_projector(change: ProjectorChange, cause: str, venue: Named) -> None:
    assert venue(south=change) == {(cause, "south")}


@pytest.mark.parametrize(
    "change",
    [
        replace(moved(a0=0.05), moved_sigma=0.5),
        replace(SAME, blur_px2=2.0, blur_sigma=0.5),
        replace(SAME, light=log(0.95, 0.95, 0.95), light_sigma=np.full(3, 0.02)),
        replace(SAME, black=1.5, black_sigma=0.2, raised=0.02),
        replace(SAME, black=0.7, black_sigma=0.1),
        replace(SAME, black=float("nan"), black_sigma=float("nan")),
        responding(span=np.full(3, 0.96), span_sigma=np.full(3, 0.01)),
        responding(clipping=Departure(0.1, 0.03), rest=Departure(0.015, 0.001)),
        replace(SAME, light=log(0.985, 0.985, 0.985)),  # less than what matters
    ],
)
def test_what_is_not_certain_is_not_named(change: ProjectorChange, venue: Named) -> None:
    assert venue(south=change) == set()


def test_all_lamps_alike_are_the_camera(venue: Named) -> None:
    dim = replace(SAME, light=log(0.8, 0.8, 0.8))
    assert venue(south=dim, north=dim) == {("camera exposure", "zenith")}
    dimmer = replace(SAME, light=log(0.72, 0.72, 0.72))
    both = venue(south=dim, north=dim, east=dim, west=dimmer)
    assert both == {("camera exposure", "zenith"), ("light", "west")}


def test_all_blurred_alike_are_the_camera(venue: Named) -> None:
    soft, softer = replace(SAME, blur_px2=2.0), replace(SAME, blur_px2=5.0)
    assert venue(south=soft, north=soft, east=soft) == {("camera focus", "zenith")}
    assert venue(south=soft, north=soft, east=softer) == {
        ("camera focus", "zenith"),
        ("focus", "east"),
    }


def test_a_camera_that_moved_is_named_by_several_pictures(
    venue: Named,
) -> None:
    assert venue(seen=("south", "north")) == {("camera moved", "zenith")}


def test_the_only_picture_that_is_seen_may_have_moved_itself(
    venue: Named,
) -> None:
    dark = replace(SAME, shows=0.0)
    assert venue(seen=("south",), north=dark) == {("moved", "south"), ("no picture", "north")}


def test_the_room(venue: Named) -> None:
    assert venue(scatter=1.2) == {("floor or audience", "")}
    assert venue(scatter=1.01) == set()
    assert venue(ambient=0.02) == {("ambient light", "")}
    assert venue(ambient=0.001) == set()
