"""Kills captures and solves with SIGKILL, in children forked from one process that has loaded everything.

`python crash_driver.py STAGE FOLDER` runs the groups of a stage of `GROUPS`; it exits 0 and prints the
kills of each group as JSON, or raises the assertion that failed.

A killed child runs no handler and no clean-up. Its files are compared with those of an uninterrupted
run, byte by byte: the noise of the simulated camera depends on the picture and not on the time, so
everything but the times in index.jsonl must be equal.
"""

import faulthandler
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tiny_venue import (
    CAMERA,
    contents,
    make_venue,
    one_thread,
    quick_simulator,
    solved,
    take_session,
)

import procam.estimate.light.floor_albedo
import procam.estimate.structured_light.self_calibration
import simulators.backend
import simulators.transport
from procam.files import atomic
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli.main import main as procam_main
from procam.workflows.solve import calibrate

SAMPLE_PIXELS = 1000  # from which lens and response are estimated
COARSE_ROOM = 10, 20  # rings and sectors of patches: quick to trace
FLOOR_DROPS = (0.2,)  # depths at which the floor may lie: one is as good for files as five
RANDOM_KILLS = 2
LIKE_OTHERS = re.compile(
    r"\b00(0[2-9]|[12][0-9]|3[0-8])\b"
)  # files written as those before and after
UNLIKE = re.compile(r"\.[0-9a-f]{8}-\d+-[0-9a-f]{8}\.tmp")  # what differs between processes
ONE_IN = 13  # of their calls, which repeat by threes (patterns) and fours (frames)
STUCK_S = 120
FAILED = 70  # exit code of a child that raised
STOP_SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
MOST_STOPS = 5
STOPS = [(number, count) for count in (1, 2, MOST_STOPS) for number in STOP_SIGNALS]
LIGHTING = "calibrate", "recalibrate", "refine", "state", "projector"
ARGUMENTS = {
    "recalibrate": ("--projector", "south"),
    "state": ("full",),
    "projector": ("south", "shutter", "closed"),
}
STUDY_STOPS = 200
LEAVING_S = 0.03  # pause between signals: darkening takes a few of these
LEFT_LIT = 71
AGAIN = 72  # a further signal came when the command had ended and its exit code was not taken yet
Killer = Callable[[str, bool], None]  # called for each rename and flush, before (False) and after


def child(work: Callable[[], object], killer: Killer | None = None) -> int:
    """Start `work` in a forked child; returns its process id."""
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return pid
    code = FAILED
    atomic._remove_abandoned.cache_clear()  # which a process of its own begins without
    faulthandler.register(signal.SIGALRM, chain=True)
    signal.alarm(STUCK_S)  # prints the stacks of all threads, and ends the child
    try:
        if killer:
            watch_disk(killer)
        result = work()
        code = result if isinstance(result, int) else 0
    except KeyboardInterrupt:
        code = AGAIN
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def ended(pid: int) -> int:
    """Wait for a child; its exit code, or minus the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def watch_disk(killer: Killer) -> None:
    """Call `killer` for every rename and flush of this process."""
    renamed = ""
    seen: Counter[str] = Counter()

    def watched(real: Callable[..., None], label: Callable[..., str]) -> Callable[..., None]:
        def call(*where: Any, **more: Any) -> None:
            nonlocal renamed
            name = label(*where)
            seen[name] += 1
            numbered = name + f" #{seen[name]}" * (seen[name] > 1)
            killer(numbered, False)
            real(*where, **more)
            if name.startswith("rename"):
                renamed = name
            killer(numbered, True)

        return call

    def flushed(descriptor: int) -> str:
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        if path.suffix == ".jsonl":
            return f"flush {path.name}: {path.read_text().splitlines()[-1][:60]}"
        name = UNLIKE.sub(".tmp", f"{path.parent.name}/{path.name}")
        return f"flush {name}" + f" after {renamed}" * path.is_dir()

    def moved(source: Path, target: Path) -> str:
        return f"rename to {target.parent.name}/{target.name}"

    os.fsync = watched(os.fsync, flushed)
    os.replace = watched(os.replace, moved)
    os.rename = watched(os.rename, moved)


def kill_at(label: str, after: bool) -> Killer:
    """Kill the process just before or just after one call."""

    def killer(name: str, is_after: bool) -> None:
        if (name, is_after) == (label, after):
            os.kill(os.getpid(), signal.SIGKILL)

    return killer


def kill_later(pid: int, seconds: float) -> int:
    """Kill a running child after a while; returns how it ended."""
    time.sleep(seconds)
    os.kill(pid, signal.SIGKILL)
    return ended(pid)


class Bench:
    """An uninterrupted run to compare with, and venues beside it to kill."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.whole = folder / "whole" / "venue"
        self._calls = folder / "calls.jsonl"
        venue = make_venue(self.whole)
        scene = simulators.backend.build_scene(venue.backends["simulated"], self.whole)
        scene.sight_lines(CAMERA)
        simulators.backend.build_scene = lambda *_: scene  # each child has its own copy
        self.capture_s = self._run(lambda: take_session(venue), "capture")
        self.solve_s = self._run(lambda: solved(venue, self.session(self.whole)), "solve")
        self.session_files = contents(self.whole / "sessions")
        self.calibration = contents(self.whole / "calibrations" / "0001")
        self.named = self.index(self.whole)

    def _run(self, work: Callable[[], object], stage: str) -> float:
        def note(name: str, after: bool) -> None:
            if not after:
                with self._calls.open("a") as file:
                    file.write(json.dumps([stage, name]) + "\n")

        started = time.monotonic()
        assert ended(child(work, note)) == 0, f"the uninterrupted {stage} failed"
        return time.monotonic() - started

    def calls(self, stage: str) -> list[str]:
        """Every rename and flush of the uninterrupted run, in order."""
        found = [json.loads(line) for line in self._calls.read_text().splitlines()]
        names = [name for of, name in found if of == stage]
        assert len(set(names)) == len(names), "two calls have the same name"
        return names

    def venue(self) -> Path:
        """A fresh venue folder with the same venue.toml."""
        directory = Path(tempfile.mkdtemp(dir=self.folder)) / "venue"
        directory.mkdir()
        shutil.copyfile(self.whole / "venue.toml", directory / "venue.toml")
        return directory

    def calibrated(self) -> Path:
        """A venue that was captured and calibrated."""
        venue = self.venue()
        for part in ("sessions", "calibrations"):
            shutil.copytree(self.whole / part, venue / part)
        return venue

    @staticmethod
    def session(venue: Path) -> Session:
        return Session(venue / "sessions" / "0001")

    def index(self, venue: Path) -> list[tuple[str, str, float, str]]:
        """The entries of index.jsonl, in order, without the times."""
        path = self.session(venue).directory / "captures" / CAMERA / "index.jsonl"
        entries = [json.loads(line) for line in atomic.read_lines(path)]
        return [(e["shot"], e["file"], e["exposure_s"], e["sha256"]) for e in entries]

    def check_session(self, venue: Path) -> None:
        """No named frame is lost, and no incomplete file has a final name."""
        stored = contents(venue / "sessions") if (venue / "sessions").is_dir() else {}
        for name, content in stored.items():
            path = Path(name)
            if path.name == "index.jsonl" or path.name.startswith("."):
                continue
            assert content == self.session_files[name], f"{name} differs from a complete one"
        named = self.index(venue)
        assert named == self.named[: len(named)], "index.jsonl names other frames"
        lost = [e[1] for e in named if f"0001/captures/{CAMERA}/{e[1]}" not in stored]
        assert not lost, f"named, but missing: {lost}"

    def check_calibrations(self, venue: Path, least: int = 0) -> None:
        """Each calibration that has a number is complete and equals the uninterrupted run's."""
        found = [p for p in venue.glob("calibrations/*") if not p.name.startswith(".")]
        assert len(found) >= least, "no calibration was written"
        for directory in found:
            differ = _differences(contents(directory), self.calibration)
            assert not differ, f"calibration {directory.name} differs: {differ}"

    def finish(self, venue: Path) -> None:
        """Resume to the end in a new process; the session must equal the uninterrupted one."""
        before = self.index(venue)
        assert ended(child(self.taking(venue))) == 0, "the resumed capture failed"
        self.check_session(venue)
        assert self.index(venue) == self.named
        assert self.index(venue)[: len(before)] == before, "a stored frame was taken again"
        left = set(self.session_files) - set(contents(venue / "sessions"))
        assert not left, f"missing after resuming: {left}"

    def solve(self, venue: Path) -> None:
        """Solve in a new process; the calibration must equal the uninterrupted one."""
        assert ended(child(self.solving(venue))) == 0, "the solve failed"
        self.check_calibrations(venue, least=1)

    def taking(self, venue: Path) -> Callable[[], object]:
        return lambda: take_session(load_venue(venue))

    def solving(self, venue: Path) -> Callable[[], object]:
        return lambda: solved(load_venue(venue), self.session(venue))


def _differences(found: dict[str, bytes], expected: dict[str, bytes]) -> list[str]:
    return sorted(n for n in found.keys() | expected.keys() if found.get(n) != expected.get(n))


def capture_before_every_call(bench: Bench) -> Iterator[str]:
    """One session, killed before renames and flushes in turn: each run resumes the one before."""
    return _capture_killed(bench, _chosen(bench.calls("capture")), after=False)


def capture_after_every_rename(bench: Bench) -> Iterator[str]:
    """The same, just after; a flush leaves the disk as it is just before the next call."""
    renames = [c for c in bench.calls("capture") if c.startswith("rename")]
    return _capture_killed(bench, _chosen(renames), after=True)


def _chosen(calls: list[str]) -> list[str]:
    """All calls of the first and the last files of a kind, and one in ONE_IN of those of the others."""
    others = [call for call in calls if LIKE_OTHERS.search(call)]
    left_out = set(others) - set(others[::ONE_IN])
    return [call for call in calls if call not in left_out]


def _capture_killed(bench: Bench, calls: list[str], after: bool) -> Iterator[str]:
    venue = bench.venue()
    for label in calls:
        status = ended(child(bench.taking(venue), kill_at(label, after)))
        assert status == -signal.SIGKILL, f"not killed at {label}: {status}"
        bench.check_session(venue)
        yield label
    bench.finish(venue)


def capture_at_random(bench: Bench) -> Iterator[str]:
    """A new session each time, killed somewhere and resumed; the last is solved."""
    rng = random.Random(20110)
    for _ in range(RANDOM_KILLS):
        venue = bench.venue()
        seconds = rng.uniform(0, 0.95 * bench.capture_s)
        while kill_later(child(bench.taking(venue)), seconds) == 0:  # it ended before the kill
            shutil.rmtree(venue / "sessions")
            seconds *= 0.7
        bench.check_session(venue)
        bench.finish(venue)
        yield f"{seconds:.3f} s"
    bench.solve(venue)


def solve_at_every_call(bench: Bench) -> Iterator[str]:
    """Killed before every rename and flush and after every rename; each starts on what was left.

    What is saved is computed once: each kill ends another child that saves it.
    """
    venue = _captured(bench)
    kills = [
        (label, after)
        for label in bench.calls("solve")
        for after in ((False, True) if label.startswith("rename") else (False,))
    ]
    save = calibrate.save_calibration

    def killed_in_turn(*what: Any) -> None:
        for label, after in kills:
            status = ended(child(lambda: save(*what), kill_at(label, after)))
            assert status == -signal.SIGKILL, f"not killed at {label}: {status}"
            bench.check_session(venue)
            bench.check_calibrations(venue)
            for whole in venue.glob("calibrations/[0-9]*"):  # its number would name other calls
                shutil.rmtree(whole)
        os._exit(0)

    calibrate.save_calibration = killed_in_turn
    assert ended(child(bench.solving(venue))) == 0
    calibrate.save_calibration = save
    bench.solve(venue)
    yield from (label for label, _ in kills)


def solve_at_random(bench: Bench) -> Iterator[str]:
    """Killed somewhere; each starts on what the last left, and a solve of what is left ends them."""
    rng = random.Random(110120)
    venue = _captured(bench)
    for _ in range(RANDOM_KILLS):
        seconds = rng.uniform(0, 0.95 * bench.solve_s)
        while kill_later(child(bench.solving(venue)), seconds) == 0:
            shutil.rmtree(venue / "calibrations")
            seconds *= 0.7
        bench.check_session(venue)
        bench.check_calibrations(venue)
        yield f"{seconds:.3f} s"
        for whole in venue.glob("calibrations/[0-9]*"):
            shutil.rmtree(whole)
    bench.solve(venue)


def _captured(bench: Bench) -> Path:
    venue = bench.venue()
    shutil.copytree(bench.whole / "sessions", venue / "sessions")
    return venue


def interrupt_at_random(bench: Bench) -> Iterator[str]:
    """INT, TERM or HUP, up to five of them, in a capture: dark, their exit code; five: resumable."""
    rng = random.Random(130)
    for number, count in STOPS:
        venue = bench.venue()
        seconds = rng.uniform(0.05, 0.95) * bench.capture_s
        pauses = [rng.uniform(0, LEAVING_S) for _ in range(count - 1)]
        while (code := _interrupted(venue, number, [seconds, *pauses])) == 0:
            shutil.rmtree(venue / "sessions")
            seconds *= 0.7
        assert code != LEFT_LIT, "a projector was left lit"
        assert code == 128 + number, f"exit code {code} after {count} of signal {number}"
        bench.check_session(venue)
        if count == MOST_STOPS:
            bench.finish(venue)
        yield f"{seconds:.3f} s"
        shutil.rmtree(venue)


def stop_at_random(bench: Bench) -> Iterator[str]:
    """The same for all commands that light projectors, at STUDY_STOPS moments."""
    rng = random.Random(4)
    durations = {}
    for command in LIGHTING:
        venue = bench.calibrated()
        started = time.monotonic()
        assert _interrupted(venue, signal.SIGINT, [], command) in (0, 1)  # 1 where a figure fails
        durations[command] = time.monotonic() - started
    for index in range(STUDY_STOPS):
        command, (number, count) = LIGHTING[index % len(LIGHTING)], rng.choice(STOPS)
        venue = bench.calibrated()
        pauses = [rng.uniform(0, LEAVING_S) for _ in range(count - 1)]
        seconds = rng.uniform(0, durations[command])
        code = _interrupted(venue, number, [seconds, *pauses], command)
        said = (venue / "stderr").read_text()
        assert code != LEFT_LIT, f"{command} left a projector lit after {seconds:.3f} s: {said}"
        known = (0, 1, 128 + number, *[AGAIN] * (count > 1))
        assert code in known, f"{command}: exit code {code}: {said}"
        assert code < 128 or ("are dark" in said) <= (command != "projector"), said
        for directory in venue.glob("calibrations/[0-9]*"):
            load_calibration(directory)
        yield f"{command} {code}"
        shutil.rmtree(venue)


def _interrupted(
    venue: Path, number: int, seconds: list[float], command: str = "session capture"
) -> int:
    reader, ready = os.pipe()
    pid = child(_commanded(venue, ready, command))
    os.close(ready)  # the child has its own: if it dies early, the read ends
    os.read(reader, 1)
    os.close(reader)
    for pause_s in seconds:
        time.sleep(pause_s)
        os.kill(pid, number)
    return ended(pid)


def _commanded(venue: Path, ready: int, command: str) -> Callable[[], int]:
    """`procam COMMAND VENUE` as the command line runs it; its exit code, if all is dark."""

    def run() -> int:
        sys.stdout, sys.stderr = ((venue / name).open("w") for name in ("stdout", "stderr"))
        for number in STOP_SIGNALS:
            signal.signal(number, signal.default_int_handler)
        sys.argv = ["procam", *command.split(), str(venue), *ARGUMENTS.get(command, ()), "--json"]
        try:
            os.write(ready, b".")
            procam_main()
        except (
            KeyboardInterrupt,
            SystemExit,
        ) as stop:  # the first: while the process ended by itself
            for number in STOP_SIGNALS:
                signal.signal(number, signal.SIG_IGN)
            scene = simulators.backend.build_scene({}, venue)
            lit = [n for n, state in scene.states.items() if state.light_factor() > 0]
            return LEFT_LIT if lit else int(getattr(stop, "code", 0) or 0)
        return 0

    return run


GROUPS: dict[str, list[Callable[[Bench], Iterator[str]]]] = {
    "kills": [
        capture_before_every_call,
        capture_after_every_rename,
        capture_at_random,
        interrupt_at_random,
        solve_at_every_call,
        solve_at_random,
    ],
    "stops": [stop_at_random],
}


def prepare(folder: Path) -> None:
    """Make this process one that will be forked often, and whose venues are coarse."""
    one_thread()
    tempfile.tempdir = str(folder / "wires")  # where emulated serial ports appear
    Path(tempfile.tempdir).mkdir()
    procam.estimate.light.floor_albedo.DROPS = FLOOR_DROPS
    procam.estimate.structured_light.self_calibration.SAMPLE_PIXELS = SAMPLE_PIXELS
    simulators.transport.DOME_RINGS, simulators.transport.DOME_SECTORS = COARSE_ROOM


def main() -> None:
    stage, folder = sys.argv[1], Path(sys.argv[2])
    prepare(folder)
    with quick_simulator():
        bench = Bench(folder)
        survived = [list(group(bench)) for group in GROUPS[stage]]
    sys.stdout.write(json.dumps(survived))


if __name__ == "__main__":
    main()
