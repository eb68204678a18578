"""The C sources: built where there is a compiler, clean under sanitizers, not needed to install."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from procam import kernels

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
SOURCES = ROOT / "procam/kernels/native"
COMPILER = shutil.which("gcc") or shutil.which("cc")
needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="no C compiler (Debian: gcc libc6-dev)"
)
SANITIZE = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]


def _run(command: list[str], **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@needs_compiler
def test_the_library_is_built() -> None:
    """Where it can be built the rest of the tests must have run it, not NumPy against itself."""
    assert "base" in kernels.available(), "not built: pip install --no-deps --editable ."


@needs_compiler
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    tried = _run([COMPILER, *SANITIZE, "-fopenmp", str(probe), "-o", str(tmp_path / "probe")])
    if tried.returncode or _run([str(tmp_path / "probe")]).returncode:
        pytest.skip("the compiler has no address and undefined-behaviour sanitizers, or no OpenMP")
    program = tmp_path / "sanitized"
    files = [HERE / "sanitized.c", *sorted(SOURCES.glob("*.c"))]
    flags = ["-std=gnu11", "-O0", "-g1", "-fopenmp", "-Wall", "-Wextra", "-Werror", f"-I{SOURCES}"]
    flags += ["-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-Wno-unknown-pragmas"]
    built = _run([COMPILER, *SANITIZE, *flags, *map(str, files), "-o", str(program), "-lm"])
    assert built.returncode == 0, built.stderr
    # OpenMP keeps its threads to the end, so leaks are not checked
    quiet = {"ASAN_OPTIONS": "detect_leaks=0", "OMP_WAIT_POLICY": "passive"}
    ran = _run([str(program)], UBSAN_OPTIONS="print_stacktrace=1", **quiet)
    assert ran.returncode == 0, ran.stderr
    assert "level 2 clean" in ran.stdout


def test_without_a_compiler_the_package_still_builds(tmp_path: Path) -> None:
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    ignore = shutil.ignore_patterns("_native*", "__pycache__")
    shutil.copytree(ROOT / "procam/kernels", tmp_path / "procam/kernels", ignore=ignore)
    code = "import os, setuptools.build_meta as b; os.makedirs('out'); b.build_wheel('out')"
    built = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "CC": "/bin/false"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = (tmp_path / "out").glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "procam/kernels/frame/reference.py" in names
    assert not any("_native" in name for name in names)
