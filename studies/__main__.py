"""Run studies and write their results beside them (JSON and a table).

All of them, or those that are named: python -m studies codes code-table. --list says what there is.
"""

import inspect
import sys
import traceback
from collections.abc import Callable, Iterator

import benchmarks.__main__
from studies import (
    boards,
    by_hand,
    code_table,
    codes,
    content,
    drifts,
    drifts_traced,
    foreign_codes,
    foreign_dome,
    foreign_responses,
    forward,
    full_disk,
    fuzz,
    geometry,
    history,
    loop,
    mistakes,
    one_fringe,
    perceptual,
    perceptual_dome,
    photometry,
    precision,
    readme,
    recalibration,
    refine,
    rooms,
    stops,
    two_at_once,
    unattended,
    wrong_calls,
)

STUDIES = {
    "boards": boards.main,
    "by-hand": by_hand.main,
    "codes": codes.main,
    "foreign-codes": foreign_codes.main,
    "one-fringe": one_fringe.main,
    "code-table": code_table.main,
    "geometry": geometry.main,
    "history": history.main,
    "foreign-dome": foreign_dome.main,
    "foreign-responses": foreign_responses.main,
    "forward": forward.main,
    "full-disk": full_disk.main,
    "fuzz": fuzz.main,
    "perceptual": perceptual.main,
    "perceptual-dome": perceptual_dome.main,
    "photometry": photometry.main,
    "loop": loop.main,
    "mistakes": mistakes.main,
    "content": content.main,
    "drifts": drifts.main,
    "drifts-traced": drifts_traced.main,
    "precision": precision.main,
    "readme": readme.main,
    "recalibration": recalibration.main,
    "refine": refine.main,
    "rooms": rooms.main,
    "speed": benchmarks.__main__.main,
    "stops": stops.main,
    "two-at-once": two_at_once.main,
    "unattended": unattended.main,
    "wrong-calls": wrong_calls.main,
}


def main(names: list[str]) -> int:
    """Run the named studies, or all, or list them; 1 for one that failed, 2 for a name that is none."""
    if names == ["--list"]:
        print("\n".join(listed()))
        return 0
    unknown = [name for name in names if name not in STUDIES]
    if unknown:
        print(f"studies: no study {unknown[0]!r}; there are {', '.join(STUDIES)}", file=sys.stderr)
        return 2
    failed = False
    for name in names or STUDIES:
        print(f"== {name}", flush=True)
        failed |= _fails(STUDIES[name])
    return int(failed)


def _fails(run: Callable[[], int | None]) -> bool:
    """Whether a study fails; what it raises is printed, and the next one begins."""
    try:
        return bool(run())
    except Exception:
        traceback.print_exc()
        return True


def listed() -> Iterator[str]:
    """A line for each study: its name and what it is about."""
    wide = max(map(len, STUDIES))
    for name, run in sorted(STUDIES.items()):
        about = inspect.getdoc(inspect.getmodule(run)) or ""
        yield f"{name:{wide}}  {about.splitlines()[0]}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
