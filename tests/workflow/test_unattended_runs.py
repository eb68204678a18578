"""Ten unattended runs in which something goes wrong; the study has 200 (`studies/unattended.md`)."""

import json
import os
import subprocess
import sys
from pathlib import Path

DRIVER = Path(__file__).with_name("unattended_driver.py")
FIRST, LAST = (
    2,
    11,
)  # seeds with each event, and with faults of cameras, disks, notifications and shutters
STUCK_S = 900  # a driver that hangs must not hang the suite
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def test_light_goes_at_once_and_what_is_said_is_true(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(DRIVER), str(FIRST), str(LAST), str(tmp_path)],
        env=os.environ | ONE_THREAD,
        capture_output=True,
        text=True,
        check=False,
        timeout=STUCK_S,
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["seed"] for row in rows] == list(range(FIRST, LAST + 1))
    assert len({row["event"] for row in rows}) == 6
    assert not [row for row in rows if row["wrong"]]
