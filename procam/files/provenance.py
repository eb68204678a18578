"""The provenance of a calibration in calibration.json; what is empty is left out."""

import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from procam.files.calibration_entries import number
from procam.model.provenance import Note, Provenance

# how notes began before they had a code: with a device, or with a share of a projector's picture
RIM = re.compile(r"(.+% of) the picture of ([^ ]+) (lie beyond the dome's rim.*)", re.DOTALL)
SUBJECT = re.compile(r"((?:projector|camera) [^ :]+): (.*)", re.DOTALL)


def provenance_entry(provenance: Provenance) -> dict[str, Any]:
    """As JSON."""
    return {name: value for name, value in asdict(provenance).items() if value}


def read_provenance(entry: Mapping[str, Any]) -> Provenance:
    """From JSON; raises what reading a damaged document raises."""
    return Provenance(
        _text(entry, "session"),
        _text(entry, "input_sha256"),
        tuple(map(str, _list(entry, "backends"))),
        _text(entry, "python"),
        {str(name): str(version) for name, version in entry.get("versions", {}).items()},
        tuple(_note(note) for note in _list(entry, "notes")),
        tuple(map(str, _list(entry, "recalibrated"))),
        dict(entry.get("by_hand", {})),
        dict(entry.get("meter", {})),
    )


def _note(entry: Mapping[str, Any] | str) -> Note:
    """A note; of a calibration of before notes had a code, its line."""
    if isinstance(entry, str):
        if beyond := RIM.fullmatch(entry):
            return Note("", f"projector {beyond[2]}", f"{beyond[1]} its picture {beyond[3]}")
        found = SUBJECT.fullmatch(entry)
        return Note("", found[1], found[2]) if found else Note("", "", entry)
    code, subject, text = (_text(entry, key) for key in ("code", "subject", "text"))
    return Note(code, subject, text, number(entry, "amount"))


def _text(entry: Mapping[str, Any], key: str) -> str:
    found = entry.get(key, "")
    if not isinstance(found, str):
        raise ValueError(f"{key} is {found!r} where text belongs")
    return found


def _list(entry: Mapping[str, Any], key: str) -> list[Any]:
    found = entry.get(key, [])
    if not isinstance(found, list):
        raise ValueError(f"{key} is {found!r} where a list belongs")
    return found
