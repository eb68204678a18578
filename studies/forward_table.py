"""The table of the study `forward`, from its JSON file: marks misses, and prints nothing below resolution."""

from collections.abc import Iterator

import numpy as np

MISS, OPEN = " (miss)", " (open)"
GOALS = {  # kind of room: forms with a goal, largest relative error
    "bare": (("closed form, all that reflects", "chosen by held-out zones"), 0.005),
    "furnished": (("chosen by held-out zones",), 0.02),
    "mesh": (("form factors",), 0.02),
}
Figures = dict[str, float]


def cell(error: Figures, resolution: Figures, goal: float | None = None) -> str:
    """Worst and mean error of several pictures [%], with a mark.

    A figure below its resolution is printed as "< resolution". A miss is a resolved error above the goal in
    any picture; the cell is open if there is none, but a picture's resolution is coarser than the goal.
    """
    value = {n: max(e, resolution[n]) for n, e in error.items()}
    seen = {n: e for n, e in error.items() if e >= resolution[n]}
    worst = max(value, key=value.__getitem__)
    mark = ""
    if goal is not None and max(seen.values(), default=0.0) > goal:
        worst, mark = max(seen, key=seen.__getitem__), MISS
    elif goal is not None and value[worst] > goal:
        mark = OPEN
    of_all = [np.mean(list(v.values())) for v in (error, resolution)]
    return f"{_text(error[worst], resolution[worst])}, {_text(*of_all)}{mark}"


def _text(error: float, resolution: float) -> str:
    below = error < resolution
    return f"< {100 * resolution:.2g}" if below else f"{100 * error:.2f}"


def table(document: dict) -> Iterator[str]:
    """Lines of Markdown of all rooms, with a count of the cells that miss their goals."""
    rows = document["rows"]
    domes, meshes = ([r for r in rows if (r["kind"] == "mesh") == mesh] for mesh in (False, True))
    yield from _opening(document)
    tables = [*_table(domes), "", *_table(meshes)]
    yield from tables
    text = "".join(tables)
    yield from (
        "",
        "Goals of the worst picture [%]: 0.5 on bare domes, by the closed form of all that reflects and by "
        "the form chosen; 2 on furnished domes, by the form chosen; 2 on meshes. Other columns have none.",
        "",
        f"{text.count(MISS)} of {_judged(rows)} figures with a goal miss it; {text.count(OPEN)} are open (no "
        "miss is resolved, but the resolution is coarser than the goal).",
    )


def _opening(document: dict) -> Iterator[str]:
    rings, sectors = document["patches"]
    yield from (
        "# Forward models of scattered light against path tracing",
        "",
        "Root mean square of predicted less traced light, over the lit patches, relative to the mean of the "
        "traced; the noise of the tracer and of the fits is subtracted. Worst and mean of "
        f"{len(document['pictures'])} pictures: {', '.join(document['pictures'])}; three on meshes. "
        f"{rings} x {sectors} patches, {document['samples']} rays from each. A figure after < is below its "
        "resolution: the root of two standard errors of the mean square.",
        "",
        "Noise: the tracer's standard error, worst picture. z: error of the closed form in standard errors "
        "(rms, worst picture); about 1.2 where the form is exact and the standard errors, from eight "
        "batches, are right. Measured forms are fitted to white, or to white on each of twelve zones, "
        "traced with other rays; the last is what calibrations do.",
        "",
    )


def _table(rows: list[dict]) -> Iterator[str]:
    forms = list(rows[0]["error"])
    head = ["room", "noise [%]", *["z"] * ("z" in rows[0]), *(f"{name} [%]" for name in forms)]
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for row in rows:
        cells = [_room(row), f"{100 * max(row['noise'].values()):.2f}"]
        cells += [f"{max(row['z'].values()):.2f}"] if "z" in row else []
        cells += [cell(row["error"][f], row["resolution"][f], _goal(row, f)) for f in forms]
        yield f"| {' | '.join(cells)} |"


def _room(row: dict) -> str:
    return row["room"] if row["kind"] == "mesh" else f"{row['kind']}, {row['room']}"


def _goal(row: dict, form: str) -> float | None:
    forms, goal = GOALS[row["kind"]]
    return goal if form in forms else None


def _judged(rows: list[dict]) -> int:
    return sum(_goal(row, form) is not None for row in rows for form in row["error"])
