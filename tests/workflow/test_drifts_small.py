"""A part of studies/drifts: changes of a simulated dome are named, and their sizes are right."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from procam.estimate.light import floor_albedo
from simulators.drifts import Drift
from simulators.scene import SceneSize
from studies import drifts as study

SMALL = SceneSize(
    projectors=2, projector_size=(240, 150), camera_size=(360, 360), rays=128, map_size=128
)
CHANGES = (
    (Drift("turned", 0.15, "south", 40.0),),
    (Drift("overscan", 0.04, "north"),),
    (Drift("defocused", 2.0, "south"),),
    (Drift("aged", 0.1, "north"),),
    (Drift("gamma", 0.1, "south"),),
    (Drift("raised-black", 0.05, "south"),),
    (Drift("stain", 0.3, angle_deg=40.0),),
    (Drift("ambient", 0.05),),
    (Drift("camera-moved", 1.0, angle_deg=10.0),),
    (Drift("aperture", 0.2),),
    (Drift("camera-moved", 0.7, angle_deg=70.0), Drift("colour-aged", 0.15, "north", channel=2)),
)


@pytest.fixture(scope="module", autouse=True)
def venue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "SIZE", SMALL)
        patch.setattr(floor_albedo, "DROPS", (0.2,))  # the floor's depth changes no drift
        study._venues["small"] = study.make_venue(
            Path(tmp_path_factory.mktemp("drifts")) / "venue", "standard", 2
        )
        yield
        study._venues.clear()


@cache
def run(drifts: tuple[Drift, ...]) -> dict[str, Any]:
    """What comes of changes, for two tests."""
    return study.run(study.Case("small", drifts, 3))


@pytest.mark.parametrize("drifts", CHANGES, ids=lambda drifts: " ".join(d.kind for d in drifts))
def test_the_cause_is_named_and_no_other(drifts: tuple[Drift, ...]) -> None:
    row = run(drifts)
    assert row["named"] and row["others"] == []
    for error in row["errors"]:
        assert abs(error["size"] - error["true"]) < 3.5 * error["sigma"], error


def test_no_change_is_no_alarm() -> None:
    assert study.run(study.Case("small", (), 1))["others"] == []


def test_the_table() -> None:
    rows = [run(drifts) for drifts in CHANGES[3:4]]
    text = "\n".join(study.table(rows, 0.1))
    assert (
        "1 single changes, 0 pairs and 0 venues" in text
        and "| aged | 1 | 100.0% | 100.0% |" in text
    )


def test_pairs_do_not_hide_each_other() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        first, second = study._pair(rng, ["south", "north"])
        blind = {first.kind, second.kind} & set(study.BLIND)
        assert not blind or not first.projector or first.projector != second.projector


@pytest.mark.parametrize(
    "drift",
    [
        Drift("turned", 2.2, "south", 90.0),  # bends the picture, as a keystone correction does
        Drift("zoomed", 0.06, "north"),
        Drift("camera-moved", 3.5, angle_deg=40.0),  # seen through a wrong pose at first
        Drift("camera-moved", 0.05, angle_deg=10.0),  # less than a projector is allowed to move
        Drift("aperture", -0.8),
    ],
    ids=lambda drift: f"{drift.kind} {drift.size:g}",
)
def test_large_and_little_changes_have_the_same_names(drift: Drift) -> None:
    row = study.run(study.Case("small", (drift,), 6))
    assert row["named"] and row["others"] == []


def test_two_lamps_of_two_that_aged_alike_may_be_the_camera_and_of_unlike_ones_are_lamps() -> None:
    aged = (Drift("aged", 0.2, "south"), Drift("aged", 0.12, "north"))
    row = study.run(study.Case("small", aged, 7))
    assert row["named"] and row["others"] == []
