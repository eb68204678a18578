"""Venues that changed after they were calibrated: are the causes named, and do the intervals cover?

Simulated domes of 2 to 4 projectors are calibrated once. Then each of 21 kinds of change, drawn in size,
place and projector, is verified with photographs of its own noise; so are pairs of changes, and venues
without any. Writes studies/drifts.json and studies/drifts.md; `python -m studies drifts` remakes them in an
hour on two idle cores. tests/workflow/test_drifts_small.py has a part of it.
"""

import json
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from procam.devices.protocols import Power
from procam.devices.rig import Rig
from procam.estimate.drift.changes import VenueChange, find_changes
from procam.estimate.drift.dome_change import Dust
from procam.estimate.drift.findings import Finding, name_causes
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.files.versions import calibration_in_use
from procam.generators import result_of
from procam.maths.geometry.lenses import project
from procam.workflows.capture.newest import capture_newest
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.solve.calibrate import solve
from procam.workflows.verify.photographs import read_reference, take_photographs
from simulators.backend import build_scene
from simulators.devices import SimulatedCamera, SimulatedProjector
from simulators.drifts import KINDS, Drift, draw_drift, drifted
from simulators.projector_state import ProjectorState
from simulators.scene import DomeScene, SceneSize
from simulators.template import venue_text
from studies.measure import write

SEEDS, PAIRS, UNDRIFTED = 100, 200, 300
SETTLE_S = 1.5
WORKERS = 2
SIZE = SceneSize(projectors=6, projector_size=(320, 200), camera_size=(480, 480), rays=512)
VENUES: Mapping[str, tuple[str, int]] = {
    "standard, 4 projectors": ("standard", 4),
    "realistic, 3 projectors": ("realistic", 3),
    "standard, 2 projectors": ("standard", 2),
}
CAUSES = {
    **dict.fromkeys(("turned", "shifted", "zoomed"), "moved"),
    **dict.fromkeys(("keystone", "mirrored", "overscan"), "picture setting"),
    "defocused": "focus",
    "aged": "light",
    "colour-aged": "colour",
    "gamma": "gamma setting",
    "raised-black": "black level",
    "dynamic-black": "dynamic setting",
    "dead-channel": "dead channel",
    "no-picture": "no picture",
    "warming": "warming up",
    "dust": "dust",
    "stain": "stain",
    "floor": "floor or audience",
    "ambient": "ambient light",
    "camera-moved": "camera moved",
    "aperture": "camera exposure",
}
AS_DRAWN: Mapping[str, Callable[[float], float]] = {
    "defocused": lambda size: size**2,
    **dict.fromkeys(("aged", "colour-aged"), lambda size: -size),
    **dict.fromkeys(("aperture", "camera-moved", "stain"), lambda size: size),
}
BLIND = ("no-picture", "mirrored", "dead-channel")  # hide what else a projector has
assert set(CAUSES) == set(KINDS)


class _Switch:
    """Lamp and shutter of a simulated projector, without the serial line that other tests are of."""

    def __init__(self, state: ProjectorState, clock: Any) -> None:
        self._state, self._clock = state, clock

    def state(self) -> ProjectorState:
        return self._state

    def set_power(self, on: bool) -> None:
        if on and self._state.power is Power.STANDBY:
            self._state.switch_on()
        while on and self._state.power is not Power.ON:
            self._clock.sleep(1.0)

    def set_shutter(self, closed: bool) -> None:
        self._state.set_muted(closed)

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class DriftVenue:
    """A calibrated venue, and what it takes to verify it after a change."""

    directory: Path

    @cached_property
    def base(self) -> DomeScene:
        """The scene as it was calibrated, with the cameras' sight lines."""
        scene = build_scene(load_venue(self.directory).backends["simulated"], self.directory)
        for name in scene.cameras:
            scene.sight_lines(name)
        return scene

    @cached_property
    def calibration(self) -> Any:
        return load_calibration(calibration_in_use(self.directory))

    @cached_property
    def reference(self) -> Any:
        return read_reference(load_venue(self.directory), self.calibration)

    def verified(
        self, drifts: Sequence[Drift], session: int
    ) -> tuple[DomeScene, VenueChange, list[Finding]]:
        """The drifted scene, what changed by its photographs, and the causes."""
        scene = drifted(self.base, drifts, session)
        switches: Any = {n: _Switch(state, scene.clock) for n, state in scene.states.items()}
        rig = Rig(
            {n: SimulatedCamera(scene, n) for n in scene.cameras},
            {n: SimulatedProjector(scene, n) for n in scene.lights},
            switches,
            scene.clock,
            (),
        )
        photographer = DrivenPhotographer(rig, self.calibration, SETTLE_S)
        *_, (_, now) = take_photographs(photographer, self.reference)
        levels = {n: p["levels"] for n, p in self.reference.pictures.items()}
        change = find_changes(self.calibration, self.reference.photographs, now, levels)
        return scene, change, name_causes(self.calibration, change)


def make_venue(directory: Path, preset: str, projectors: int) -> DriftVenue:
    """Capture and calibrate a simulated venue."""
    directory.mkdir(parents=True, exist_ok=True)
    text = venue_text(preset, replace(SIZE, projectors=projectors))  # type: ignore[arg-type]
    (directory / "venue.toml").write_text(text, "utf-8")
    venue = load_venue(directory)
    result_of(solve(venue, result_of(capture_newest(venue))))
    return DriftVenue(directory)


def expected(drift: Drift, venue: DriftVenue) -> tuple[str, str]:
    """Cause and subject that a drift should be named by."""
    camera = next(iter(venue.base.cameras)) if drift.kind in ("camera-moved", "aperture") else ""
    return CAUSES[drift.kind], drift.projector or camera


def true_size(
    drift: Drift, venue: DriftVenue, scene: DomeScene, change: VenueChange
) -> float | None:
    """What the size of the finding should be; None where it has none, or is not defined by the drift."""
    base, name = venue.base, drift.projector
    if drift.kind in AS_DRAWN:
        return AS_DRAWN[drift.kind](drift.size)
    if drift.kind in ("turned", "shifted", "zoomed"):
        return _true_motion(base, scene, name, venue)
    if drift.kind == "dynamic-black":
        return -drift.size * (1 - float(venue.reference.pictures[name]["levels"].mean()))
    if drift.kind == "ambient":
        light = drift.size * base.preset.brightness * base.preset.albedo
        return float((venue.calibration.content_from_camera @ np.full(3, light)).mean())
    if drift.kind == "dust" and change.dome.dust:
        return _true_dust(base, scene, change.dome.dust)
    truth = {"gamma": _true_exponent, "raised-black": _true_black, "floor": _true_scatter}
    return truth[drift.kind](base, scene, name) - 1 if drift.kind in truth else None


def _true_motion(base: DomeScene, scene: DomeScene, name: str, venue: DriftVenue) -> float:
    """Root mean square distance [px] of the panel's pixels from where they landed before."""
    before, now = base.lights[name], scene.lights[name]
    points = scene.surface.radius(now.direction)[..., None] * now.direction
    place = project(before.build.projector_from_dome.apply(points), before.build.lens)
    height, width = before.lit.shape
    away = place - np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1)
    valid = venue.calibration.projectors[name].surface.valid & now.lit & before.lit
    return float(np.sqrt(np.mean(np.sum(away[valid] ** 2, axis=-1))))


def _true_exponent(base: DomeScene, scene: DomeScene, name: str) -> float:
    """Ratio of the logs of the two responses, a mean over drives."""
    drive = np.linspace(0.1, 0.95, 18)
    old, new = (s.lights[name].build.response(drive) for s in (base, scene))
    return float(np.mean(np.log(new) / np.log(old)))


def _true_black(base: DomeScene, scene: DomeScene, name: str) -> float:
    """Black over white, each a mean over the panel's pixels, relative to before."""
    shares = []
    for s in (base, scene):
        light = s.lights[name]
        black, white = (
            light.emit(np.full((*light.lit.shape, 3), level, np.float32), slice(0, 3))[
                light.lit
            ].sum()
            for level in (0.0, 1.0)
        )
        shares.append(black / (white - black))
    return float(shares[1] / shares[0])


def _true_scatter(base: DomeScene, scene: DomeScene, _: str) -> float:
    """Scattered light on the screen at full white, over that before."""
    levels = []
    for s in (base, scene):
        drives = {n: np.ones((*light.lit.shape, 3), np.float32) for n, light in s.lights.items()}
        lines = s.sight_lines(next(iter(s.cameras)))
        _, scattered = s.parts_of_drives(
            lines, drives, dict.fromkeys(drives, 1.0), slice(1, 2), 0.5
        )
        levels.append(float(np.nanmean(scattered)))
    return levels[1] / levels[0]


def _true_dust(base: DomeScene, scene: DomeScene, dust: Dust) -> float:
    """Loss of albedo where it was found, where the cleanest lit place lost nothing."""
    lit = np.concatenate([light.direction[light.lit][::97] for light in base.lights.values()])
    clean = (scene.surface.albedo(lit) / base.surface.albedo(lit)).max()
    there = np.asarray(dust.direction, float)[None]
    return float(1 - (scene.surface.albedo(there) / base.surface.albedo(there))[0] / clean)


@dataclass(frozen=True)
class Case:
    """A verification to make: of which venue, after which changes."""

    venue: str
    drifts: tuple[Drift, ...]
    session: int


_venues: dict[str, DriftVenue] = {}  # of this process and its children


def run(case: Case) -> dict[str, Any]:
    """Verify; what was named, what should have been, and errors of sizes in sigmas."""
    venue = _venues[case.venue]
    start = time.perf_counter()
    scene, change, findings = venue.verified(case.drifts, case.session)
    named = {(f.cause, f.subject): f for f in findings}
    wanted = [expected(drift, venue) for drift in case.drifts]
    errors = []
    for drift, key in zip(case.drifts, wanted, strict=True):
        truth = true_size(drift, venue, scene, change) if key in named else None
        if truth is not None and len(case.drifts) == 1:
            errors.append({"size": named[key].size, "sigma": named[key].sigma, "true": truth})
    return {
        "venue": case.venue,
        "drifts": [asdict(drift) for drift in case.drifts],
        "session": case.session,
        "named": all(key in named for key in wanted),
        "others": [[*key] for key in named if key not in wanted],
        "errors": errors,
        "seconds": round(time.perf_counter() - start, 2),
    }


def cases(seeds: int, pairs: int, undrifted: int) -> Iterator[Case]:
    """All verifications of the study, alternating between venues."""
    names, session = list(VENUES), 1
    for seed in range(seeds):
        for kind in KINDS:
            rng = np.random.default_rng([seed, KINDS.index(kind)])
            venue = names[(seed + KINDS.index(kind)) % len(names)]
            yield Case(venue, (draw_drift(kind, rng, list(_venues[venue].base.lights)),), session)
            session += 1
    for seed in range(pairs):
        rng = np.random.default_rng([seed, 999])
        venue = names[seed % len(names)]
        yield Case(venue, _pair(rng, list(_venues[venue].base.lights)), session)
        session += 1
    for seed in range(undrifted):
        yield Case(names[seed % len(names)], (), session)
        session += 1


def _pair(rng: np.random.Generator, projectors: list[str]) -> tuple[Drift, Drift]:
    """Two changes of different kinds; none on a projector that shows nothing, or nothing straight."""
    while True:
        kinds = rng.choice(KINDS, 2, replace=False)
        first, second = (draw_drift(str(kind), rng, projectors) for kind in kinds)
        same = first.projector and first.projector == second.projector
        if not (same and (set(kinds) & set(BLIND) or CAUSES[kinds[0]] == CAUSES[kinds[1]])):
            return first, second


def main() -> None:
    """Verify all cases and write studies/drifts.json and .md."""
    start = time.time()
    with tempfile.TemporaryDirectory() as folder:
        for name, (preset, projectors) in VENUES.items():
            _venues[name] = make_venue(Path(folder) / name.replace(" ", "-"), preset, projectors)
            _ = _venues[name].base, _venues[name].calibration, _venues[name].reference
        todo = list(cases(SEEDS, PAIRS, UNDRIFTED))
        with ProcessPoolExecutor(WORKERS, get_context("fork")) as pool:
            rows = []
            for row in pool.map(run, todo, chunksize=8):
                rows.append(row)
                print(json.dumps(row), flush=True)
    hours = (time.time() - start) / 3600
    write("drifts", {"hours": round(hours, 2), "rows": rows}, table(rows, hours))


def table(rows: Sequence[Mapping[str, Any]], hours: float) -> Iterator[str]:
    """The results as Markdown."""
    alone = [row for row in rows if len(row["drifts"]) == 1]
    pairs = [row for row in rows if len(row["drifts"]) == 2]
    still = [row for row in rows if not row["drifts"]]
    errors = [(e["size"] - e["true"]) / e["sigma"] for row in alone for e in row["errors"]]
    inside = np.abs(errors) < 1.96
    yield from ("# Venues that changed after they were calibrated", "")
    yield (
        f"{len(alone)} single changes, {len(pairs)} pairs and {len(still)} venues without a change, "
        f"{hours:.1f} hours. Causes named alone: {_share(alone, 'named')}, and nothing else blamed: "
        f"{_exactly(alone)}. In pairs both named: {_share(pairs, 'named')}, and nothing else: "
        f"{_exactly(pairs)}. False alarms without a change: {sum(bool(row['others']) for row in still)} of "
        f"{len(still)}. Intervals of 95 %: {np.mean(inside):.1%} of {len(errors)} cover the truth."
    )
    head = ("change", "runs", "named", "and nothing else", "intervals that cover", "also blamed")
    yield from ("", f"| {' | '.join(head)} |", "|---" * len(head) + "|")
    for kind in KINDS:
        of = [row for row in alone if row["drifts"][0]["kind"] == kind]
        own = [abs(e["size"] - e["true"]) < 1.96 * e["sigma"] for row in of for e in row["errors"]]
        others = Counter(cause for row in of for cause, _ in row["others"])
        also = ", ".join(f"{cause} {count}" for cause, count in others.most_common(3))
        cover = f"{np.mean(own):.0%} of {len(own)}" if own else ""
        yield f"| {kind} | {len(of)} | {_share(of, 'named')} | {_exactly(of)} | {cover} | {also} |"
    yield from ("", "| venue | runs | named | and nothing else |", "|---|---|---|---|")
    for venue in VENUES:
        of = [row for row in rows if row["venue"] == venue]
        yield f"| {venue} | {len(of)} | {_share(of, 'named')} | {_exactly(of)} |"


def _share(rows: Sequence[Mapping[str, Any]], key: str) -> str:
    return f"{np.mean([row[key] for row in rows]):.1%}" if rows else "-"


def _exactly(rows: Sequence[Mapping[str, Any]]) -> str:
    return f"{np.mean([row['named'] and not row['others'] for row in rows]):.1%}" if rows else "-"
