"""The notebooks of docs/ run from top to bottom, cell by cell, as a reader would run them."""

import json
import os
from pathlib import Path

import matplotlib
import pytest
from exact_room import coarse_rooms

from procam.estimate.light import floor_albedo

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_each_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(floor_albedo, "DROPS", (0.2,))
    matplotlib.use("Agg")
    cells = json.loads(path.read_text("utf-8"))["cells"]
    namespace: dict[str, object] = {"__name__": "__main__"}
    with coarse_rooms():
        for cell in cells:
            if cell["cell_type"] == "code":
                name = f"{path.name}:{cell['id']}"
                exec(compile("".join(cell["source"]), name, "exec"), namespace)
    assert os.environ["TMPDIR"] == str(tmp_path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_none_is_stored_with_output(path: Path) -> None:
    """Outputs are made by `make docs`; stored ones would go stale."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)
