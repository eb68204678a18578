"""Which photograph belongs to which shot of a plan, by the numbers seen in them and their order."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from procam.model.plan import Plan, Shot

NUMBER = "number"  # of a shot, in its `detail`: what is drawn into its picture
CLIPPED_SHARE = 0.002  # of the frame; above it a photograph is worth less than a softer one
Slot = tuple[str, float]


@dataclass(frozen=True, slots=True)
class PhotoObservation:
    """What a photograph looks like.

    Attributes
    ----------
    name : of the file. number : seen in it. claimed : id of the shot that a person says it shows.
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
    """The photograph (its place in the list) for each shot and exposure [s] of a plan.

    `notes` tell what was left out and what was guessed; `missing` are those without a photograph.
    """

    chosen: dict[Slot, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    missing: list[Slot] = field(default_factory=list)


def match_photos(plan: Plan, looks: Sequence[PhotoObservation], stored: Set[Slot]) -> Match:
    """Match photographs, in the order they were taken, to the shots of a plan.

    A person's word goes before the number seen. A photograph with neither gets the place that its
    neighbours leave, if as many shots are missing between them as there are such photographs. Of
    several of one shot the sharpest is kept, clipped ones last. What is `stored` stays.
    """
    match = Match()
    by_id = {shot.id: i for i, shot in enumerate(plan.shots)}
    by_number = {shot.detail.get(NUMBER): i for i, shot in enumerate(plan.shots)}
    by_number.pop(None, None)
    places: list[int | None] = []
    for look in looks:
        found = by_number.get(look.number) if look.claimed is None else by_id[look.claimed]
        places.append(found)
        if found is None and look.number is not None:
            match.notes.append(
                f"{look.name}: shows number {look.number}, which this plan has not; left out"
            )
        elif found is None and not look.fits:
            match.notes.append(f"{look.name}: is of another size and shows no number; left out")
    guessed = _fill_gaps(plan, looks, places, stored, match.notes)
    for index, shot in enumerate(plan.shots):
        of_shot = [i for i, place in enumerate(places) if place == index] + guessed.get(index, [])
        claimed = [i for i in of_shot if looks[i].claimed is not None]
        match.notes += [
            f"{looks[i].name}: shows {shot.id}, but the index names another for it; left out"
            for i in of_shot
            if claimed and i not in claimed
        ]
        _choose(shot, looks, claimed or of_shot, match)
    _leave_stored(looks, stored, match)
    slots = [(shot.id, e) for shot in plan.shots for e in shot.exposures_s]
    match.missing = [s for s in slots if s not in stored and s not in match.chosen]
    return match


def _fill_gaps(
    plan: Plan,
    looks: Sequence[PhotoObservation],
    places: Sequence[int | None],
    stored: Set[Slot],
    notes: list[str],
) -> dict[int, list[int]]:
    """Photographs by shot that have their place from their neighbours alone."""
    seen = {place for place in places if place is not None}
    guessed: dict[int, list[int]] = {}
    for run, before, after in _unknown_runs(looks, places, len(plan.shots)):
        free = [i for i in range(before + 1, after) if i not in seen]
        slots = [
            i
            for i in free
            for e in plan.shots[i].exposures_s
            if (plan.shots[i].id, e) not in stored
        ]
        names = ", ".join(looks[i].name for i in run)
        if len(slots) != len(run) or before >= after:
            notes.append(
                f"{names}: no number is readable, and {len(slots)} shots fit in between; left out, "
                "name the shots in an index to use them"
            )
            continue
        for photo, slot in zip(run, slots, strict=True):
            guessed.setdefault(slot, []).append(photo)
        shots = ", ".join(plan.shots[i].id for i in dict.fromkeys(slots))
        notes.append(f"{names}: no number is readable; taken as {shots} by the order")
    return guessed


def _unknown_runs(
    looks: Sequence[PhotoObservation], places: Sequence[int | None], count: int
) -> list[tuple[list[int], int, int]]:
    """Photographs in a row without a known shot, and the shots before and after them."""
    runs: list[tuple[list[int], int, int]] = []
    run: list[int] = []
    before = -1
    for i, place in enumerate([*places, count]):
        if place is None:
            if looks[i].number is None and looks[i].fits:
                run.append(i)
            continue
        if run:
            runs.append((run, before, place))
        run, before = [], place
    return runs


def _choose(shot: Shot, looks: Sequence[PhotoObservation], photos: list[int], match: Match) -> None:
    """One photograph for each exposure of a shot."""
    by_exposure = _sorted_by_exposure(shot, looks, photos)
    if by_exposure is None:
        match.notes.append(
            f"{', '.join(looks[i].name for i in photos)}: show {shot.id}, which wants exposures of "
            f"{', '.join(f'{e:g} s' for e in shot.exposures_s)}, and none says its own; left out, "
            "keep the EXIF data or give one photograph for each"
        )
        return
    for exposure_s, candidates in by_exposure.items():
        ranked = sorted(
            candidates, key=lambda i: (looks[i].clipped > CLIPPED_SHARE, -looks[i].sharpness)
        )
        match.chosen[shot.id, exposure_s] = ranked[0]
        match.notes += [
            f"{looks[i].name}: shows {shot.id} too; {looks[ranked[0]].name} is kept, it is "
            + ("sharper" if looks[i].clipped <= CLIPPED_SHARE else "less clipped")
            for i in ranked[1:]
        ]


def _sorted_by_exposure(
    shot: Shot, looks: Sequence[PhotoObservation], photos: list[int]
) -> Mapping[float, list[int]] | None:
    """Photographs by the plan's exposure that theirs is nearest to; None if nothing tells."""
    if not photos:
        return {}
    told = [looks[i].exposure_s for i in photos]
    wanted = np.array(shot.exposures_s)
    if len(wanted) == 1:
        return {shot.exposures_s[0]: photos}
    sorted_out: dict[float, list[int]] = {}
    if None not in told:
        for photo, exposure_s in zip(photos, told, strict=True):
            nearest = int(np.argmin(np.abs(np.log(wanted / float(exposure_s or 1)))))
            sorted_out.setdefault(shot.exposures_s[nearest], []).append(photo)
        return sorted_out
    if len(photos) != len(wanted):
        return None
    return {e: [photo] for e, photo in zip(shot.exposures_s, sorted(photos), strict=True)}


def _leave_stored(looks: Sequence[PhotoObservation], stored: Set[Slot], match: Match) -> None:
    """Forget photographs of what is stored already."""
    for slot in [s for s in match.chosen if s in stored]:
        match.notes.append(f"{looks[match.chosen.pop(slot)].name}: {slot[0]} is stored already")
