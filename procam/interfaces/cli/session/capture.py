"""`procam session capture`: one capture session of a venue, or a forecast of how long it takes."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from shlex import quote
from typing import Annotated

import typer

from procam.files.venue.load import Venue, load_venue
from procam.files.venue.tables import BY_HAND
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.model.plan import Shot
from procam.workflows.capture.by_hand import exposed_by_hand
from procam.workflows.capture.newest import capture_newest
from procam.workflows.capture.session_plan import plan_of_session
from procam.workflows.solve.memory import solve_bytes

EXAMPLE = "procam session capture my-dome --dry-run"
DRIVEN_S = 1.0  # beside the exposure: show, settle, read out, store
BY_HAND_S = 5.0  # a DSLR takes 3.5 to 7 s a shot
BYTES = 2  # of a stored sample
DARK = "dark"  # the name of the shot of no projector
Stage = tuple[str, str, int]
FOR_GEOMETRY = ("white", "black", "tags", "code")


def capture(
    venue: VenueArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only print how many shots, minutes and GB.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the patterns and photograph them; a run that was stopped is resumed.

    A lost cable, a full disk or a killed process loses no photograph: run the command again.
    """
    loaded = load_venue(venue)
    if dry_run:
        run_dry(loaded, Output(json))
        return
    output = Output(json, RunLog(venue, "capture"))
    session = output.follow(capture_newest(loaded)).directory
    output.say(f"captured; now run: procam session solve {quote(str(session))}")
    output.finish({"session": str(session)})


@dataclass(frozen=True, slots=True)
class Work:
    """Photographs per camera, time with all cameras one after the other, and size of some shots."""

    shots: int
    exposures: int
    minutes: float
    gigabytes: float


def run_dry(venue: Venue, output: Output) -> None:
    """Print the work per projector and in all, the order of the shots, and what geometry needs."""
    sizes = {name: entry.size for name, entry in venue.table.projectors.items()}
    shots = plan_of_session(venue)[0].shots
    if all(camera.backend == BY_HAND for camera in venue.table.cameras.values()):
        shots = tuple(map(exposed_by_hand, shots))
    each = {name: work(venue, [s for s in shots if s.projector == name]) for name in ("", *sizes)}
    until = max(i for i, shot in enumerate(shots) if shot.purpose in FOR_GEOMETRY) + 1
    geometry, stages = work(venue, shots[:until]), _stages(shots)
    document = _rounded(work(venue, shots))
    output.say(f"{'':16} {'shots':>7} {'exposures':>10} {'minutes':>8} {'GB':>8}")
    for name, part in each.items():
        output.say(_row(name or DARK, part))
    output.say("order:")
    for line in _order(stages):
        output.say(f"  {line}")
    output.say(f"directions can be solved after {geometry.shots} shots, {geometry.minutes:.1f} min")
    memory_gb = round(solve_bytes(venue.cameras.values()) / 1e9, 1)
    output.say(f"to solve it takes {memory_gb} GB of memory")
    output.say(
        "{shots} shots, {exposures} exposures, {minutes} min, {gigabytes} GB".format(**document)
    )
    rounded = {name: _rounded(part) for name, part in each.items()}
    output.finish(
        {
            **document,
            "solve_memory_gb": memory_gb,
            "dark": rounded.pop(""),
            "projectors": rounded,
            "order": [dict(zip(("projector", "purpose", "shots"), s, strict=True)) for s in stages],
            "geometry": _rounded(geometry),
        }
    )


def work(venue: Venue, shots: Sequence[Shot]) -> Work:
    """What some shots take with a venue's cameras."""
    cameras = venue.table.cameras.values()
    seconds = sum(
        photograph_s(venue, camera.backend, exposure_s)
        for camera in cameras
        for shot in shots
        for exposure_s in shot.exposures_s
    )
    pixels = sum(camera.size[0] * camera.size[1] for camera in cameras)
    planes = sum(len(s.exposures_s) * (1 if s.pixel_format == "mono" else 3) for s in shots)
    exposures = sum(len(s.exposures_s) for s in shots)
    return Work(len(shots), exposures, seconds / 60, BYTES * pixels * planes / 1e9)


def photograph_s(venue: Venue, backend: str, exposure_s: float) -> float:
    """From one photograph to the next [s]: shot_s of [capture], else what such cameras take."""
    given = venue.table.capture.shot_s
    if given is not None:
        return max(given, exposure_s)
    needed = exposure_s + DRIVEN_S
    return max(BY_HAND_S, needed) if backend == BY_HAND else needed


def _stages(shots: Iterable[Shot]) -> list[Stage]:
    """Runs of shots of one projector and purpose, in order: (projector, purpose, shots)."""
    runs = groupby(shots, lambda s: (s.projector, s.purpose))
    return [(projector, purpose, len(list(run))) for (projector, purpose), run in runs]


def _order(stages: Iterable[Stage]) -> Iterator[str]:
    """The stages in words; projectors that follow each other alike share a line."""
    runs = [
        (projector, ", ".join(f"{count} {purpose}" for _, purpose, count in run))
        for projector, run in groupby(stages, lambda stage: stage[0])
    ]
    for text, alike in groupby(runs, lambda run: run[1]):
        names = ", then ".join(projector for projector, _ in alike)
        yield f"{names}: {text}" if names else text


def _row(name: str, part: Work) -> str:
    return f"{name:16} {part.shots:7} {part.exposures:10} {part.minutes:8.1f} {part.gigabytes:8.2f}"


def _rounded(part: Work) -> dict[str, float]:
    return {
        **asdict(part),
        "minutes": round(part.minutes, 1),
        "gigabytes": round(part.gigabytes, 2),
    }
