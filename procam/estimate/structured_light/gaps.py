"""Photographs that are missing from a set: how many may be, and where the numbers in the names skip."""

import re
from collections.abc import Sequence

from procam.estimate.structured_light.consistency import Order

MOST_MISSING = 4  # photographs
MISSING = "missing"  # how notes on pictures begin that a set lacks


def spread(shown: Sequence[int | None], gaps: Sequence[int]) -> Order:
    """Photographs with a None at each of the places `gaps` of the result."""
    spread: Order = list(shown)
    for gap in gaps:
        spread.insert(gap, None)
    return spread


def count_fits(needed: int, names: Sequence[str]) -> bool:
    """Whether photographs of these names can be a set of `needed`, some missing or one too many."""
    missing = needed - len(names)
    return abs(missing) <= 1 or (
        1 < missing <= MOST_MISSING and skipped_numbers(names, missing) is not None
    )


def skipped_numbers(names: Sequence[str], missing: int) -> tuple[int, ...] | None:
    """Places of the numbers that are skipped in the last numbers of the names, if as many as `missing`."""
    found = [re.findall(r"\d+", name) for name in names]
    if not all(found):
        return None
    numbers = [int(each[-1]) for each in found]
    skipped = sorted(set(range(numbers[0], numbers[-1] + 1)) - set(numbers))
    if len(skipped) != missing or len(set(numbers)) < len(numbers) or numbers != sorted(numbers):
        return None
    return tuple(number - numbers[0] for number in skipped)


def missing_notes(names: Sequence[str], gaps: Sequence[int], planes: Sequence[object]) -> list[str]:
    """A note on each plane that no photograph shows: where in the order of the `names` it is missing."""
    notes = []
    for skipped, (gap, plane) in enumerate(zip(gaps, planes, strict=True)):
        before = gap - skipped
        where = f"after {names[before - 1]}" if before else f"before {names[0]}"
        notes.append(f"{MISSING}: {plane}, {where}; done without")
    return notes


def missing_as_cause(notes: Sequence[str]) -> str:
    """What to add to a refusal of a set whose notes say that pictures are missing; "" if none is."""
    count = sum(note.startswith(MISSING) for note in notes)
    which = "One picture is" if count == 1 else f"{count} pictures are"
    return f". {which} missing, which may be the cause: take what is missing again" if count else ""
