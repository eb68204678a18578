"""Run the benchmarks, write results.json and results.md; exit 1 if a ratio falls short by 25 %."""

import json
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks import (
    bundle,
    demo,
    frame,
    gray,
    memory,
    perceptual,
    phase,
    solve,
    start,
    warp,
)
from benchmarks.measure import Goal, Report, as_json
from procam import kernels

HERE = Path(__file__).parent
BENCHES: tuple[Callable[[], Report], ...] = (
    solve.bench,
    gray.bench,
    lambda: phase.bench_search(4),
    lambda: phase.bench_search(5),
    phase.bench_growth,
    bundle.bench,
    bundle.bench_growth,
    warp.bench,
    lambda: frame.bench_codes(4096),
    lambda: frame.bench_codes(8192),
    frame.bench_light,
    perceptual.bench,
    start.bench,
    memory.bench,
    demo.bench,
)


def machine() -> str:
    """Processor, kernel level, versions."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    model = f"{len(models)} x {models[0]}" if models else platform.machine()
    versions = f"NumPy {np.__version__}, OpenCV {cv2.__version__}"
    return f"{model}, kernels {kernels.active()}, {versions}"


def verdict(goal: Goal) -> str:
    """Words for a goal."""
    return "met" if goal.met else "within slack" if goal.passed else "FAIL"


def table(reports: list[Report]) -> Iterator[str]:
    """The results as Markdown."""
    yield "# Benchmarks"
    yield ""
    yield f"`make bench` on {machine()}. Runs take turns in one process; medians. Speed-ups over peers"
    yield "are of wall time with all cores (the peers use one unless NumPy threads), ratios to the floor of"
    yield "CPU time summed over threads; a ratio 25 % short of its goal fails."
    for report in reports:
        yield from ("", f"## {report.title}", "")
        yield from ("| run | core-ms | wall ms | rounds |", "|---|---|---|---|")
        for name, t in report.times.items():
            rounds = f"{t.rounds}" if t.scale == 1 else f"1, x {t.scale:.0f}"
            yield f"| {name} | {t.cpu_s * 1e3:.1f} | {t.wall_s * 1e3:.1f} | {rounds} |"
        yield from ("", "| asked | got | goal | |", "|---|---|---|---|")
        for goal in report.goals:
            got, limit = f"{goal.value:.3g} {goal.unit}", f"{goal.sign} {goal.limit:g} {goal.unit}"
            yield f"| {goal.what} | {got} | {limit} | {verdict(goal)} |"
        if report.notes:
            yield from ("", "; ".join(report.notes) + ".")


def main() -> int:
    """Run everything."""
    cv2.setNumThreads(1)
    reports = []
    for bench in BENCHES:
        reports.append(bench())
        print(f"{reports[-1].title}", flush=True)
        for name, t in reports[-1].times.items():
            print(f"    {name:24s}{t.cpu_s * 1e3:10.1f} core-ms {t.wall_s * 1e3:10.1f} ms wall")
        for goal in reports[-1].goals:
            print(
                f"  {goal.what}: {goal.value:.3g} {goal.unit} ({goal.sign} {goal.limit:g}) {verdict(goal)}"
            )
    document = {"machine": machine(), "reports": [as_json(report) for report in reports]}
    (HERE / "results.json").write_text(json.dumps(document, indent=1) + "\n")
    (HERE / "results.md").write_text("\n".join(table(reports)) + "\n")
    return int(not all(goal.passed for report in reports for goal in report.goals))


if __name__ == "__main__":
    sys.exit(main())
