"""Operating systems without `fcntl` and `resource` can import procam, and locks hold between processes."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from held_folder import held_by

from procam.errors import InputError
from procam.files import atomic, system
from procam.files.lock import locked

WINDOWS = """
import pkgutil, sys
from unittest.mock import MagicMock
sys.modules["serial"] = MagicMock()  # on Windows it has an implementation without fcntl
sys.modules["fcntl"] = sys.modules["resource"] = None
import procam
for module in pkgutil.walk_packages(procam.__path__, "procam."):
    if "kernels" not in module.name and "__main__" not in module.name:
        __import__(module.name)
"""


def test_a_folder_is_held_until_its_process_is_killed(tmp_path: Path) -> None:
    with held_by("solve", tmp_path) as other:
        refused = rf"`procam solve` \(process {other.pid}\) is at work there; wait until"
        with pytest.raises(InputError, match=refused), locked(tmp_path, "capture"):
            pass
        other.kill()
        other.wait()
        with locked(tmp_path, "capture"), locked(tmp_path, "solve"):  # within one process
            pass


def test_no_module_needs_the_imports_that_windows_lacks() -> None:
    subprocess.run([sys.executable, "-c", WINDOWS], check=True)


class TestWithoutFcntl:
    @pytest.fixture(autouse=True)
    def windows(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(system, "fcntl", None)
        monkeypatch.setattr(system, "resource", None)

    @pytest.mark.parametrize("free", [True, False])
    def test_locks_are_those_of_msvcrt(
        self, free: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def locking(descriptor: int, mode: int, count: int) -> None:
            if not free:
                raise OSError

        msvcrt = SimpleNamespace(LK_NBLCK=2, locking=locking)
        monkeypatch.setitem(sys.modules, "msvcrt", msvcrt)
        with (tmp_path / "lock").open("w") as file:
            assert system.try_lock(file) is free

    def test_files_are_flushed_and_folders_and_pipes_left_alone(self, tmp_path: Path) -> None:
        atomic.write_text(tmp_path / "a" / "file", "text")
        assert (tmp_path / "a" / "file").read_text() == "text"
        system.widen_pipe(0, 2**20)
        assert system.peak_memory_mib() != system.peak_memory_mib()  # NaN


def test_the_peak_memory_is_that_of_this_process() -> None:
    assert 20 < system.peak_memory_mib() < 2e4
