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


@pytest.mark.parametrize("name", PROMISED)
def test_each_name_imports_by_itself(name: str) -> None:
    """In a process of its own, so that no other import helps it."""
    subprocess.run(
        [sys.executable, "-c", f"from procam import {name}"], check=True, cwd=ROOT.parent
    )


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
