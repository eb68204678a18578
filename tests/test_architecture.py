"""The layers, the wall round the simulators, and how light `procam --help` is."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LINT_IMPORTS = Path(sys.executable).with_name("lint-imports")
SPOILT = [  # a line for a module, and the contract that it breaks
    (
        "procam/workflows/capture/capture.py",
        "import simulators.scene",
        "procam never imports the simulators",
    ),
    ("simulators/transport.py", "import procam.maths.light.radiosity", "The wall"),
    ("simulators/truth.py", "from procam.files import calibration", "The wall"),
    ("simulators/scene.py", "from procam import decode", "The wall"),
    ("simulators/sensor.py", "import importlib.util", "The wall"),
    (
        "procam/maths/geometry/sphere.py",
        "import procam.maths.light.radiosity",
        "Behind the wall",
    ),
    (
        "procam/maths/geometry/lenses.py",
        "import procam.kernels.frame.reference",
        "Behind the wall",
    ),
    ("procam/maths/geometry/pose.py", "import procam.model.frame", "Layers"),
    (
        "procam/estimate/structured_light/decode.py",
        "import procam.files.images.pixels",
        "Layers",
    ),
    ("procam/estimate/light/blend.py", "import cv2", "cv2 stays behind maths.warp"),
    (
        "procam/estimate/geometry/camera_view.py",
        "import embreex",
        "Extras stay behind one module each",
    ),
    (
        "procam/estimate/boards/camera.py",
        "import procam.estimate.geometry.model",
        "Estimators build on each other",
    ),
    (
        "procam/estimate/closed_loop/patches.py",
        "import procam.estimate.structured_light.codes",
        "Estimators build on each other",
    ),
    (
        "procam/estimate/comparison/verdict.py",
        "import procam.estimate.camera.noise",
        "A comparison of calibrations",
    ),
    (
        "procam/files/venue/outlines.py",
        "import procam.files.venue.load",
        "No import cycles",
    ),
    ("procam/model/frame.py", "import time", "Numbers know no files"),
    (
        "procam/workflows/capture/newest.py",
        "import concurrent.futures",
        "Threads are those of procam.threads",
    ),
    (
        "procam/__init__.py",
        "import procam.maths.geometry.pose",
        "import procam stays light",
    ),
]
HEAVY = ("numpy", "cv2", "scipy", "colour", "matplotlib", "OpenImageIO", "pydantic")


def _lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the contracts on the packages in `folder`, whatever is installed."""
    return subprocess.run(
        [LINT_IMPORTS, "--no-cache"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def _copied(folder: Path) -> Path:
    """The two packages and their contracts, to be spoilt."""
    for package in ("procam", "simulators"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return _copied(tmp_path)


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the contracts say of a copy with all lines of `SPOILT`."""
    folder = _copied(tmp_path_factory.mktemp("spoilt"))
    for path, line, _ in SPOILT:
        _spoil(folder, path, line)
    result = _lint(folder)
    assert result.returncode != 0
    return result.stdout


def _spoil(folder: Path, path: str, line: str) -> None:
    file = folder / path
    file.write_text(f"{file.read_text('utf-8')}\n{line}\n", encoding="utf-8")


class TestContracts:
    def test_all_are_kept(self) -> None:
        result = _lint(ROOT)
        assert result.returncode == 0, result.stdout + result.stderr
        assert "0 broken" in result.stdout

    @pytest.mark.parametrize(("path", "line", "contract"), SPOILT)
    def test_each_bites(self, spoilt: str, path: str, line: str, contract: str) -> None:
        """On its own line, of a copy with all of them."""
        (heading,) = re.findall(rf"^({contract}.*) BROKEN", spoilt, re.MULTILINE)
        section = spoilt.split(f"\n{heading}\n---")[1].partition("\n---")[0]
        module = Path(path).parent.name if "__init__" in path else Path(path).stem
        assert f"{module} -> " in " ".join(section.split()), spoilt

    def test_a_new_module_is_beyond_the_wall(self, copy: Path) -> None:
        (copy / "procam" / "maths" / "light" / "new.py").write_text('"""New."""\n')
        _spoil(copy, "simulators/transport.py", "import procam.maths.light.new")
        result = _lint(copy)
        assert "simulators.transport -> procam.maths.light.new" in result.stdout
        assert result.returncode != 0

    def test_both_halves_of_the_wall_list_the_same_modules(self) -> None:
        settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
        contracts = settings["tool"]["importlinter"]["contracts"]
        wall, behind = (
            next(c for c in contracts if c["name"].startswith(name))
            for name in ("The wall", "Behind the wall")
        )
        importers, allowed = zip(*(i.split(" -> ") for i in wall["ignore_imports"]), strict=True)
        assert set(importers) == {"simulators.**"}
        assert set(allowed) == set(behind["source_modules"])
        assert not [name for name in allowed if "*" in name]  # modules, not packages


def _modules_after(code: str) -> set[str]:
    script = f"{code}\nimport sys\nprint('\\n'.join(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return set(result.stdout.splitlines())


RUN = """
import sys
sys.argv = {}
from procam.interfaces.cli.main import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""
HELP = RUN.format(["procam", "--help"])


class TestSize:
    """Modules that a person can read in one sitting."""

    def test_no_module_is_over_400_lines_nor_over_300_without_a_reason(self) -> None:
        long, unexplained = [], []
        for path in [*(ROOT / "procam").rglob("*.py"), *(ROOT / "simulators").rglob("*.py")]:
            text = path.read_text("utf-8")
            lines = text.count("\n")
            if lines > 400:
                long.append(str(path))
            opening = " ".join((ast.get_docstring(ast.parse(text)) or "").split())
            if lines > 300 and "kernels" not in path.parts and "longer than 300" not in opening:
                unexplained.append(str(path))
        assert (long, unexplained) == ([], [])


class TestStart:
    @pytest.mark.parametrize(
        "code",
        ["import procam", "import procam.interfaces.cli.main", HELP],
        ids=["root", "cli", "help"],
    )
    def test_nothing_heavy_is_imported(self, code: str) -> None:
        loaded = _modules_after(code)
        assert "procam" in loaded
        assert not loaded & set(HEAVY)

    def test_the_test_itself_can_see_numpy(self) -> None:
        assert "numpy" in _modules_after("import procam.maths.geometry.pose")

    def test_procam_loads_no_simulator_by_itself(self) -> None:
        loaded = _modules_after(
            "import procam.workflows.solve.calibrate, procam.workflows.capture.capture"
        )
        assert not any(name.split(".")[0] == "simulators" for name in loaded)
