"""The C sources: built where there is a compiler, clean under sanitizers, not needed to install."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from procam import kernels

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
SOURCES = ROOT / "procam/kernels/native"
COMPILER = shutil.which("gcc") or shutil.which("cc") or ""
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler (Debian: gcc libc6-dev)")
ARM, EMULATOR = (shutil.which(name) or "" for name in ("aarch64-linux-gnu-gcc", "qemu-aarch64"))
FLAGS = ["-std=gnu11", "-Wall", "-Wextra", "-Werror", f"-I{SOURCES}", "-Wno-unknown-pragmas"]
FLAGS += ["-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"]
BASE = [SOURCES / "dispatch.c", SOURCES / "level_base.c"]
ABSENT = """#include "kernels.h"
__attribute__((weak)) const struct level procam_avx512, procam_avx2;
"""
TYPES = {"B": "u1", "H": "u2", "e": "f2", "f": "f4", "d": "f8", "s": "f4"}
Found = tuple[str, np.ndarray]
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
    files = [HERE / "every_kernel.c", *sorted(SOURCES.glob("*.c"))]
    flags = [*FLAGS, "-O0", "-g1", "-fopenmp"]
    built = _run([COMPILER, *SANITIZE, *flags, *map(str, files), "-o", str(program), "-lm"])
    assert built.returncode == 0, built.stderr
    # OpenMP keeps its threads to the end, so leaks are not checked
    quiet = {"ASAN_OPTIONS": "detect_leaks=0", "OMP_WAIT_POLICY": "passive"}
    ran = _run([str(program)], UBSAN_OPTIONS="print_stacktrace=1", **quiet)
    assert ran.returncode == 0, ran.stderr
    assert "level 2 clean" in ran.stdout


def _results(level: str, *program: str) -> list[Found]:
    """What every kernel found at a level: see `keep` of every_kernel.c."""
    number = str(kernels.LEVELS.index(level))
    ran = subprocess.run([*program, number], capture_output=True, timeout=300, check=True)
    found, at = [], 0
    while at < len(ran.stdout):
        letter = chr(ran.stdout[at])
        count = int(np.frombuffer(ran.stdout, "u8", 1, at + 1)[0])
        found.append((letter, np.frombuffer(ran.stdout, TYPES[letter], count, at + 9)))
        at += 9 + found[-1][1].nbytes
    return found


def _built(folder: Path, compiler: str, *given: str | Path) -> str:
    """every_kernel.c with level "base" and what is given."""
    absent, program = folder / "absent.c", folder / "every_kernel"
    absent.write_text(ABSENT)
    files = [HERE / "every_kernel.c", *BASE, absent, *given]
    built = _run(
        [
            compiler,
            "-O0",
            "-Wno-unused-parameter",
            *FLAGS,
            *map(str, files),
            "-o",
            str(program),
            "-lm",
        ]
    )
    assert built.returncode == 0, built.stderr
    return str(program)


@pytest.fixture(scope="module")
def in_plain_c(tmp_path_factory: pytest.TempPathFactory) -> list[Found]:
    """What the kernels find in plain C, which other tests hold to NumPy."""
    return _results("base", _built(tmp_path_factory.mktemp("plain"), COMPILER))


def _assert_same(found: list[Found], expected: list[Found]) -> None:
    assert len(found) == len(expected) > 3000
    for (letter, a), (same, b) in zip(found, expected, strict=True):
        assert (letter, a.shape) == (same, b.shape)
        known = np.isfinite(b)
        np.testing.assert_array_equal(np.isfinite(a), known)
        apart = np.abs(a[known].astype(float) - b[known])
        close = 1 if b.dtype.kind == "u" else 2e-5 * np.abs(b[known]).max(initial=0)
        # where two candidates of a search fit equally well, rounding chooses
        assert (apart > close).sum() <= (0.01 * len(b) if letter == "s" else 0)


@needs_compiler
@pytest.mark.skipif(
    not (ARM and EMULATOR), reason="no emulated ARM (Debian: gcc-aarch64-linux-gnu qemu-user)"
)
def test_arm_finds_the_same(tmp_path: Path, in_plain_c: list[Found]) -> None:
    _assert_same(_results("base", EMULATOR, _built(tmp_path, ARM, "-static")), in_plain_c)


@needs_compiler
@pytest.mark.skipif("avx2" not in kernels.available(), reason="the processor has no AVX2")
def test_avx512_finds_the_same(tmp_path: Path, in_plain_c: list[Found]) -> None:
    """Its source, with the intrinsics that few processors have in plain C."""
    flags = ("-mavx2", "-mfma", "-mf16c", "-Wno-psabi")
    program = _built(tmp_path, COMPILER, HERE / "avx512_in_c.c", *flags)
    _assert_same(_results("avx512", program), in_plain_c)


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
