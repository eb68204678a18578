"""Mistakes of people and devices that leave photographs which look sound: what is noticed, what is wrong.

Nine rooms drawn at random and the standard venue are calibrated without a mistake and with each of
`simulators.mistakes` at three strengths. A mistake is noticed if procam refuses the session, or says
something of it that it does not say of the same room without one. A result is wrong if it misses a bound of
`figures` that the same room meets without the mistake. Then each is verified after mistakes with one
projector that were made since. Mistakes before other commands are drawn by
`python -m studies.mistakes SEED RUNS [COMMAND ...]`, which prints what comes of each. Writes
studies/mistakes.json and studies/mistakes.md; `python -m studies mistakes` remakes them in three hours.
"""

import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import simulators.backend
import simulators.truth
from procam.arrays import Array, Image
from procam.devices.protocols import BackendRig
from procam.devices.rig import Rig
from procam.errors import ProcamError
from procam.files.calibration import load_calibration
from procam.files.venue.load import Venue, load_venue
from procam.files.versions import calibration_in_use, use_calibration
from procam.generators import result_of
from procam.maths.warp import block_mean
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.recalibrate.recalibrate import recalibrate
from procam.workflows.solve.calibrate import solve
from procam.workflows.venue_rig import open_rig
from procam.workflows.verify.verify import SETTLE_S, Verified, verify
from simulators.mistakes import (
    LATER_STRENGTHS,
    SETTING_MISTAKES,
    STRENGTHS,
    cropped_pixel,
    make_later_mistake,
    make_mistake,
)
from simulators.scene import DomeScene
from simulators.sight_lines import SightLines
from simulators.template import room_text, venue_text
from simulators.transport import Room
from studies.measure import rms, side_by_side, write
from studies.photometry import traced
from studies.rooms import SIZE, TRUTH_SIZE, direction_errors, response_in_rooms

ROOMS = (209, 213, 214, 216, 226, 231, 232, 237, 243)  # of one or two projectors, to save time
SEEDS = (10,)  # noise of the standard venue
LIT = 0.999
AREA_PX = 12  # edge of an area of a panel, of which gains are compared
SIGMAS = 1.96
VERIFIED = 4  # photographs of each projector, and as many of all
BLACK, GAIN, COVERAGE = 0.1, 0.02, 0.995  # errors of black and gains; share of the lit dome
# the truth is that of projectors without a blend, which takes light from the edges of their pictures
NOT_JUDGED = {"edge blend left on": ("gains", "coverage", "black")}
Mistake = tuple[str, float]


class Stage:
    """A venue that is opened again and again; light of the same pictures is computed only once."""

    def __init__(self, number: int, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        text = room_text(number, SIZE) if number in ROOMS else venue_text("standard", SIZE, number)
        (folder / "venue.toml").write_text(text)
        self.venue = load_venue(folder)
        self.number = number
        self._scene = simulators.backend.build_scene(self.venue.backends["simulated"], folder)
        self._known: dict[Any, Image] = {}
        self._first: Path | None = None  # calibration
        self._sessions = 0
        simulators.truth.MASTER = TRUTH_SIZE
        with patch("simulators.truth.build_scene", lambda *_: self._scene):  # traced once
            simulators.truth.write_truth(
                self.venue.backends["simulated"], folder, folder / "truth", {}
            )
        self.truth = load_calibration(folder / "truth")

    def forget(self) -> None:
        """Let go of gigabytes of light, which a worker would keep while it opens the next venue."""
        self._known.clear()

    def calibrate(self, mistake: Mistake | None) -> tuple[Calibration, list[str]]:
        """A calibration of a new session, and its notes."""
        found, _ = self._calibrated(mistake)
        return found, found.provenance.note_lines

    def calibrate_again(self, mistake: Mistake | None) -> tuple[Calibration, list[str]]:
        """The same, and what is said of differences from the calibration before."""
        found, compared = self._calibrated(mistake)
        return found, [*found.provenance.note_lines, *compared]

    def verify(self, mistake: Mistake | None) -> tuple[Calibration, list[str]]:
        """The first calibration, which a verification keeps, and what that finds."""
        used = load_calibration(self._first)
        with self._rig(mistake, VERIFIED * (1 + len(used.projectors))) as rig:
            photographer = DrivenPhotographer(rig, used, SETTLE_S)
            found = result_of(verify(photographer, self._as_written(mistake), used))
        return used, [f"{f.subject} {f.cause}" for f in found.findings]

    def recalibrate(self, mistake: Mistake | None) -> tuple[Calibration, list[str]]:
        """The calibration with its last projector measured again, and what is said."""
        venue, name = self._as_written(mistake), list(self.venue.table.projectors)[-1]
        photographs = prepare_session(venue, self._folder(mistake)).read_plan().exposures
        with self._rig(mistake, photographs) as rig:
            made = result_of(recalibrate(lambda: rig, venue, self._first, [name]))
        assert made.calibration is not None
        found = load_calibration(made.calibration)
        return found, [*made.notes, *found.provenance.note_lines]

    def _folder(self, mistake: Mistake | None) -> Path:
        """A folder for a session that is no other's."""
        self._sessions += 1
        name = "right" if mistake is None else re.sub(r"\W+", "-", f"{mistake}")
        return self.venue.directory / "sessions" / f"{self._sessions:04d}-{name}"

    def _calibrated(self, mistake: Mistake | None) -> tuple[Calibration, list[str]]:
        """A calibration of a new session, and how it is compared with the one before."""
        session = prepare_session(self.venue, self._folder(mistake))
        with self._rig(mistake, session.read_plan().exposures) as rig:
            result_of(capture(rig, self.venue, session))
        solved = result_of(solve(self._as_written(mistake), session))
        self._first = self._first or solved.directory
        use_calibration(self.venue.directory, self._first)  # what is compared with next
        return load_calibration(solved.directory), solved.compared

    def _as_written(self, mistake: Mistake | None) -> Venue:
        """The venue as venue.toml has it, where a mistake is in there."""
        name, strength = mistake or ("", 0.0)
        table, cameras = self.venue.table, dict(self.venue.table.cameras)
        marks = list(table.fiducials)
        if name in SETTING_MISTAKES:
            for camera, entry in cameras.items():
                wrong = SETTING_MISTAKES[name](strength, entry.model_dump())
                cameras[camera] = entry.model_copy(update=wrong)
        if name == "photographs cropped":  # marks are clicked on in the photographs
            for i, mark in enumerate(marks):
                pixel = cropped_pixel(strength, mark.pixel, cameras[mark.camera or ""].size)
                marks[i] = mark.model_copy(update={"pixel": pixel})
        changed = {"cameras": cameras, "fiducials": marks}
        return replace(self.venue, table=table.model_copy(update=changed))

    def verify_later(self, calibration: Path, mistake: Mistake | None) -> Verified:
        """What a verification finds after a mistake of `LATER_STRENGTHS`, or after none."""
        with self._rig(None, 0) as rig:
            devices = BackendRig(rig.cameras, rig.projectors, rig.clock)
            made = make_later_mistake(devices, *mistake) if mistake else devices
            found, altered = load_calibration(calibration), replace(rig, projectors=made.projectors)
            photographer = DrivenPhotographer(altered, found, SETTLE_S)
            return result_of(verify(photographer, self.venue, found))

    def _rig(self, mistake: Mistake | None, photographs: int) -> Rig:
        with patch("simulators.backend.build_scene", self._new_scene):
            rig = open_rig(self.venue)
        if mistake is None:
            return rig
        devices = BackendRig(rig.cameras, rig.projectors, rig.clock)
        made = make_mistake(devices, *mistake, photographs, self.number)
        return replace(rig, cameras=made.cameras, projectors=made.projectors)

    def _new_scene(self, *_: object) -> DomeScene:
        """The scene, in standby, that remembers the light of its pictures."""
        scene = self._scene.altered()
        compute = scene.radiance

        def radiance(lines: SightLines, bands: slice, blur_px: float) -> Image:
            factors = {n: f for n, s in scene.states.items() if (f := s.light_factor()) > 0}
            if len(factors) != 1:
                return compute(lines, bands, blur_px)
            ((name, factor),) = factors.items()
            key = name, hash(scene.on_screen(name).tobytes()), str(bands)
            if key not in self._known:
                self._known[key] = compute(lines, bands, blur_px) / np.float32(factor)
            return self._known[key] * np.float32(factor)

        vars(scene)["radiance"] = radiance
        return scene


# The command before which a mistake is made, by name.
COMMANDS: Mapping[str, Callable[[Stage, Mistake | None], tuple[Calibration, list[str]]]] = {
    "calibrate": Stage.calibrate,
    "verify": Stage.verify,
    "recalibrate": Stage.recalibrate,
    "calibrate again": Stage.calibrate_again,
}


def figures(found: Calibration, truth: Calibration) -> dict[str, float]:
    """What is bounded: departures over what is stated (a sigma), or over what is promised."""
    relative, absolute = direction_errors(found, truth)
    quality, floor = found.quality, found.quality["floor_albedo_by_light"]
    floor_sigma = float(floor.note.removeprefix("sigma "))
    true, maps = truth.maps, found.maps
    lo, coverage = (block_mean(x, maps.size // true.size) for x in (maps.lo, maps.coverage))
    lit = (true.coverage > LIT) & (coverage > LIT)
    unit, gain = _gains(found, truth)  # the reference whites differ
    black = lo[lit][:, 1].sum() / true.lo[lit][:, 1].sum() / unit - 1
    covered = (true.coverage * np.minimum(coverage, 1)).sum()
    errors = {
        "m": _in_sigmas(found.feedback, truth.feedback),
        "albedo": _in_sigmas(found.albedo, truth.albedo),
        "floor": (floor.value - truth.screen.floor_albedo) / floor_sigma / SIGMAS,
        "directions": absolute / quality["direction_sigma_arcmin"].value / SIGMAS,
        "relative directions": relative / quality["direction_sigma_relative_arcmin"].value / SIGMAS,
        "response": _response(found, truth),
        "gains": gain / GAIN,
        "black": black / BLACK,
        "coverage": (1 - covered / true.coverage.sum()) / (1 - COVERAGE),
    }
    return {name: round(abs(float(error)), 3) for name, error in errors.items()}


def _in_sigmas(found: Measured, truth: Measured) -> float:
    return float((found.value[1] - truth.value[1]) / found.sigma[1] / SIGMAS)


def _response(found: Calibration, truth: Calibration) -> float:
    error, sigma = response_in_rooms(found, truth)
    return float(rms(np.divide(error, sigma))) / SIGMAS


def _gains(found: Calibration, truth: Calibration) -> tuple[float, float]:
    """Median of gains over the true ones; what 95 % of areas of the panels are off by at most, less that."""
    ratios = list[Array]()
    for name, projector in truth.projectors.items():
        own = found.projectors[name]
        both = projector.surface.valid & own.surface.valid
        whole = block_mean(both.astype(np.float32), AREA_PX) == 1
        gain, true = (
            block_mean(p.photometry.gain[..., 1], AREA_PX)[whole] for p in (own, projector)
        )
        ratios.append(np.asarray(gain / true, float))
    ratio = np.concatenate(ratios)
    unit = float(np.median(ratio))
    return unit, float(np.quantile(np.abs(ratio / unit - 1), 0.95))


def judge_room(number: int) -> list[dict[str, Any]]:
    """Rows of a room: without a mistake, then each mistake at each strength."""
    Room.trace = lambda surface, rays: traced(surface.preset, rays)
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(number, Path(folder))
        clean = clean_row(stage)
        mistakes = [(name, s) for name, strengths in STRENGTHS.items() for s in strengths]
        later = list(later_rows(stage))  # first, while the calibration in use has no mistake
        rows = [clean, *(row_of(stage, mistake, clean) for mistake in mistakes), *later]
        stage.forget()
        return rows


def clean_row(stage: Stage, command: str = "calibrate") -> dict[str, Any]:
    """Errors and notes of a command of `COMMANDS` without a mistake; the first calibrates."""
    found, notes = COMMANDS[command](stage, None)
    return {"room": stage.number, "notes": notes, "errors": figures(found, stage.truth)}


def row_of(
    stage: Stage, mistake: Mistake, clean: dict[str, Any], command: str = "calibrate"
) -> dict[str, Any]:
    """What came of a mistake: `wrong` names figures, `notes` are those that are not `clean`'s."""
    row: dict[str, Any] = {"room": stage.number, "mistake": list(mistake), "command": command}
    try:
        found, notes = COMMANDS[command](stage, mistake)
    except ProcamError as error:
        return row | {"refused": str(error)}
    usual, errors = set(map(_kind, clean["notes"])), figures(found, stage.truth)
    limits = {name: max(1, 1.05 * error) for name, error in clean["errors"].items()}
    judged = errors.keys() - NOT_JUDGED.get(mistake[0], ())
    return row | {
        "notes": [note for note in notes if _kind(note) not in usual],
        "errors": errors,
        "wrong": sorted(name for name in judged if errors[name] > limits[name]),
    }


def later_rows(stage: Stage) -> Iterator[dict[str, Any]]:
    """What a verification says of each mistake that was made after the calibration, and of none."""
    calibration = calibration_in_use(stage.venue.directory)
    mistakes = [(name, s) for name, strengths in LATER_STRENGTHS.items() for s in strengths]
    for mistake in [None, *mistakes]:
        found = stage.verify_later(calibration, mistake)
        causes = [each.cause for each in found.findings if each.alarm]
        yield {"room": stage.number, "later": list(mistake or ()), "causes": causes}


def later_table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines: what verifications said, a row per mistake and strength."""
    clean = [row for row in rows if not row["later"]]
    alarms = sum(bool(row["causes"]) for row in clean)
    yield f"Verifications without a mistake: {len(clean)}, false alarms: {alarms}."
    yield from (
        "",
        "| mistake after the calibration | strength | alarms | causes |",
        "|---|---|---|---|",
    )
    for name, strengths in LATER_STRENGTHS.items():
        for strength in strengths:
            of = [row for row in rows if row["later"] == [name, strength]]
            causes = sorted({cause for row in of for cause in row["causes"]})
            alarms = sum(bool(row["causes"]) for row in of)
            yield f"| {name} | {strength:g} | {alarms} of {len(of)} | {', '.join(causes)} |"


def _kind(note: str) -> str:
    """A note without its numbers."""
    return re.sub(r"[-+]?[0-9][0-9.,]*", "#", note)


def outcome(row: dict[str, Any]) -> str:
    """What came of a mistake."""
    if "refused" in row:
        return "refused"
    wrong = "wrong" if row["wrong"] else "right"
    return f"{wrong}, noted" if row["notes"] else wrong


OUTCOMES = "refused", "right, noted", "wrong, noted", "right", "wrong"


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Markdown lines: a row per mistake and strength."""
    yield f"| mistake | strength | {' | '.join(OUTCOMES)} | what was wrong without a word |"
    yield "|---|---|---|---|---|---|---|---|"
    for name, strengths in STRENGTHS.items():
        for strength in strengths:
            of = [row for row in rows if row["mistake"] == [name, strength]]
            counts = [sum(outcome(row) == what for row in of) for what in OUTCOMES]
            silent = sorted({w for row in of if outcome(row) == "wrong" for w in row["wrong"]})
            cells = [name, f"{strength:g}", *map(str, counts), ", ".join(silent)]
            yield f"| {' | '.join(cells)} |"


def sample(seed: int, runs: int, commands: Sequence[str] = tuple(COMMANDS)) -> None:
    """Print what comes of mistakes that are drawn: room, mistake, strength and command of each."""
    rng = np.random.default_rng(seed)
    drawn: dict[int, list[tuple[Mistake, str]]] = {}
    for _ in range(runs):
        number, name = int(rng.choice(ROOMS)), str(rng.choice(list(STRENGTHS)))
        mistake = name, float(rng.choice(STRENGTHS[name]))
        drawn.setdefault(number, []).append((mistake, str(rng.choice(list(commands)))))
    for rows in side_by_side(_drawn_rows, drawn.items()):
        silent = [row for row in rows if outcome(row) == "wrong"]
        print(f"{len(silent)} of {len(rows)} silently wrong")


def _drawn_rows(drawn: tuple[int, list[tuple[Mistake, str]]]) -> list[dict[str, Any]]:
    number, mistakes = drawn
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(number, Path(folder))
        clean = {"calibrate": clean_row(stage)}
        for command in {command for _, command in mistakes} - clean.keys():
            clean[command] = clean_row(stage, command)
        return [row_of(stage, mistake, clean[c], c) for mistake, c in mistakes]


def main() -> None:
    """Run all rooms and write the results."""
    keep(side_by_side(judge_room, [*SEEDS, *ROOMS]))


def keep(rooms: list[list[dict[str, Any]]]) -> None:
    """Write the rows of all venues."""
    after = [row for room in rooms for row in room[1:] if "later" in row]
    rows = [row for room in rooms for row in room[1:] if "later" not in row]
    document: dict[str, object] = {"rows": rows, "clean": [room[0] for room in rooms]}
    document["later"] = after
    noted = sum(bool(row["notes"]) for row in document["clean"])  # type: ignore[attr-defined]
    head = f"{len(rooms)} venues; {noted} have a note without a mistake, of the dome's shape or its floor."
    write(
        "mistakes",
        document,
        [
            "# Mistakes that leave sound photographs",
            "",
            head,
            "",
            *table(rows),
            "",
            *later_table(after),
        ],
    )


if __name__ == "__main__":
    sample(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:] or tuple(COMMANDS))
