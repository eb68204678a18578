"""Killed or stopped at any instant, a run loses nothing and resumes to the same calibration.

Covered, each with a real SIGKILL in a process of its own (crash_driver.py):

- capture: killed once just before every rename and every flush to disk of the session's venue.toml,
  plan, first and last patterns and frames and their index, and once just after each rename (after a
  flush the disk is as just before the next call); of the patterns and frames between, at one call in
  13. All kills happen in one session, so that each run also resumes the last one.
- solve: every rename and flush of the calibration's files and folder, in the same way.
- both: 2 random moments, each in a fresh session or a fresh solve.
- INT, TERM and HUP, one, two or five of each, at random moments of a capture: dark projectors and
  the exit code of the signal as well; runs that five of them stopped are resumed.

After every kill, each file that index.jsonl names, and each file with a final name, equals that of an
uninterrupted run, byte by byte (except the time in picture headers). After resuming, no stored frame was
taken twice, and the session equals the uninterrupted one, as the calibration does after a kill of a
solve and after the last of the captures.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from exact_room import coarse_rooms
from tiny_venue import make_venue, quick_simulator, watch_stage

from procam.interfaces.cli.main import main
from simulators.devices import SimulatedCamera

DRIVER = Path(__file__).with_name("crash_driver.py")
LEAST = 60, 17, 2, 9, 16, 2  # kills of each group of the driver
STUCK_S = 600  # a driver that hangs must not hang the suite
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def test_killed_runs_lose_nothing_and_resume_to_the_same_result(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(DRIVER), "kills", str(tmp_path)],
        env=os.environ | ONE_THREAD,
        capture_output=True,
        text=True,
        check=False,
        timeout=STUCK_S,
    )
    assert done.returncode == 0, done.stderr
    survived = [len(kills) for kills in json.loads(done.stdout.splitlines()[-1])]
    assert all(found >= least for found, least in zip(survived, LEAST, strict=True)), survived


def test_ctrl_c_leaves_the_projectors_dark_and_the_run_resumable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    venue = make_venue(tmp_path)
    stages = watch_stage(monkeypatch)
    take, shots = SimulatedCamera.capture, []

    def stopped_at_the_tenth(camera: SimulatedCamera):
        shots.append(stages[-1].lit())
        if len(shots) == 10:
            os.kill(os.getpid(), signal.SIGINT)
        return take(camera)

    monkeypatch.setattr(SimulatedCamera, "capture", stopped_at_the_tenth)
    monkeypatch.setattr(sys, "argv", ["procam", "session", "capture", str(venue.directory)])
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a run in the background ignores it
    with coarse_rooms(), quick_simulator(), pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 130
    assert shots[-1] == ["south"]
    assert stages[-1].lit() == []
    assert all(state.muted for state in stages[-1].scene.states.values())
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [
        "procam: stopped; all projectors are dark. Run the same command again"
    ]
    with coarse_rooms():
        main_succeeds(capsys)


def main_succeeds(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code in (0, None)
    assert "sessions/0001" in capsys.readouterr().out
