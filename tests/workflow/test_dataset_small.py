"""The open data set at a fraction of its size: made twice, loaded, solved and judged; and damaged."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import procam
from procam.errors import FileFormatError
from procam.files.dataset import load_dataset
from procam.files.versions import calibration_in_use
from procam.interfaces.judge import judge
from simulators import truth
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies import dataset

SMALL = SceneSize(projector_size=(160, 100), camera_size=(240, 240), rays=128, map_size=256)
ROOM = {"standard": partial(venue_text, "standard")}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of one session."""
    return _made(tmp_path_factory.mktemp("dataset") / "a")


def _made(out: Path) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, "MASTER", 256)
        dataset.make_dataset(out, ROOM, [1], SMALL)
    return out


@pytest.fixture
def copy(small: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small, tmp_path / "copy"))


def test_two_runs_give_the_same_bytes(small: Path, tmp_path: Path) -> None:
    again = _made(tmp_path / "b")
    first, second = (
        {str(p.relative_to(d)): p.read_bytes() for p in sorted(d.rglob("*")) if p.is_file()}
        for d in (small, again)
    )
    assert list(first) == list(second)
    assert [name for name in first if first[name] != second[name]] == []
    assert {"LICENSE.txt", "README.md", "dataset.json", "bundles/standard-1.zip"} < first.keys()
    assert "CC BY 4.0" in (small / "LICENSE.txt").read_text()
    assert "| `standard-1` | standard | 1 | 80 |" in (small / "README.md").read_text()


def test_a_session_is_solved_and_judged_against_its_truth(small: Path, tmp_path: Path) -> None:
    (each,) = procam.load_dataset(small, tmp_path / "work")
    assert (each.name, each.room, each.seed) == ("standard-1", "standard", 1)
    assert each.venue.table.projectors.keys() == each.truth.projectors.keys()
    found = procam.solve(each.session.directory)
    figures = judge(calibration_in_use(each.venue.directory), each.truth_dir)
    assert abs(figures["feedback_error"].value) < 0.03  # type: ignore[arg-type]
    assert figures["feedback_interval_covers"].value is True
    assert found.albedo.value == pytest.approx(each.truth.albedo.value, rel=0.06)
    (again,) = load_dataset(small, tmp_path / "work")
    assert calibration_in_use(again.venue.directory).name == "0001"  # what was solved stays


def test_damages_are_named(copy: Path, tmp_path: Path) -> None:
    def complaint() -> str:
        with pytest.raises(FileFormatError) as caught:
            load_dataset(copy, tmp_path / "work")
        assert not (tmp_path / "work").exists()
        return str(caught.value)

    text = (copy / "dataset.json").read_text()
    readme = copy / "README.md"
    readme.write_text(readme.read_text().swapcase())
    assert "README.md has changed since the data set was made" in complaint()
    (copy / "bundles" / "standard-1.zip").unlink()
    assert "standard-1.zip: missing from the data set" in complaint()
    for old, new, words in [
        ('"schema_version": 1', '"schema_version": 2', "has schema_version 2, and this version"),
        ('"room": "standard"', '"room": "../truth"', "is damaged (sessions.0.room"),
        ('"README.md"', '"../README.md"', "is damaged (files.../README.md"),
        ('"room": "standard"', '"room": "other"', "missing from the data set"),
    ]:
        assert old in text
        (copy / "dataset.json").write_text(text.replace(old, new))
        assert words in complaint()
    (copy / "dataset.json").unlink()
    assert "dataset.json: no such file; give the folder of a data set" in complaint()


def test_what_the_index_does_not_list_is_named(copy: Path, tmp_path: Path) -> None:
    extra = copy / "truth" / "standard" / "maps" / "other.exr"
    extra.write_bytes(b"x")
    with pytest.raises(FileFormatError, match=r"other\.exr is not listed in dataset\.json"):
        load_dataset(copy, tmp_path / "work")
    extra.unlink()
    extra.symlink_to(tmp_path / "nothing")
    with pytest.raises(FileFormatError, match=r"other\.exr: missing from the data set"):
        load_dataset(copy, tmp_path / "work")


def test_a_session_is_opened_when_it_is_asked_for(copy: Path, tmp_path: Path) -> None:
    document = json.loads((copy / "dataset.json").read_text())
    document["sessions"] *= 2
    (copy / "dataset.json").write_text(json.dumps(document))
    sessions = load_dataset(copy, tmp_path / "work")
    assert not (tmp_path / "work").exists()
    assert next(sessions).venue.directory == tmp_path / "work" / "standard-1"


def test_the_command_refuses_what_exists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dataset.main([str(tmp_path)]) == dataset.main([]) == 2
    assert "OUT is a folder that does not exist yet" in capsys.readouterr().err


def test_the_rooms_of_the_data_set_can_be_described() -> None:
    for name, text in dataset.ROOMS.items():
        size = replace(dataset.SIZE, camera_size=(200, 200))
        assert ("realistic" in text(size, 3)) == (name == "realistic")
        assert "seed = 3" in text(size, 3)
