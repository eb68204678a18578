"""Damaged files end in a sentence or are read, never in a traceback; studies/fuzz.md has 20,000 of each.

A function of procam that reads what is in a file or a pipe, and that no reader of `studies.readers` runs,
fails a test here.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest
from tiny_venue import calibrated

import procam
from studies.fuzz import SIZE, foreign, fuzz
from studies.readable_files import make_files
from studies.readers import READERS, Reader

CASES = 100
ANYTHING = ".lock", "header of a picture"  # any words of a process; the beginning of a file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz")
    calibrated(folder / "venue", SIZE)
    make_files(folder)
    return folder


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_no_traceback_and_no_hang(reader: Reader, folder: Path) -> None:
    found = fuzz(reader, folder, CASES)
    assert set(found) <= {"read", "refused", "different", "slow"}, found
    assert found["refused"] > CASES / 10 or reader.name in ANYTHING


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


PACKAGE = Path(procam.__file__).parent
NAMED = re.compile(r"(load|read|open|parse|receive|ingest)(_|$)")
PARSING = {
    *(
        "loads",
        "read_bytes",
        "read_text",
        "reader",
        "DictReader",
        "ZipFile",
        "connect",
        "frombuffer",
    ),
    *("fromfile", "unpack", "unpack_from", "model_validate_json", "imread", "imdecode"),
}
LIBRARIES = re.compile(r"(av|ImageInput)\.open|open\('rb'\)")
# what reads no file that may be wrong, or only by functions that are run
NO_READERS = {
    "files/atomic.py:_this_computer": "files of the system",
    "files/bundle/pictures.py:_file_bytes": "its own temporary file",
    "files/bundle/write.py:_files": "a file of the package",
    "files/bundle/write.py:writing_bundle": "makes the archive",
    "files/images/movie_file.py:new_movie_file": "reads what it has written",
    "files/images/movie_writer.py:new_movie": "a movie that MovieReader has opened",
    "files/images/sequences.py:parse_pattern": "a name, not a file",
    "files/session.py:Session.keep_plan": "copies a plan that read_plan has read",
    "files/session.py:Session.restore_plan": "copies a plan that read_plan has read",
    "files/venue/load.py:_template_files": "files of the package",
    "workflows/capture/by_hand.py:_write_session": "copies a venue.toml that load_venue has read",
    "workflows/capture/by_hand.py:_export": "copies a session that read_plan has read",
    "workflows/capture/capture.py:prepare_session": "compares two texts",
    "workflows/capture/ingest.py:ingest": "reads by read_photo and read_index",
    "workflows/photographs/receive.py:receive": "reads by read_photo",
    "workflows/playout/compensate.py:open_clip": "reads by read_clip_frame and MovieReader",
    "workflows/playout/compensate.py:run_key": "a hash",
    "workflows/playout/track.py:_write_shaders": "files of the package",
    "workflows/playout/track.py:_digest": "a hash",
    "workflows/solve/provenance.py:session_provenance": "a hash",
    "workflows/venue_rig.py:open_rig": "devices",
    "workflows/venue_rig.py:open_projector_control": "a device",
    "workflows/verify/photographs.py:read_reference": "reads by Session",
}


def reading_functions() -> dict[str, tuple[str, int]]:
    """Functions of files and workflows that read, as FILE:NAME; each with its file and line."""
    found = dict[str, tuple[str, int]]()
    for layer in ("files", "workflows"):
        for path in sorted((PACKAGE / layer).rglob("*.py")):
            for name, function in functions(ast.parse(path.read_text("utf-8"))):
                if NAMED.match(function.name) or parses(function):
                    where = path.relative_to(PACKAGE).as_posix()
                    first = min([function, *function.decorator_list], key=lambda node: node.lineno)
                    found[f"{where}:{name}"] = str(path), first.lineno
    return found


def functions(
    body: ast.Module | ast.ClassDef, within: str = ""
) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in body.body:
        if isinstance(node, ast.ClassDef):
            yield from functions(node, f"{within}{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            yield f"{within}{node.name}", node


def parses(function: ast.FunctionDef) -> bool:
    calls = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
    names = {call.attr for call in calls if isinstance(call, ast.Attribute)}
    texts = (ast.unparse(node) for node in ast.walk(function) if isinstance(node, ast.Call))
    return bool(names & PARSING) or any(LIBRARIES.search(text) for text in texts)


def test_every_reader_of_procam_is_fuzzed(folder: Path) -> None:
    ran = set[tuple[str, int]]()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            ran.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

    sys.setprofile(note)
    try:
        for reader in READERS:
            reader.read(folder / reader.path)
    finally:
        sys.setprofile(None)
    reading = reading_functions()
    assert set(reading) - {name for name, place in reading.items() if place in ran} == set(
        NO_READERS
    )
