"""What `procam lens response` reports of photographs that do not fit, and of raw files.

The photographs are those of the study `foreign-responses`, which no estimator has a model of.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import Ran, procam

from procam.files.images.photos import load_response
from procam.files.images.pixels import read_image, write_image
from procam.files.venue.load import create_venue, load_venue
from studies import foreign_brackets
from studies import foreign_responses as study
from studies.foreign_brackets import CASES, Brackets, Case, contrast, shoot, srgb

MOVING = Case("moving", (srgb,), 1, 5, moving=True)
WRONG = Case("wrong", (srgb,), 1, 5, wrong=True)
CHANNELS = Case("channels", (contrast, srgb, srgb), 1, 5)


@pytest.fixture
def small_photographs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the study's: enough for what a command says, if not for its intervals."""
    monkeypatch.setattr(foreign_brackets, "SHAPE", (90, 135))


def solve(brackets: Brackets, venue: Path, *more: str) -> Ran:
    """Store the photographs, in VENUE/b, and solve them for a camera of the venue."""
    if not venue.is_dir():
        create_venue(venue, "by-hand")
    for number, pixels in enumerate(brackets.photographs):
        write_image(venue / "b" / f"img_{number}.png", pixels)
    exposures = ",".join(repr(value) for value in brackets.nominal_s.tolist())
    command = ("lens", "response", "--photos", venue / "b", "--exposures", exposures)
    return procam(*command, "--into", venue, "--camera", "side", *more)


@pytest.mark.parametrize("name", ["filmic (Hable), 2 stops", "film (logistic), 3 stops"])
def test_foreign_cameras_are_within_their_intervals(name: str) -> None:
    case = next(case for case in CASES if case.name == name)
    row = study.summary(case, [study.run(case, seed) for seed in range(2)])
    assert not row["refused"] and not row["wrong_curves"] and not row["wrong_left_out"]
    assert row["seeds_within"] == 2 and row["error"] < 0.01
    assert row["sigma"] < 0.02
    assert len(study.table([row, study.total([row])])) == 9


@pytest.mark.usefixtures("small_photographs")
def test_something_that_moves_is_marked_in_a_picture(tmp_path: Path) -> None:
    venue = create_venue(tmp_path / "venue", "by-hand")
    (venue / "b").mkdir()
    (venue / "b" / "img_0.CR2").write_bytes(b"raw")
    ran, picture = solve(shoot(MOVING, 0), venue), venue / "side-response.png"
    assert ran.code == 0, ran
    assert "% of the places do not fit, as where something moves" in ran.out
    assert "1 raw files (img_0.CR2 ...) lie beside the photographs: raw is linear and" in ran.out
    assert f"{picture} marks in red what does not fit" in ran.out
    marked = read_image(picture)
    red = marked[..., 0].astype(int) - marked[..., 1] > 100
    assert red[22:].mean() > 4 * red[:20].mean()


@pytest.mark.usefixtures("small_photographs")
def test_a_wrong_exposure_is_named_and_left_out(tmp_path: Path) -> None:
    brackets = shoot(WRONG, 0)
    grey = Brackets([p[..., 1] for p in brackets.photographs], brackets.nominal_s, brackets.wrong)
    ran = solve(grey, tmp_path / "venue", "--json")
    document = json.loads(ran.out)
    name = f"img_{brackets.wrong}.png"
    assert (ran.code, document["left_out"], document["overruled"]) == (0, [name], "")
    assert document["warnings"][0].startswith(f"{name} does not fit and is left out")
    assert len(document["photographs"]) == len(document["exposures_s"]) == 4


@pytest.mark.usefixtures("small_photographs")
def test_channels_that_differ_are_written_each(tmp_path: Path) -> None:
    venue = tmp_path / "venue"
    ran = solve(shoot(CHANNELS, 0), venue)
    assert "a curve for each channel" in ran.out and not [*venue.glob("*.png")]
    name = load_venue(venue).table.cameras["side"].response
    _, light = load_response(name, venue) or ((), np.zeros(0))
    assert light.shape == (256, 3)


@pytest.mark.usefixtures("small_photographs")
def test_a_refused_curve_is_written_with_accept(tmp_path: Path) -> None:
    brackets, venue = shoot(WRONG, 0), tmp_path / "venue"
    wrong = brackets.wrong or 0
    kept = slice(max(0, wrong - 2), max(0, wrong - 2) + 4)
    few = Brackets(brackets.photographs[kept], brackets.nominal_s[kept], None)
    assert solve(few, venue).code == 2
    assert load_venue(venue).table.cameras["side"].response == "linear"
    assert sorted(path.name for path in venue.iterdir()) == ["b", "venue.toml"]
    ran = solve(few, venue, "--accept")
    assert ran.code == 0, ran
    assert "warning: accepted although a check refuses it: brackets: photograph" in ran.out
    assert load_venue(venue).table.cameras["side"].response == "side-response.csv"
    assert (venue / "side-response.csv").is_file() and (venue / "side-response.png").is_file()
