"""Do the figures and their intervals hold over seeds? A small standard venue, solved again and again.

Writes studies/seeds.json and studies/seeds.md. `python -m studies seeds` remakes them.
"""

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from procam.files.venue import load_venue
from procam.interfaces.judge import judge
from procam.workflows.calibrate import solve
from procam.workflows.capture import capture, prepare_session
from procam.workflows.venue_rig import open_rig
from simulators.scene import SceneSize
from simulators.template import venue_text
from simulators.truth import write_truth

SEEDS = range(1, 13)
SIZE = SceneSize(projector_size=(640, 400), camera_size=(800, 800), rays=512)
FIGURES = (
    "direction_error_rms_arcmin",
    "solid_angle_sum_error",
    "feedback_error",
    "feedback_interval_covers",
    "albedo_error",
    "albedo_interval_covers",
)


def tell_truth(folder: Path, size: SceneSize = SIZE) -> Path:
    """The truth, which all seeds share: a seed draws the noise, not the dome."""
    (folder / "venue.toml").write_text(venue_text("standard", size))
    settings = load_venue(folder).backends["simulated"]
    write_truth(settings, folder, folder / "truth", {})
    return folder / "truth"


def run_seed(
    seed: int, folder: Path, truth: Path, size: SceneSize = SIZE
) -> dict[str, float | bool]:
    """Figures of one seed: capture, solve, judge."""
    (folder / "venue.toml").write_text(venue_text("standard", size, seed))
    venue = load_venue(folder)
    with open_rig(venue) as rig:
        session = prepare_session(venue, folder / "sessions" / "0001")
        for _ in capture(rig, venue, session):
            pass
    *_, last = solve(venue, session)
    figures = judge(Path(last.data["calibration"]), truth)
    return {name: figures[name].value for name in FIGURES}  # type: ignore[misc]


def table(rows: list[dict[str, float | bool]]) -> Iterator[str]:
    """Markdown lines: mean, spread and worst of every figure, share of intervals that cover."""
    yield "| figure | mean | standard deviation | worst |"
    yield "|---|---|---|---|"
    for name in FIGURES:
        values = np.array([row[name] for row in rows], float)
        if name.endswith("covers"):
            yield f"| `{name}` | {values.sum():.0f} of {len(values)} | | |"
        else:
            worst = values[np.argmax(np.abs(values))]
            yield f"| `{name}` | {values.mean():.3g} | {values.std(ddof=1):.2g} | {worst:.3g} |"


def main() -> int:
    """Run all seeds and write the results."""
    rows = []
    with tempfile.TemporaryDirectory() as shared:
        truth = tell_truth(Path(shared))
        for seed in SEEDS:
            with tempfile.TemporaryDirectory() as folder:
                rows.append({"seed": seed, **run_seed(seed, Path(folder), truth)})
            print(rows[-1])
    here = Path(__file__).parent
    document = {"command": "python -m studies seeds", "size": SIZE.projector_size, "rows": rows}
    (here / "seeds.json").write_text(json.dumps(document, indent=1) + "\n")
    title = "# Standard preset over noise seeds, 640x400 projectors, 800x800 camera\n"
    (here / "seeds.md").write_text(
        "\n".join([title, *table(rows), "", "`python -m studies seeds`", ""])
    )
    return 0
