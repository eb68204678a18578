"""Changes of a dome whose bounces are path-traced: are the causes the same as in the simulator's own room?

The scattered light of every photograph, of the calibrated session and of the verifications, is traced by
Mitsuba in a mesh of the room (`simulators.mitsuba_venue`), where `studies.drifts` has flux tracing. Five
kinds of change, three seeds each, and three venues without any. Writes studies/drifts_traced.json and .md;
`python -m studies drifts-traced` remakes them in 80 minutes.
"""

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import simulators.backend
from procam.arrays import Array
from simulators.drifts import draw_drift
from simulators.mitsuba_venue import PathTracedRoom
from simulators.scene import DomeScene
from simulators.surface import Surface
from studies import drifts
from studies.measure import write

NAME = "path-traced, 2 projectors"
KINDS = ("turned", "aged", "defocused", "dust", "floor")
SEEDS = 3
SAMPLES = 1 << 12  # rays from each patch: 1 % of its scattered light, 0.2 % of what is seen
KEPT = 16  # lights whose trace is kept, for whites are photographed twice


class _KeptRoom(PathTracedRoom):
    """A path-traced room that traces each light once."""

    @classmethod
    def of(cls, room: Any, samples: int = SAMPLES, seed: int = 0) -> "_KeptRoom":
        kept = super().of(room, samples, seed)
        assert isinstance(kept, _KeptRoom)
        object.__setattr__(kept, "_traced", {})
        return kept

    def repainted(self, surface: Surface) -> "_KeptRoom":
        return _KeptRoom.of(super().repainted(surface), self.samples, self.seed + 1)

    def irradiance(self, direct_flux: Array) -> Array:
        traced: dict[bytes, Array] = self._traced  # type: ignore[attr-defined]
        key = np.round(direct_flux, 9).tobytes()
        if key not in traced:
            while len(traced) >= KEPT:
                traced.pop(next(iter(traced)))
            traced[key] = super().irradiance(direct_flux)
        return traced[key]


_build = simulators.backend.build_scene


def _traced_scene(settings: Mapping[str, Any], venue_dir: Path) -> DomeScene:
    scene = _build(settings, venue_dir)
    scene.room = _KeptRoom.of(scene.room)
    return scene


def main() -> None:
    """Verify all cases and write studies/drifts_traced.json and .md."""
    start = time.time()
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(simulators.backend, "build_scene", _traced_scene),
        patch.object(drifts, "build_scene", _traced_scene),
    ):
        drifts._venues[NAME] = drifts.make_venue(Path(folder) / "venue", "standard", 2)
        rows = [drifts.run(case) for case in cases()]
    minutes = (time.time() - start) / 60
    write("drifts_traced", {"minutes": round(minutes, 1), "rows": rows}, _table(rows, minutes))


def cases() -> Iterator[drifts.Case]:
    """Each kind with each seed, and as many venues without a change as seeds."""
    projectors = list(drifts._venues[NAME].base.lights)
    for seed in range(SEEDS):
        for kind in KINDS:
            rng = np.random.default_rng([seed, KINDS.index(kind), 7])
            yield drifts.Case(NAME, (draw_drift(kind, rng, projectors),), 1 + seed)
        yield drifts.Case(NAME, (), 10 + seed)


def _table(rows: Sequence[Mapping[str, Any]], minutes: float) -> Iterator[str]:
    yield from ("# Changes of a path-traced dome", "")
    yield f"Scattered light by Mitsuba in every photograph; {len(rows)} verifications, {minutes:.0f} minutes."
    yield from (
        "",
        "| change | size | named | also blamed | found | sigma | true |",
        "|---" * 7 + "|",
    )
    for row in rows:
        drift = row["drifts"][0] if row["drifts"] else {"kind": "none", "size": 0.0}
        others = ", ".join(cause for cause, _ in row["others"])
        named = ("yes" if row["named"] else "NO") if row["drifts"] else ""
        sizes = [f"{e[key]:.4g}" for e in row["errors"] for key in ("size", "sigma", "true")]
        cells = [drift["kind"], f"{drift['size']:.3g}", named, others, *(sizes or ["", "", ""])]
        yield f"| {' | '.join(cells)} |"
