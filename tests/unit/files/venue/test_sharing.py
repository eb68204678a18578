"""Every key of venue.toml is either shared or private, and text that is shared cannot be just anything."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from venue_keys import leaves

from procam.files.venue.sharing import PRIVATE, SHARED, paths_of, shared_tables
from procam.files.venue.tables import VenueTable

PAGE = Path(__file__).parents[4] / "docs" / "howto" / "share-a-session.md"
# text that is free: replaced by numbers, or the name of a device, mark or file of the bundle
REPLACED = {
    "screen.masks",
    "screen.protected",
    "screen.file",
    "screen.lit",
    "screen.others",
    "cameras.*.masks",
    "cameras.*.response",
    "projectors.*.masks",
    "fiducials.*.name",
    "fiducials.*.camera",
    "fiducials.*.projector",
    "distances.*.a",
    "distances.*.b",
}


def may_hold_text(kind: Any) -> bool:
    if get_origin(kind) is Annotated:
        return may_hold_text(get_args(kind)[0])
    if get_origin(kind) is Literal:
        return False
    return kind is str or any(may_hold_text(each) for each in get_args(kind))


def test_every_key_is_classified_once() -> None:
    shared, private = list(paths_of(SHARED)), list(paths_of(PRIVATE))
    assert not set(shared) & set(private)
    assert sorted([*shared, *private]) == sorted(leaves(VenueTable)), "put the key into either list"


def test_a_new_key_would_be_noticed() -> None:
    class Wider(VenueTable):
        webhook: str = ""

    assert "webhook" in leaves(Wider)


def test_shared_text_is_replaced_or_of_a_closed_list() -> None:
    found = leaves(VenueTable)
    free = {path for path in paths_of(SHARED) if may_hold_text(found[path])}
    assert free == REPLACED


def test_the_documentation_has_the_list() -> None:
    rows = re.findall(r"^\| `([\w.*]+)` \| ([\w ]+) \|$", PAGE.read_text(), re.MULTILINE)
    assert dict(rows) == SHARED


def test_what_is_not_shared_is_named() -> None:
    table = VenueTable.model_validate(
        {
            "screen": {"kind": "dome", "tilt_deg": 3},
            "cameras": {
                "zenith": {
                    **{"backend": "acme", "size": [60, 60], "model": "brown", "k": [0] * 5},
                    **{"f": [60, 60], "c": [30, 30], "bits": 12, "black_level": 0},
                }
            },
            "projectors": {
                "south": {
                    "size": [64, 40],
                    "control": {"protocol": "escvp21", "port": "/dev/ttyS7"},
                    "nudges": [{"pixel": [3, 4], "shift_px": [1, 0]}],
                }
            },
            "capture": {"exposure_s": 1, "black_exposure_s": 2},
            "unattended": {"interlock": "true", "begin": "02:00", "end": "04:00"},
            "acceptance": {"coverage": 0.9},
        }
    )
    kept, left = shared_tables(table)
    assert left == [
        *("cameras.zenith.backend", "projectors.south.control", "unattended", "acceptance"),
    ]
    assert kept["screen"] == {"kind": "dome", "tilt_deg": 3}
    assert kept["projectors"]["south"]["nudges"] == [{"pixel": [3, 4], "shift_px": [1, 0]}]
    assert set(kept) == {"screen", "cameras", "projectors", "capture"}
