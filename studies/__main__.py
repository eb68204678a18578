"""Run studies and write their results beside them (JSON and a table).

All of them, or those that are named: python -m studies codes code-table
"""

import sys

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
    recalibration,
    refine,
    rooms,
    stops,
    two_at_once,
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
    "recalibration": recalibration.main,
    "refine": refine.main,
    "rooms": rooms.main,
    "stops": stops.main,
    "two-at-once": two_at_once.main,
    "wrong-calls": wrong_calls.main,
}


def main(names: list[str]) -> int:
    """Run the named studies, or all; 2 for a name that is none."""
    unknown = [name for name in names if name not in STUDIES]
    if unknown:
        print(f"studies: no study {unknown[0]!r}; there are {', '.join(STUDIES)}", file=sys.stderr)
        return 2
    for name in names or STUDIES:
        print(f"== {name}", flush=True)
        STUDIES[name]()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
