"""Unattended runs in which something goes wrong, with emulated lamps whose light is logged in real time.

`python unattended_driver.py FIRST LAST FOLDER` prints a line of JSON for each seed. Each run is a
child forked from one process that has loaded everything; its venue has two projectors behind emulated
serial lines, whose scene runs SPEED times as fast as the clock. The interlock is a script that logs its own
answers; programs, signals and files come from outside.
"""

import ctypes
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crash_driver import STOP_SIGNALS, child, prepare
from tiny_venue import (
    CAMERA,
    TINY_PAIR,
    make_venue,
    quick_simulator,
    solved,
    take_session,
)

import procam.workflows.unattended
import procam.workflows.watchdog
import simulators.backend
import simulators.scene
from procam.errors import DeviceError
from procam.files.session import Session
from procam.interfaces.cli._output import RunLog
from procam.interfaces.cli.main import main as procam_main
from procam.model.frame import Frame
from simulators.devices import SimulatedCamera
from simulators.projector_state import ProjectorState

SPEED = 20.0
HANG_S = 8.0
LATE_S, GOAL_S = 2.0, 1.0  # of an answer, and of light after no
MOST_S = 60.0  # of a run
NOTIFY_S, END_S = 1.5, 2.0  # shorter than in life, for the sake of time
LAST_S, LIT_S = 3.0, 0.8  # within which an event comes, from the beginning and from the first light
LIT_FIRST = 0.9  # share of runs whose event waits for light
DARK = "all projectors are dark"
INTERLOCK = """#!/bin/sh
# one line for each asking: when it began, and when it said no
read began _ < /proc/uptime
echo "asked $began" >> {folder}/answers
[ -e {folder}/hangs ] && exec sleep 60
[ -e {folder}/late ] && sleep 2.5
[ -e {folder}/killed ] && kill -9 $$
[ -e {folder}/empty ] && exit 0
read now _ < /proc/uptime
echo "no $now" >> {folder}/answers
exit 1
"""
NOTIFY = {
    "": '#!/bin/sh\necho "$1" >> {folder}/message\n',
    "notify hangs": "#!/bin/sh\nsleep 60\n",
    "notify dies": "#!/bin/sh\nkill -9 $$\n",
    "notify lies": "#!/bin/sh\nexit 0\n",
}


class FastClock:
    """The scene's time: SPEED times that of the clock on the wall."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def now_s(self) -> float:
        return SPEED * (time.monotonic() - self._began_s)

    def sleep(self, duration_s: float) -> None:
        time.sleep(max(0.0, duration_s) / SPEED)


@dataclass(frozen=True)
class Run:
    """What goes wrong in a run: the fault of a device, disk or program, and the event after `at_s`."""

    seed: int
    command: str
    fault: str
    event: str
    at_s: float
    lit_first: bool  # whether the time counts from the first light
    photograph: int  # at which the fault begins
    signals: tuple[int, ...] = ()


CAMERA_FAULTS = "camera hangs", "camera deaf", "camera for ever", "camera dies", "camera lies"
DISK_FAULTS = "disk hangs", "disk dies"
NOTIFY_FAULTS = "notify hangs", "notify dies", "notify lies"
FAULTS = ("", "", *CAMERA_FAULTS, *DISK_FAULTS, *NOTIFY_FAULTS, "shutter sticks")
INTERLOCK_EVENTS = "interlock hangs", "interlock late", "interlock killed", "interlock absent"
EVENTS = ("somebody", "somebody", "signal", "signal", *INTERLOCK_EVENTS)


def draw(seed: int) -> Run:
    """The run of a seed: every fault meets every event in turn."""
    rng = random.Random(seed)
    event = EVENTS[seed % len(EVENTS)]
    signals = (rng.choice(STOP_SIGNALS),) * rng.choice((1, 2, 5)) if event == "signal" else ()
    fault = FAULTS[(seed // len(EVENTS) + 5 * seed) % len(FAULTS)]
    command = ("verify", "recalibrate")[(seed // 3) % 2]
    lit_first = rng.random() < LIT_FIRST
    at_s = rng.uniform(0.0, LIT_S if lit_first else LAST_S)
    photograph = rng.randint(1, 8)
    return Run(seed, command, fault, event, at_s, lit_first, photograph, signals)


class Bench:
    """A calibrated venue to copy, and its scene."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.calibrated = folder / "calibrated"
        venue = make_venue(self.calibrated, size=TINY_PAIR)
        solved(venue, take_session(venue))
        simulators.scene.SceneClock = FastClock  # type: ignore[assignment, misc]
        settings = venue.backends["simulated"]
        self.scene = simulators.backend.build_scene(settings, self.calibrated)
        self.scene.sight_lines(CAMERA)
        simulators.backend.build_scene = lambda *_: self.scene  # each child has its own copy

    def venue(self, run: Run) -> Path:
        """A copy, with the programs of [unattended] beside it."""
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        venue = Path(shutil.copytree(self.calibrated, folder / "venue"))
        (folder / "empty").touch()
        notify = NOTIFY.get(run.fault, NOTIFY[""])
        for name, text in (("interlock", INTERLOCK), ("notify", notify)):
            (folder / name).write_text(text.format(folder=folder))
            (folder / name).chmod(0o755)
        with (venue / "venue.toml").open("a") as file:
            file.write(
                f'\n[unattended]\ninterlock = "{folder}/interlock"\nbegin = "00:00"\nend = "23:59"\n'
                f'power_on = true\nnotify = "{folder}/notify"\n'
            )
        return venue


def log_light(path: Path) -> None:
    """Log every change of every lamp, shutter and picture: the time, and what is so from then on."""
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    names = dict[int, int]()

    def logged(name: str) -> None:
        real = getattr(ProjectorState, name)

        def call(state: Any, *values: Any) -> None:
            real(state, *values)
            number = names.setdefault(id(state), len(names))
            lamp = str(state._power) in ("on", "warming")
            picture, shut = state._load > 0, state._muted
            line = f"{time.monotonic():.4f} {number} {lamp:d} {shut:d} {picture:d} {state._power}\n"
            os.write(log, line.encode())

        setattr(ProjectorState, name, call)

    for name in ("follow", "set_muted", "_enter"):
        logged(name)


def go_wrong(run: Run, scene: Any) -> None:
    """Have a device, a disk or the programs fail from a photograph on, once."""
    take, count = SimulatedCamera.capture, 0

    def capture(camera: SimulatedCamera) -> Frame:
        nonlocal count
        count += 1
        if count == run.photograph and run.fault in CAMERA_FAULTS:
            if run.fault == "camera hangs":
                time.sleep(HANG_S)
            elif run.fault == "camera deaf":
                hang_deaf(HANG_S)
            elif run.fault == "camera for ever":
                hang_deaf(MOST_S)
            elif run.fault == "camera dies":
                raise DeviceError("camera zenith does not answer")
        frame = take(camera)
        if run.fault == "camera lies" and count >= run.photograph:
            return Frame(frame.counts * 0, frame.settings, frame.started_s, frame.ended_s)
        return frame

    def disk(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*what: Any) -> Any:
            if count >= run.photograph and run.fault == "disk hangs":
                time.sleep(HANG_S)
            if count >= run.photograph and run.fault == "disk dies":
                raise OSError(5, "Input/output error")
            return real(*what)

        return call

    SimulatedCamera.capture = capture  # type: ignore[method-assign]
    if run.fault in DISK_FAULTS:
        Session.store = disk(Session.store)  # type: ignore[method-assign]
    if run.fault == "disk hangs":
        RunLog.write = disk(RunLog.write)  # type: ignore[method-assign]
    if run.fault == "shutter sticks":
        mute, closed = ProjectorState.set_muted, 0

        def stuck(state: ProjectorState, muted: bool) -> None:
            nonlocal closed
            closed += muted
            if not muted or closed < 4:
                mute(state, muted)

        ProjectorState.set_muted = stuck  # type: ignore[method-assign]


def hang_deaf(duration_s: float) -> None:
    """Wait as a driver in C that goes on after a signal."""
    library, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(64)
    library.pthread_mutex_lock(mutex)
    threading.Timer(duration_s, lambda: library.pthread_mutex_unlock(mutex)).start()
    library.pthread_mutex_lock(mutex)


def commanded(run: Run, venue: Path, scene: Any) -> Callable[[], int]:
    """`procam COMMAND VENUE --unattended` as the command line runs it."""

    def work() -> int:
        for number, name in ((1, "stdout"), (2, "stderr")):
            file = os.open(venue.parent / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            os.dup2(file, number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        for number in STOP_SIGNALS:
            signal.signal(number, signal.default_int_handler)
        log_light(venue.parent / "light")
        go_wrong(run, scene)
        procam.workflows.unattended.NOTIFY_S = NOTIFY_S
        procam.workflows.watchdog.END_S = END_S if run.fault == "camera for ever" else 30.0
        only = ["--projector", "south"] if run.command == "recalibrate" else []
        sys.argv = ["procam", run.command, str(venue), "--unattended", *only]
        try:
            procam_main()
        except SystemExit as stop:
            return int(stop.code or 0)
        return 0

    return work


def disturb(run: Run, folder: Path, pid: int) -> float:
    """Do what happens in a run when its time has come, from its first light on or at once; the time."""
    running = os.WEXITED | os.WNOHANG | os.WNOWAIT
    while run.lit_first and os.waitid(os.P_PID, pid, running) is None:
        if any(" 1 0 1 " in line for line in _lines(folder / "light")):
            break
        time.sleep(0.01)
    time.sleep(run.at_s)
    now_s = time.monotonic()
    if run.event == "somebody":
        (folder / "empty").unlink()
    elif run.event == "interlock absent":
        (folder / "interlock").unlink()
    elif run.event == "signal":
        for number in run.signals:
            os.kill(pid, number)
            time.sleep(0.01)
    else:
        (folder / run.event.removeprefix("interlock ")).touch()
    return now_s


def wait(pid: int) -> int | None:
    """The exit code of a child; None if it must be killed."""
    deadline_s = time.monotonic() + MOST_S
    while time.monotonic() < deadline_s:
        found, status = os.waitpid(pid, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return None


def uptime_behind_s() -> float:
    """The clock's time less that of /proc/uptime, which a shell can read."""
    return time.monotonic() - float(Path("/proc/uptime").read_text().split()[0])


def no_at(run: Run, folder: Path, at_s: float) -> float:
    """When light was no longer allowed: after a no, LATE_S after an asking without answer, at a signal."""
    if run.event in ("signal", "interlock absent"):
        return at_s
    behind_s, answers = uptime_behind_s(), [line.split() for line in _lines(folder / "answers")]
    noes = [float(when) + behind_s for what, when in answers if what == "no"]
    if run.event == "somebody" and noes:
        return noes[0]
    late_s = 0.0 if run.event == "interlock killed" else LATE_S
    asked = [float(when) + behind_s for what, when in answers if what == "asked"]
    return min([t + late_s for t in asked if t >= at_s - 0.02], default=float("inf"))


def light_after(folder: Path, no_s: float) -> tuple[float, list[str]]:
    """How long light was on after a moment [s], and the projectors that were not dark at the end.

    -1 if all was dark at that moment already.

    Light is a picture that is not black, from a lamp whose shutter is open. At the end shutters are
    closed too, or lamps are out.
    """
    lit, open_, last_s = set[str](), set[str](), no_s - 1
    for line in _lines(folder / "light"):
        when, name, lamp, shut, picture = line.split()[:5]
        if lit and float(when) > no_s:
            last_s = float(when)
        shines = lamp == "1" and shut == "0"
        (open_.add if shines else open_.discard)(name)
        (lit.add if shines and picture == "1" else lit.discard)(name)
    return (float("inf") if lit else last_s - no_s), sorted(open_)


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.is_file() else []


def judge(run: Run, folder: Path, at_s: float, code: int | None) -> dict[str, Any]:
    """A run's row, with `wrong`: what must not be, in words."""
    light_s, lit = light_after(folder, no_at(run, folder, at_s))
    said = (folder / "stderr").read_text() + (folder / "stdout").read_text()
    message = "\n".join(_lines(folder / "message"))
    wrong = []
    if light_s > GOAL_S:
        wrong.append(f"light for {light_s:.2f} s after no")
    if lit and run.fault != "shutter sticks":
        wrong.append("lit at the end")
    if lit and DARK in said + message:
        wrong.append("called dark, and is not")
    if lit and "may still be lit" not in said:
        wrong.append("lit, and not said")
    if code is None or code not in (0, 1, 2, *(128 + n for n in run.signals)):
        wrong.append(f"exit code {code}")
    if not said.strip() or "Traceback" in said:
        wrong.append("no message")
    began = (folder / "answers").is_file()  # a signal may come before
    if (
        began
        and not run.fault.startswith("notify")
        and not message.startswith(f"procam {run.command} ")
    ):
        wrong.append("no notification")
    if code not in (0, None) and message and "failed: " not in message and code != 1:
        wrong.append("the notification does not say failed")
    row = {"seed": run.seed, "command": run.command, "fault": run.fault, "event": run.event}
    return (
        row
        | {
            "light_s": round(light_s, 3) if light_s >= 0 else None,  # nothing was lit at that time
            "exit_code": code,
            "dark": DARK in said,
            "wrong": wrong,
            "said": said.replace(str(folder), "").strip()[-600:] if wrong else "",
        }
    )


def one_run(bench: Bench, run: Run) -> dict[str, Any]:
    """Run it and judge it."""
    venue = bench.venue(run)
    pid = child(commanded(run, venue, bench.scene))
    at_s = disturb(run, venue.parent, pid)
    row = judge(run, venue.parent, at_s, wait(pid))
    shutil.rmtree(venue.parent, ignore_errors=True)  # a script may still write into it
    return row


def main() -> None:
    first, last, folder = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    prepare(folder)
    with quick_simulator():
        bench = Bench(folder)
        for seed in range(first, last + 1):
            print(json.dumps(one_run(bench, draw(seed))), flush=True)


if __name__ == "__main__":
    main()
