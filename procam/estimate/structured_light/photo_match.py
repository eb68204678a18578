"""Matches photographs to the shots of a plan.

A shot is known from the photographer's index, else from the shot id seen in the photograph. Photographs of
the dark, which cannot show one, are assigned by their order, if exactly as many are missing between their
neighbours; others with neither are so only if asked for, because two that were exchanged look right. For
each shot and exposure the sharpest photograph that is not clipped is chosen.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from procam.model.plan import Plan, Shot

NUMBER = "number"  # key of the shot id in the `detail` of a shot
CLIPPED_SHARE = 0.002  # of the frame: a photograph with more ranks behind a less sharp one
Slot = tuple[str, float]


@dataclass(frozen=True, slots=True)
class PhotoObservation:
    """What was measured on a photograph.

    Attributes
    ----------
    name : of the file. number : shot id seen in it. claimed : shot that the index gives for it.
    exposure_s : shutter time [s]. clipped : share of saturated samples. sharpness : more is better.
    fits : whether it has the size of the camera's pictures.
    """

    name: str
    number: int | None
    claimed: str | None
    exposure_s: float | None
    clipped: float
    sharpness: float
    fits: bool = True


@dataclass
class Match:
    """Index of the photograph for each shot and exposure [s] of a plan.

    `notes` say what was left out and what was assigned by order; `missing` have no photograph.
    """

    chosen: dict[Slot, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    missing: list[Slot] = field(default_factory=list)


def match_photos(
    plan: Plan, photos: Sequence[PhotoObservation], stored: Set[Slot], *, by_order: bool = False
) -> Match:
    """Match photographs, in the order they were taken, to the shots of a plan.

    Shots and exposures that are `stored` already are not matched again. With `by_order` photographs
    without a readable number are assigned by their order.
    """
    match = Match()
    known = _known_shots(plan, photos, match.notes)
    runs = _free_runs(plan, photos, known, stored, match.notes)
    assigned = _assign_by_order(plan, photos, runs, by_order, match.notes)
    for index, shot in enumerate(plan.shots):
        of_shot = [i for i, found in enumerate(known) if found == index] + assigned.get(index, [])
        claimed = [i for i in of_shot if photos[i].claimed is not None]
        match.notes += [
            f"{photos[i].name}: shows {shot.id}, but the index names another for it; left out"
            for i in of_shot
            if claimed and i not in claimed
        ]
        _choose(shot, photos, claimed or of_shot, match)
    for slot in [s for s in match.chosen if s in stored]:
        match.notes.append(f"{photos[match.chosen.pop(slot)].name}: {slot[0]} is stored already")
    slots = [(shot.id, e) for shot in plan.shots for e in shot.exposures_s]
    match.missing = [s for s in slots if s not in stored and s not in match.chosen]
    return match


def _known_shots(
    plan: Plan, photos: Sequence[PhotoObservation], notes: list[str]
) -> list[int | None]:
    """Index of the shot of each photograph from the photographer's index or its shot id."""
    by_id = {shot.id: i for i, shot in enumerate(plan.shots)}
    by_number = {shot.detail.get(NUMBER): i for i, shot in enumerate(plan.shots)}
    by_number.pop(None, None)
    known: list[int | None] = []
    for photo in photos:
        found = by_number.get(photo.number) if photo.claimed is None else by_id[photo.claimed]
        known.append(found)
        if found is None and photo.number is not None:
            notes.append(
                f"{photo.name}: shows number {photo.number}, which is not in this plan; left out"
            )
        elif found is None and not photo.fits:
            notes.append(f"{photo.name}: is of another size and shows no number; left out")
    return known


def _assign_by_order(
    plan: Plan,
    photos: Sequence[PhotoObservation],
    runs: list[tuple[list[int], list[int]]],
    by_order: bool,
    notes: list[str],
) -> dict[int, list[int]]:
    """Photographs by shot that are assigned by their order alone."""
    assigned: dict[int, list[int]] = {}
    for run, slots in runs:
        names = ", ".join(photos[i].name for i in run)
        shots = ", ".join(plan.shots[i].id for i in dict.fromkeys(slots))
        dark = not any(NUMBER in plan.shots[i].detail for i in slots)
        if not dark and not by_order:
            notes.append(
                f"{names}: no number is readable; left out. By their order they show {shots}: if you are "
                "sure, say --by-order, else name them in an index"
            )
            continue
        for photo, slot in zip(run, slots, strict=True):
            assigned.setdefault(slot, []).append(photo)
        notes.append(f"{names}: no number is readable; taken as {shots} by the order")
    return assigned


def _free_runs(
    plan: Plan,
    photos: Sequence[PhotoObservation],
    known: Sequence[int | None],
    stored: Set[Slot],
    notes: list[str],
) -> list[tuple[list[int], list[int]]]:
    """Photographs in a row without a known shot, and as many shots that are free between their neighbours."""
    seen = {index for index in known if index is not None}
    found = []
    for run, before, after in _unknown_runs(photos, known, len(plan.shots)):
        free = [i for i in range(before + 1, after) if i not in seen]
        slots = [
            i
            for i in free
            for e in plan.shots[i].exposures_s
            if (plan.shots[i].id, e) not in stored
        ]
        names = ", ".join(photos[i].name for i in run)
        if len(slots) != len(run) or before >= after:
            notes.append(
                f"{names}: no number is readable, and {len(slots)} shots fit in between; left out, "
                "name the shots in an index to use them"
            )
            continue
        found.append((run, slots))
    return found


def _unknown_runs(
    photos: Sequence[PhotoObservation], known: Sequence[int | None], count: int
) -> list[tuple[list[int], int, int]]:
    """Photographs in a row without a known shot, and the shots before and after them."""
    runs: list[tuple[list[int], int, int]] = []
    run: list[int] = []
    before = -1
    for i, index in enumerate([*known, count]):
        if index is None:
            if photos[i].number is None and photos[i].fits:
                run.append(i)
            continue
        if run:
            runs.append((run, before, index))
        run, before = [], index
    return runs


def _choose(
    shot: Shot, photos: Sequence[PhotoObservation], of_shot: list[int], match: Match
) -> None:
    """Choose one photograph for each exposure of a shot."""
    by_exposure = _sorted_by_exposure(shot, photos, of_shot)
    if by_exposure is None:
        match.notes.append(
            f"{', '.join(photos[i].name for i in of_shot)}: show {shot.id}, which needs exposures of "
            f"{', '.join(f'{e:g} s' for e in shot.exposures_s)}, but their own are not known; left out, "
            "keep the EXIF data or give one photograph for each"
        )
        return
    for exposure_s, candidates in by_exposure.items():
        ranked = sorted(
            candidates, key=lambda i: (photos[i].clipped > CLIPPED_SHARE, -photos[i].sharpness)
        )
        match.chosen[shot.id, exposure_s] = ranked[0]
        match.notes += [
            f"{photos[i].name}: shows {shot.id} too; {photos[ranked[0]].name} is kept, it is "
            + ("sharper" if photos[i].clipped <= CLIPPED_SHARE else "less clipped")
            for i in ranked[1:]
        ]


def _sorted_by_exposure(
    shot: Shot, photos: Sequence[PhotoObservation], of_shot: list[int]
) -> Mapping[float, list[int]] | None:
    """Photographs by the nearest exposure of the plan; None if theirs are not known."""
    if not of_shot:
        return {}
    exposures = [photos[i].exposure_s for i in of_shot]
    planned = np.array(shot.exposures_s)
    if len(planned) == 1:
        return {shot.exposures_s[0]: of_shot}
    if None not in exposures:
        nearest_to: dict[float, list[int]] = {}
        for photo, exposure_s in zip(of_shot, exposures, strict=True):
            nearest = int(np.argmin(np.abs(np.log(planned / float(exposure_s or 1)))))
            nearest_to.setdefault(shot.exposures_s[nearest], []).append(photo)
        return nearest_to
    if len(of_shot) != len(planned):
        return None
    return {e: [photo] for e, photo in zip(shot.exposures_s, sorted(of_shot), strict=True)}
