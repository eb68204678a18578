"""Masks, protected parts and nudges, from venue.toml through solve, compensate, refine and report."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import TINY, make_venue, procam, solved, take_session

from procam.errors import FileFormatError
from procam.estimate.closed_loop.refined import with_gains
from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, read_channels, write_channels
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.maths.geometry.sphere import master_pixels
from procam.model.calibration import Calibration
from procam.workflows.sample_content import half_sky
from procam.workflows.solve.calibrate import solve

SIZE = 128  # of maps and content
PIXEL, SHIFT = (64, 40), (2, -1)
BY_HAND = {
    "[screen]": "protected = [[[0, 70], [90, 70], [180, 70], [270, 70]]]",
    "[cameras.zenith]": "masks = [[[-0.5, -0.5], [9.5, -0.5], [9.5, 199.5], [-0.5, 199.5]]]",
    "[projectors.south]": f"nudges = [{{ pixel = {list(PIXEL)}, shift_px = {list(SHIFT)} }}]",
}


@dataclass(frozen=True)
class Solved:
    """One session, solved as measured and with what a person set."""

    folder: Path
    plain: Calibration
    by_hand: Calibration


def _set(folder: Path, lines: dict[str, str]) -> None:
    text = (folder / "venue.toml").read_text("utf-8")
    for head, line in lines.items():
        assert text.count(head) == 1
        text = text.replace(head, f"{head}\n{line}")
    (folder / "venue.toml").write_text(text, "utf-8")


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    folder = tmp_path_factory.mktemp("dome")
    venue = make_venue(folder, size=TINY)
    session = take_session(venue)
    plain = load_calibration(solved(venue, session))
    _set(folder, BY_HAND)
    by_hand = load_calibration(solved(load_venue(folder), session))
    return Solved(folder, plain, by_hand)


def test_a_solve_applies_and_gives_them(both: Solved) -> None:
    before, after = (c.projectors["south"].surface for c in (both.plain, both.by_hand))
    (x, y), (right, down) = PIXEL, SHIFT
    # the camera's mask takes a few sightings away, so that not all is alike to the last bit
    pixel = np.linalg.norm(before.direction[y, x] - before.direction[y, x + 1])
    off = np.linalg.norm(after.direction[y + down, x + right] - before.direction[y, x])
    assert off < 0.05 * pixel
    far = np.linalg.norm(after.direction[y, 10] - before.direction[y, 10])
    assert far < 0.05 * pixel
    assert both.plain.maps.protected is None and not both.plain.provenance.by_hand
    protected = both.by_hand.maps.protected
    assert protected is not None and 0.01 < protected.covered.mean() < 0.1
    message = both.by_hand.provenance.by_hand
    assert message["masks"] == [{"of": "camera zenith", "corners": 4, "share": 0.05}]
    assert message["nudges"] == [
        {"projector": "south", "pixel": list(PIXEL), "shift_px": list(SHIFT)}
    ]
    assert [entry["of"] for entry in message["protected"]] == ["dome"]


def test_compensate_leaves_what_is_protected_as_it_is(both: Solved, tmp_path: Path) -> None:
    content = half_sky(SIZE)
    write_channels(tmp_path / "in.exr", {c: content[..., i] for i, c in enumerate(RGB)})
    latest = both.folder / "calibrations" / "0002"
    ran = procam("compensate", latest, tmp_path / "in.exr", tmp_path / "out.exr", "--json")
    assert ran.code == 0, ran
    out = read_channels(tmp_path / "out.exr")
    assert both.by_hand.maps.protected is not None
    kept = both.by_hand.maps.protected.covered
    for i, channel in enumerate(RGB):
        np.testing.assert_array_equal(out[channel][kept], content[kept][..., i])
        assert (out[channel] != content[..., i])[~kept].mean() > 0.5
    assert max(json.loads(ran.out)["clipped_share"]) < 0.4


def test_refine_leaves_gains_alone_where_it_is_protected(both: Solved) -> None:
    refined = with_gains(both.by_hand, np.full((64, 64, 3), 1.05))
    before, after = (c.projectors["south"] for c in (both.by_hand, refined))
    direction = np.nan_to_num(before.surface.direction)
    kept = both.by_hand.maps.is_protected(master_pixels(direction, SIZE))
    assert kept.any()
    changed = after.photometry.gain != before.photometry.gain
    assert not changed[kept].any() and changed[~kept].mean() > 0.1
    assert refined.maps.protected is not None
    assert refined.provenance.by_hand == both.by_hand.provenance.by_hand


def test_a_bad_mask_is_reported_before_anything_is_solved(both: Solved) -> None:
    venue = load_venue(both.folder)
    table = venue.table.screen.model_copy(update={"protected": ["gone.png"]})
    broken = replace(venue, table=venue.table.model_copy(update={"screen": table}))
    with pytest.raises(FileFormatError, match=r"gone\.png: no such file"):
        next(solve(broken, Session(both.folder / "sessions" / "0001")))
