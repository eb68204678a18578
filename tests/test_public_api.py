"""The names that `import procam` promises: a list that only grows on purpose, all documented, all lazy."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import procam

ROOT = Path(procam.__file__).parent
PROMISED = [
    "Calibration",
    "CalibrationError",
    "CameraModel",
    "Compensator",
    "CorrespondenceMap",
    "DeviceError",
    "Dome",
    "InputError",
    "Lens",
    "Perceptual",
    "Pose",
    "ProcamError",
    "ProjectorModel",
    "VenueState",
    "Warper",
    "add_interreflection",
    "calibrate_camera",
    "capture",
    "create_venue",
    "decode",
    "generate_patterns",
    "load_calibration",
    "load_dataset",
    "remove_interreflection",
    "save_calibration",
    "solve",
    "sphere_scatter",
]
FUNCTIONS = [name for name in PROMISED if name.islower()]


def test_the_promised_names_are_all_and_sorted() -> None:
    assert procam.__all__ == PROMISED == sorted(PROMISED)
    assert set(PROMISED) <= set(dir(procam))


IMPORT_EACH = """
import sys

for name in sys.argv[1:]:
    for module in [m for m in sys.modules if m.partition(".")[0] == "procam"]:
        del sys.modules[module]
    print(name, flush=True)
    exec(f"from procam import {name}")
"""


def test_each_name_imports_by_itself() -> None:
    """Without any module of procam imported before, so that no other of its imports helps it."""
    ran = subprocess.run(
        [sys.executable, "-c", IMPORT_EACH, *PROMISED],
        check=False,
        cwd=ROOT.parent,
        capture_output=True,
        text=True,
    )
    assert (ran.returncode, ran.stdout.split()) == (0, PROMISED), ran.stderr


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        procam.no_such_name  # type: ignore[attr-defined]  # noqa: B018


def test_type_checkers_see_the_same_names() -> None:
    stub = ast.parse((ROOT / "__init__.pyi").read_text("utf-8"))
    imported = {a.name for n in stub.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert imported == set(PROMISED)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_what_goes_in_comes_out_and_fails(name: str) -> None:
    text = inspect.getdoc(getattr(procam, name)) or ""
    for section in ("Parameters", "Returns", "Raises", "Examples"):
        assert f"\n{section}\n---" in text, section
    assert ">>> " in text


@pytest.mark.parametrize("name", sorted(set(PROMISED) - set(FUNCTIONS)))
def test_classes_are_documented(name: str) -> None:
    assert len(inspect.getdoc(getattr(procam, name)) or "") > 30
