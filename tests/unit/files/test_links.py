"""Links where procam makes or extends files: their targets stay as they are, and the link is named."""

import errno
from pathlib import Path

import pytest
from bundles import WHITE, take_session
from bundles import make_venue as bundles_venue

from procam.files.atomic import append_line
from procam.files.history.store import NAME, readable, written
from procam.files.lock import locked
from procam.files.session import Session
from procam.files.session_tables import StoredFrame
from procam.interfaces.cli._output import RunLog, end_log
from procam.interfaces.cli._system_errors import worded
from procam.workflows.capture.by_hand import _export

KEPT = "somebody else's text\n"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    path = tmp_path / "elsewhere" / "target"
    path.parent.mkdir()
    path.write_text(KEPT)
    return path


@pytest.fixture
def venue(tmp_path: Path) -> Path:
    folder = tmp_path / "venue"
    folder.mkdir()
    return folder


def refused(error: OSError, link: Path) -> bool:
    return error.errno == errno.ELOOP and worded(error).startswith(f"{link}: this is a link")


@pytest.mark.parametrize("dangling", [False, True])
def test_a_lock_that_is_a_link(venue: Path, target: Path, dangling: bool) -> None:
    link = venue / ".lock"
    link.symlink_to(target.with_name("nothing") if dangling else target)
    with pytest.raises(OSError) as caught, locked(venue, "capture"):
        pass
    assert refused(caught.value, link)
    assert target.read_text() == KEPT
    assert [path.name for path in target.parent.iterdir()] == ["target"]


@pytest.mark.parametrize("dangling", [False, True])
def test_a_log_of_lines_that_is_a_link(venue: Path, target: Path, dangling: bool) -> None:
    link = venue / "index.jsonl"
    link.symlink_to(target.with_name("nothing") if dangling else target)
    with pytest.raises(OSError) as caught:
        append_line(link, "{}")
    assert refused(caught.value, link)
    assert target.read_text() == KEPT
    assert [path.name for path in target.parent.iterdir()] == ["target"]


@pytest.mark.parametrize("name", [NAME, f"{NAME}-wal", f"{NAME}-shm", f"{NAME}-journal"])
def test_a_history_that_is_a_dangling_link(venue: Path, target: Path, name: str) -> None:
    (venue / name).symlink_to(target.with_name("nothing"))
    with pytest.raises(OSError) as caught, written(venue):
        pass
    assert name != NAME or refused(caught.value, venue / name)
    assert [path.name for path in target.parent.iterdir()] == ["target"]


def test_a_history_that_is_a_link_to_another(venue: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    with written(other):
        pass
    before = {path.name: path.read_bytes() for path in other.iterdir()}
    (venue / NAME).symlink_to(other / NAME)
    for opened in (written, readable):
        with pytest.raises(OSError) as caught, opened(venue):
            pass
        assert refused(caught.value, venue / NAME)
    assert {path.name: path.read_bytes() for path in other.iterdir()} == before


def test_a_log_of_a_run_that_is_a_link(venue: Path, target: Path) -> None:
    log = RunLog(venue, "capture")
    (venue / "logs").mkdir()
    log._path.symlink_to(target)
    log.write("a line")
    end_log("exit code 0")
    assert target.read_text() == KEPT


def test_a_photograph_of_another_session_that_is_a_link(venue: Path, target: Path) -> None:
    first, second = (Session(venue / name) for name in ("first", "second"))
    photograph = venue / "first.tif"
    photograph.write_bytes(b"counts")
    entry = StoredFrame(
        shot="dark", file="dark@1.tif", exposure_s=1, gain=1, pixel_format="rgb",
        started_s=0, ended_s=1, sha256="",
    )  # fmt: skip
    first.add_link("zenith", photograph, entry)
    link = second.directory / "captures" / "zenith" / "dark@1.tif"
    link.parent.mkdir(parents=True)
    link.symlink_to(target.with_name("nothing"))
    with pytest.raises(OSError) as caught:
        second.add_link("zenith", photograph, entry)
    assert refused(caught.value, link)
    assert [path.name for path in target.parent.iterdir()] == ["target"]


def test_pictures_to_show_that_are_links(tmp_path: Path, target: Path) -> None:
    session, out = take_session(bundles_venue(tmp_path / "dome")), tmp_path / "out"
    link = out / WHITE.pattern
    link.parent.mkdir(parents=True)
    link.symlink_to(target)
    with pytest.raises(OSError) as caught:
        _export(session, out, movie=False)
    assert refused(caught.value, link)
    assert target.read_text() == KEPT
