"""Instructions that the AVX2 kernels execute per value or pixel, counted by Valgrind: instructions.json.

`python -m benchmarks.instructions` counts them anew (Debian: valgrind); it takes ten minutes. Valgrind
knows no AVX-512.
"""

import json
import re
import subprocess
import sys
from collections.abc import Callable

import numpy as np

from benchmarks import frame, phase, warp
from benchmarks.floor import COUNTED, sources
from procam import kernels
from procam.kernels.frame.api import frame_apply, frame_sums

LEVEL = "avx2"
ROWS = 270  # of the photographs that are searched
Task = tuple[Callable[[], object], float]


def _frame(write: bool) -> Task:
    with kernels.forced("numpy"):
        show = frame.Show.of(4096, True, np.uint8, solved=False)
    model, light = show.equations.model, np.full_like(show.equations.model.lo, 0.02)
    values = float((model.coverage > 0).mean()) * show.out.size

    def run() -> None:
        if write:
            frame_apply(model, show.frames[0], light, show.coding, show.out)
        else:
            frame_sums(model, show.frames[0], light, "light", show.coding)

    return run, values


def _warp() -> Task:
    plan, picture = warp.plan(), warp.master()
    return lambda: kernels.warp_frame(picture, plan), float(np.prod(plan.shape))


def _search() -> Task:
    terms = phase.plan(4)
    stack = phase.waves((ROWS, phase.SHAPE[1]), *terms[:2])
    return lambda: kernels.search_phase(stack, *terms, 3, phase.LENGTH), float(stack[0].size)


PATHS: dict[str, tuple[str, Callable[[], Task]]] = {  # the C function, what is run
    "sums of a frame": ("frame", lambda: _frame(False)),
    "a frame written": ("frame", lambda: _frame(True)),
    "a frame warped": ("warp", _warp),
    "search": ("search", _search),
}


def main(arguments: list[str]) -> None:
    """Count all, or run one under Valgrind, which counts."""
    if arguments:
        run, items = PATHS[arguments[0]][1]()
        print(f"items {items}", flush=True)
        with kernels.forced(LEVEL, 1):
            run()
        return
    found = {}
    for path, (function, _) in PATHS.items():
        tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        command = [*tool, f"--toggle-collect={function}", sys.executable, "-m", __spec__.name, path]
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
        items, count = (
            float(re.findall(pattern, text)[0])
            for pattern, text in ((r"items (\S+)", ran.stdout), (r"Collected : (\d+)", ran.stderr))
        )
        found[path] = round(count / items, 2)
        print(f"{path}: {found[path]} instructions", flush=True)
    document = {"sources": sources(), "instructions": found}
    COUNTED.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
