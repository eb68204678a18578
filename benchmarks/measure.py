"""Runs taken in turns in one process, and what their times are asked to be."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from procam import kernels

SLACK = 0.75  # a ratio may fall 25 % short before it fails
ROUNDS = 7

Run = Callable[[], object]


@dataclass(frozen=True)
class Times:
    """Medians over the rounds, and the best wall time [s]; `scale` is 1 unless extrapolated."""

    cpu_s: float
    wall_s: float
    best_wall_s: float
    rounds: int
    scale: float = 1.0


@dataclass(frozen=True)
class Goal:
    """`value` (a ratio of times unless `unit` says else) must be >= or <= `limit`."""

    what: str
    value: float
    sign: str
    limit: float
    unit: str = "x"

    @property
    def met(self) -> bool:
        """Whether the value is within the limit."""
        return self.value >= self.limit if self.sign == ">=" else self.value <= self.limit

    @property
    def passed(self) -> bool:
        """Met, or short of it by less than a quarter."""
        if self.sign == ">=":
            return self.value >= SLACK * self.limit
        return self.value <= self.limit / SLACK


@dataclass(frozen=True)
class Report:
    """One benchmark: what was run, how long each run took, what was asked."""

    title: str
    times: dict[str, Times]
    goals: tuple[Goal, ...]
    notes: tuple[str, ...] = field(default=())


def at_levels(name: str, run: Run) -> dict[str, Run]:
    """A run at each level of the kernels that this processor has, by name: "kernel, avx2"."""

    def at(level: str) -> Run:
        def forced() -> None:
            with kernels.forced(level):
                run()

        return forced

    compiled = [level for level in kernels.available() if level != "numpy"]
    return {f"{name}, {level}": at(level) for level in compiled}


def over_floor(
    times: dict[str, Times], name: str, floor: str, limits: Mapping[str, float]
) -> tuple[Goal, ...]:
    """CPU time of each level over the floor: goals where `limits` has one for the level."""
    levels = [level for level in limits if f"{name}, {level}" in times]
    return tuple(at_most(times, f"{name}, {level}", floor, limits[level]) for level in levels)


def between_levels(times: dict[str, Times], name: str, limit: float) -> tuple[Goal, ...]:
    """CPU time at AVX2 over that at AVX-512, where the processor has both."""
    both = f"{name}, avx2", f"{name}, avx512"
    return (at_most(times, *both, limit),) if both[1] in times else ()


def interleaved(
    runs: Mapping[str, Run],
    slow: Mapping[str, tuple[Run, float]] | None = None,
    rounds: int = ROUNDS,
) -> dict[str, Times]:
    """Times of each run, taken in turns so that all see the same machine.

    `slow` runs are taken once, on a part of the work, and multiplied by their factor.
    """
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    for run in runs.values():
        run()  # pages, tables and threads are there before the clock starts
    for _ in range(rounds):
        for name, run in runs.items():
            spent[name].append(_timed(run))
    found = {}
    for name, pairs in spent.items():
        cpu, wall = np.median(pairs, axis=0)
        found[name] = Times(float(cpu), float(wall), float(np.min(pairs, axis=0)[1]), rounds)
    for name, (run, scale) in (slow or {}).items():
        cpu, wall = (scale * t for t in _timed(run))
        found[name] = Times(cpu, wall, wall, 1, scale)
    return found


def _timed(run: Run) -> tuple[float, float]:
    cpu, wall = time.process_time(), time.perf_counter()
    run()
    return time.process_time() - cpu, time.perf_counter() - wall


def at_least(times: dict[str, Times], ours: str, peer: str, limit: float) -> Goal:
    """`ours` so many times faster than `peer` by the clock on the wall, both cores at work."""
    ratio = times[peer].wall_s / max(times[ours].wall_s, 1e-9)
    return Goal(f"{ours} against {peer}", ratio, ">=", limit)


def at_most(times: dict[str, Times], ours: str, floor: str, limit: float) -> Goal:
    """`ours` within so many times the floor, in CPU time summed over threads."""
    ratio = times[ours].cpu_s / max(times[floor].cpu_s, 1e-9)
    return Goal(f"{ours} over {floor}", ratio, "<=", limit)


def as_json(report: Report) -> dict[str, Any]:
    """The report as plain numbers."""
    return {
        "title": report.title,
        "times": {
            name: {
                "cpu_ms": round(t.cpu_s * 1e3, 3),
                "wall_ms": round(t.wall_s * 1e3, 3),
                "best_wall_ms": round(t.best_wall_s * 1e3, 3),
                "rounds": t.rounds,
                "extrapolated_by": round(t.scale, 1),
            }
            for name, t in report.times.items()
        },
        "goals": [
            {
                "what": goal.what,
                "value": round(goal.value, 3),
                "goal": {"op": goal.sign, "value": goal.limit},
                "unit": goal.unit,
                "met": goal.met,
                "pass": goal.passed,
            }
            for goal in report.goals
        ],
        "notes": list(report.notes),
    }
