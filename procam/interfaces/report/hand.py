"""The section on manual settings: masks, protected parts of the dome, nudges."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from procam.interfaces.plots import charts as plots
from procam.interfaces.plots.figure import LIMITS, UNKNOWN
from procam.interfaces.report.blocks import Block, Pictures, Table, Text, categories
from procam.interfaces.report.data import SHOWN, Material
from procam.interfaces.report.words import number, percent

Entry = Mapping[str, Any]
WHOLES = {"camera": "picture", "projector": "panel", "dome": "dome"}
PROTECTED = (LIMITS[0], plots.COUNTS[2], UNKNOWN)
PROTECTED_WORDS = ("compensated", "protected", "no projector reaches")


def by_hand(material: Material) -> Iterator[Block]:
    """Masks, protected parts and nudges of the newest calibration; empty without them."""
    manual = material.calibration.provenance.by_hand if material.calibration else {}
    if not manual:
        return
    yield Text(
        "These settings in venue.toml were made by hand, not measured. Every solve uses them again "
        "until they are removed."
    )
    rows = [_outline(e, "is not used") for e in manual.get("masks", ())]
    rows += [_outline(e, "is left as it is") for e in manual.get("protected", ())]
    if rows:
        yield Table(["Marked in", "Drawn as", "Covers", "Effect"], rows)
    if "protected" in manual:
        yield _protected(material)
    if "nudges" in manual:
        yield _nudges(manual["nudges"])


def _outline(entry: Entry, meaning: str) -> list[str]:
    kind, _, name = entry["of"].partition(" ")
    drawn = entry.get("file") or f"polygon of {entry['corners']} points"
    covers = f"{percent(entry['share'])} of the {WHOLES.get(kind, 'canvas')}"
    return [f"{kind.capitalize()} {name}".rstrip(), drawn, covers, meaning]


def _protected(material: Material) -> Pictures:
    codes = np.where(material.coverage(SHOWN) > 0.5, 0, 2)
    codes[material.protected(SHOWN)] = 1
    legend = list(zip(PROTECTED, PROTECTED_WORDS, strict=True))
    return Pictures(
        [categories(material, {"Protected parts": codes}, legend)],
        "There the picture is sent unchanged, and the loop does not correct it. The light that it casts "
        f"on the rest of the {material.word} is removed there as any other.",
    )


def _nudges(entries: Sequence[Entry]) -> Table:
    def places(entry: Entry) -> list[str]:
        return [number(value, 5) for value in (*entry["pixel"], *entry["shift_px"])]

    far = [float(np.hypot(*entry["shift_px"])) for entry in entries]
    largest = entries[int(np.argmax(far))]
    x, y, *_ = places(largest)
    return Table(
        ["Nudged picture", "At x [px]", "At y [px]", "Moved right [px]", "Moved down [px]"],
        [[f"Projector {entry['projector']}", *places(entry)] for entry in entries],
        "The picture was moved at these pixels of the panels, and less and less around them. The "
        f"largest nudge, {number(max(far))} px, is that of {largest['projector']} at ({x}, {y}).",
    )
