"""Photographs that are missing from a set: how many may be, and where the numbers in the names skip."""

import re
from collections.abc import Sequence

from procam.estimate.structured_light.consistency import Order

MOST_MISSING = 4  # photographs


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
