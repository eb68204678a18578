"""Which level runs, how it is forced, and what happens without the library."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from procam import kernels
from procam.errors import InputError
from procam.kernels.native import loader


def _python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loader, "library", lambda: None)
    monkeypatch.setattr(loader, "_choice", loader._Choice())
    monkeypatch.delenv(loader.VARIABLE, raising=False)


def test_use_forces_and_none_returns_to_the_best() -> None:
    with kernels.forced():
        assert kernels.use("numpy") == kernels.active() == "numpy"
        assert kernels.use() == kernels.active() == kernels.available()[0]


def test_forced_ends_with_its_block() -> None:
    before = kernels.active()
    with pytest.raises(KeyError), kernels.forced("numpy"):
        raise KeyError
    assert kernels.active() == before


def test_unknown_levels_are_refused() -> None:
    with pytest.raises(
        InputError, match="'sse9' is unknown; choose one of avx512, avx2, base, numpy"
    ):
        kernels.use("sse9")
    with pytest.raises(InputError, match="threads: -1 is below 0"):
        kernels.use("numpy", threads=-1)


def test_without_library_a_level_is_refused_by_name(no_library: None) -> None:
    with pytest.raises(
        InputError, match="'avx2' does not run, no compiled library that loads was found; try one"
    ):
        kernels.use("avx2")


def test_a_level_the_processor_lacks_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loader, "available", lambda: ("base", "numpy"))
    monkeypatch.setattr(loader, "library", object)
    with pytest.raises(
        InputError, match="'avx512' does not run, this processor lacks it; try one of base"
    ):
        kernels.use("avx512")


def test_without_library_it_warns_once_and_gives_the_same(no_library: None) -> None:
    lens = np.array([100.0, 100, 0, 0, 0, 0, 0, 0])
    with pytest.warns(RuntimeWarning, match="without its compiled kernels") as caught:
        for _ in range(2):
            rays = kernels.fisheye_rays([50 * np.pi, 0.0], lens)
    assert len(caught) == 1
    assert kernels.active() == "numpy"
    np.testing.assert_allclose(rays, [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("name", kernels.available())
def test_the_environment_forces_a_level(name: str) -> None:
    ran = _python("from procam import kernels; print(kernels.active())", PROCAM_KERNELS=name)
    assert ran.stdout.strip() == name


def test_a_wrong_level_in_the_environment_is_named() -> None:
    ran = _python("from procam import kernels; kernels.active()", PROCAM_KERNELS="fast")
    assert "kernel level (PROCAM_KERNELS): 'fast' is unknown" in ran.stderr


def test_a_library_of_another_interface_is_not_used(tmp_path: Path) -> None:
    broken = tmp_path / "_native.so"
    broken.write_bytes(b"not a library")
    assert loader._opened(broken) is None


def test_import_is_light_and_leaves_the_environment_alone() -> None:
    code = (
        "import os, sys; before = dict(os.environ); from procam import kernels; kernels.available();"
        "heavy = {'scipy', 'cv2', 'numba', 'colour'} & set(sys.modules);"
        "assert not heavy and before == dict(os.environ), heavy"
    )
    ran = _python(code)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_fork_works_on_alone() -> None:
    """OpenMP's threads do not survive a fork; the child must not wait for them."""
    code = (
        "import os, sys, numpy as np; from procam import kernels\n"
        "given = np.ones((200, 201, 2)), np.array([100.0, 100, 0, 0, 0, 0, 0, 0])\n"
        "kernels.use(threads=2); kernels.fisheye_rays(*given)\n"
        "child = os.fork()\n"
        "kernels.fisheye_rays(*given)\n"
        "if not child: os._exit(7)\n"
        "sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    ran = _python(code, PYTHONWARNINGS="ignore")
    assert ran.returncode == 7, ran.stderr
