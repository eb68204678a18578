"""Damaged files end in a sentence or are read, never in a traceback; studies/fuzz.md has 20,000 of each."""

from pathlib import Path

import pytest
from tiny_venue import make_venue, quick_simulator, solved, take_session

import procam.estimate.calibration
from studies.fuzz import READERS, Reader, foreign, fuzz, make_files

CASES = 200
MAP_SIZE = 64  # of the dome's maps: quick to read


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz")
    with quick_simulator(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(procam.estimate.calibration, "MAP_SIZE", MAP_SIZE)
        venue = make_venue(folder / "venue")
        solved(venue, take_session(venue))
    make_files(folder)
    return folder


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_no_traceback_and_no_hang(reader: Reader, folder: Path) -> None:
    found = fuzz(reader, folder, CASES)
    assert set(found) <= {"read", "refused", "different", "slow"}, found
    assert found["refused"] > CASES / 10


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_files_of_another_kind(reader: Reader, folder: Path) -> None:
    found = foreign(reader, folder)
    assert set(found.values()) <= {"read", "refused", "different"}, found


def test_the_fuzzer_notices_a_traceback(folder: Path) -> None:
    def careless(path: Path) -> str:
        return path.read_bytes().decode()

    found = fuzz(Reader("careless", "code.toml", careless), folder, CASES)
    assert any("UnicodeDecodeError" in kind for kind in found)


def test_a_file_is_left_as_it_was(folder: Path) -> None:
    path = folder / READERS[0].path
    before = path.read_bytes()
    fuzz(READERS[0], folder, 3)
    assert path.read_bytes() == before
