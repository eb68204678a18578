"""Bundles from strangers: whatever is wrong with one, a sentence names it and nothing is written."""

import json
import random
import shutil
import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from bundles import (
    FRAME,
    Content,
    contents,
    entry,
    make_venue,
    relisted,
    take_session,
    with_manifest,
    write_bundle,
    write_zip,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from procam.errors import FileFormatError, InputError
from procam.files.bundle.names import MOST_LETTERS, is_allowed
from procam.files.bundle.read import open_bundle

NO_NAME = "has a name that no bundle of procam has"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    venue = make_venue(folder / "venue")
    write_bundle(venue, take_session(venue), folder / "good.zip")
    return folder / "good.zip"


@pytest.fixture
def good(made: Path) -> Content:
    return contents(made)


def refused(folder: Path, bundle: Path) -> str:
    """The message about a bundle, which leaves nothing behind."""
    work = folder / "work"
    work.mkdir()
    before = sorted(folder.rglob("*"))
    with pytest.raises(FileFormatError) as caught:
        open_bundle(bundle, work / "new")
    assert sorted(folder.rglob("*")) == before
    message = str(caught.value)
    assert "\n" not in message and str(bundle) in message
    assert "work" not in message.replace(str(bundle), "")
    return message


HOSTILE_NAMES = [
    "/etc/passwd",
    "../venue.toml",
    "sessions/0001/patterns/../../../x.png",
    "sessions/0001/patterns//x.png",
    "./venue.toml",
    "C:/venue.toml",
    "C:venue.toml",
    "\\\\host\\share\\venue.toml",
    "sessions\\0001\\plan.json",
    "sessions/0001/patterns/con.png",
    "sessions/0001/patterns/LPT1.png",
    "sessions/0001/captures/aux/index.jsonl",
    "venue.toml ",
    "venue.toml\n",
    "masks/\u0661.png",
    "masks/1.png.exe",
    ".lock",
    "history.sqlite",
    "calibrations/in-use",
    "calibrations/0001/calibration.json",
    "sessions/0001/patterns/" + "a" * MOST_LETTERS + ".png",
    "sessions/0001/patterns/",
    "",
]


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_names_that_lead_elsewhere(tmp_path: Path, good: Content, name: str) -> None:
    bundle = write_zip(tmp_path / "x.zip", relisted({**good, name: b"x"}))
    message = refused(tmp_path, bundle)
    assert NO_NAME in message
    assert repr(name)[1:60].rstrip("'") in message


def test_a_name_that_goes_on_after_a_zero_byte(tmp_path: Path, good: Content) -> None:
    bundle = write_zip(tmp_path / "x.zip", relisted({**good, "masks/9.png#/../x": b"x"}))
    bundle.write_bytes(bundle.read_bytes().replace(b"masks/9.png#/", b"masks/9.png\0/"))
    assert NO_NAME in refused(tmp_path, bundle)


def test_links_and_special_files(tmp_path: Path, good: Content) -> None:
    for number, kind in enumerate((stat.S_IFLNK, stat.S_IFDIR, stat.S_IFCHR, stat.S_IFIFO)):
        folder = tmp_path / str(number)
        folder.mkdir()
        with zipfile.ZipFile(folder / "x.zip", "w") as archive:
            for name, content in relisted({**good, FRAME: b"../../secret"}).items():
                archive.writestr(
                    entry(name, (kind if name == FRAME else stat.S_IFREG) | 0o777), content
                )
        assert f"{FRAME!r} is a link or another special file" in refused(folder, folder / "x.zip")


@pytest.mark.parametrize(
    "again", ["venue.toml", "masks/2.png", "sessions/0001/patterns/south/0000.png"]
)
def test_two_entries_of_one_name(tmp_path: Path, good: Content, again: str) -> None:
    bundle = write_zip(tmp_path / "x.zip", good)
    with zipfile.ZipFile(bundle, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(entry(again), b"x")
    assert f"{again!r} is there twice" in refused(tmp_path, bundle)


def test_names_that_differ_in_case_alone(tmp_path: Path, good: Content) -> None:
    files = {**good, "sessions/0001/patterns/South/0000.png": b"x"}
    assert "is there twice, at least where case" in (
        refused(tmp_path, write_zip(tmp_path / "x.zip", relisted(files)))
    )


def test_packed_entries(tmp_path: Path, good: Content) -> None:
    files = relisted({**good, FRAME: bytes(10**7)})
    with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(
                entry(name), content, zipfile.ZIP_DEFLATED if name == FRAME else zipfile.ZIP_STORED
            )
    assert f"{FRAME!r} is packed or encrypted" in refused(tmp_path, tmp_path / "x.zip")


def _directory(data: bytes, name: str) -> int:
    """Where the record of an entry in the central directory begins."""
    at = data.rindex(name.encode()) - 46
    assert data[at : at + 4] == b"PK\1\2"
    return at


@pytest.mark.parametrize(
    ("offset", "form", "value", "words"),
    [
        (8, "<H", 1, "is packed or encrypted"),
        (20, "<L", 5, "has two different sizes"),
        (24, "<L", 5, "has two different sizes"),
        (20, "<LL", 5, "has another size than the manifest gives"),
        (20, "<LL", 2**31, "overlaps another one, or the end"),
        (42, "<L", 0, "overlaps another one, or the end"),
        (16, "<L", 1, "is damaged (Bad CRC-32"),
    ],
)
def test_headers_that_lie(
    tmp_path: Path, made: Path, offset: int, form: str, value: int, words: str
) -> None:
    data = bytearray(made.read_bytes())
    at = _directory(data, FRAME) + offset
    struct.pack_into(form, data, at, *[value] * (len(form) - 1))
    (tmp_path / "x.zip").write_bytes(data)
    message = refused(tmp_path, tmp_path / "x.zip")
    assert words in message
    assert "the entry 'sessions/0001/" in message or "the entry 'README.txt'" in message


def test_entries_that_share_bytes_are_no_way_to_fill_a_disk(tmp_path: Path, made: Path) -> None:
    data = bytearray(made.read_bytes())
    names = [n for n in contents(made) if n.endswith(".tif")]
    (first,) = struct.unpack_from("<L", data, _directory(data, names[0]) + 42)
    for name in names[1:]:
        struct.pack_into("<L", data, _directory(data, name) + 42, first)
    (tmp_path / "x.zip").write_bytes(data)
    assert "overlaps another one" in refused(tmp_path, tmp_path / "x.zip")


@pytest.mark.parametrize(
    ("name", "listed"),
    [("venue.toml", False), ("sessions/0001/plan.json", False), (FRAME, True)],
)
def test_missing_files(tmp_path: Path, good: Content, name: str, listed: bool) -> None:
    """Whether the manifest lists them, or every bundle has them."""
    files = {n: content for n, content in good.items() if n != name}
    bundle = write_zip(tmp_path / "x.zip", files if listed else relisted(files))
    assert f"the entry {name!r} is missing" in refused(tmp_path, bundle)


def test_extra_files(tmp_path: Path, good: Content) -> None:
    bundle = write_zip(tmp_path / "x.zip", {**good, "masks/9.png": b"x"})
    assert "the entry 'masks/9.png' is not in the manifest" in refused(tmp_path, bundle)


def test_changed_files(tmp_path: Path, good: Content) -> None:
    changed = good[FRAME][:-1] + bytes([good[FRAME][-1] ^ 1])
    bundle = write_zip(tmp_path / "x.zip", {**good, FRAME: changed})
    assert f"the entry {FRAME!r} has another sha256" in refused(tmp_path, bundle)
    shutil.rmtree(tmp_path / "work")
    bundle = write_zip(tmp_path / "x.zip", {**good, FRAME: good[FRAME] + b"x"})
    assert f"the entry {FRAME!r} has another size" in refused(tmp_path, bundle)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda d: d.update(schema=2),
            "has schema 2, and this version of procam reads 1; open the",
        ),
        (lambda d: d.pop("schema"), "has schema None"),
        (lambda d: d.pop("files"), "is damaged (files: field required); ask for"),
        (lambda d: d.update(frames=-1), "is damaged (frames:"),
        (
            lambda d: d["files"]["venue.toml"].update(sha256="0"),
            "is damaged (files.venue.toml.sha256",
        ),
        (lambda d: d["files"].update({"../x": d["files"]["venue.toml"]}), "'../x' is missing"),
        (lambda d: d.update(run="rm"), "is damaged (run: extra inputs"),
    ],
)
def test_manifests(
    tmp_path: Path, good: Content, change: Callable[[dict], object], words: str
) -> None:
    bundle = write_zip(tmp_path / "x.zip", with_manifest(good, change))
    assert words in refused(tmp_path, bundle)


def test_a_manifest_that_is_none(tmp_path: Path, good: Content) -> None:
    cases = {
        b"[]": "holds a JSON list",
        b"{": "is damaged JSON",
        b"\xff": "is damaged JSON",
        b" " * (2**24 + 1): "'manifest.json' is larger than 16 MiB",
    }
    for number, (content, words) in enumerate(cases.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        bundle = write_zip(folder / "x.zip", {**good, "manifest.json": content})
        assert words in refused(folder, bundle)
    del good["manifest.json"]
    assert "has no manifest.json" in refused(tmp_path, write_zip(tmp_path / "x.zip", good))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("masks/2.png", "masks/../../../secret.png", "secret.png"),
        ("masks/2.png", "masks/3.png", "names files that no bundle of procam names"),
        ("masks/2.png", "/dev/null", "/dev/null: no such file"),
        ("radius_m = 6.0", "radius_m = -1", "screen.radius_m is -1"),
        ("[screen]", "[screen", "is not valid TOML"),
    ],
)
def test_a_venue_of_its_own(tmp_path: Path, good: Content, old: str, new: str, words: str) -> None:
    text = good["venue.toml"].decode()
    assert old in text
    files = relisted({**good, "venue.toml": text.replace(old, new).encode()})
    assert words in refused(tmp_path, write_zip(tmp_path / "x.zip", files))


def test_a_plan_that_is_none(tmp_path: Path, good: Content) -> None:
    document = json.loads(good["sessions/0001/plan.json"])
    document["shots"][1]["pattern"] = "../../../x.png"
    files = relisted({**good, "sessions/0001/plan.json": json.dumps(document).encode()})
    message = refused(tmp_path, write_zip(tmp_path / "x.zip", files))
    assert "plan.json: shot 1 is damaged (pattern: '../../../x.png'" in message


def test_files_that_are_no_zip(tmp_path: Path, made: Path) -> None:
    data = made.read_bytes()
    for number, content in enumerate((b"", b"PK", b"hello" * 99, data[: len(data) // 2])):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "x.zip").write_bytes(content)
        assert "is no bundle, or a damaged one" in refused(folder, folder / "x.zip")


def test_where_it_may_go(tmp_path: Path, made: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError, match="there exists; give the name of a folder that"):
        open_bundle(made, tmp_path / "there")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="link exists"):
        open_bundle(made, tmp_path / "link")
    with pytest.raises(InputError, match=r"there is no folder .*; make it first"):
        open_bundle(made, tmp_path / "not" / "yet")
    assert not (tmp_path / "not").exists()
    with pytest.raises(FileNotFoundError):
        open_bundle(tmp_path / "no.zip", tmp_path / "new")


def test_flipped_bytes_end_in_a_sentence(tmp_path: Path, made: Path) -> None:
    data, rng = made.read_bytes(), random.Random(1)
    directory = data.index(b"PK\1\2")
    for number in range(400):
        bad = bytearray(data)
        low = directory if number % 2 else 0  # half of them where the directory is
        for _ in range(rng.randint(1, 3)):
            bad[rng.randrange(low, len(bad))] ^= rng.randint(1, 255)
        (tmp_path / "x.zip").write_bytes(bad)
        try:
            open_bundle(tmp_path / "x.zip", tmp_path / "new")
        except FileFormatError as error:
            assert "\n" not in str(error)
            assert sorted(p.name for p in tmp_path.iterdir()) == ["x.zip"]
        else:  # times of day and comments of entries mean nothing
            shutil.rmtree(tmp_path / "new")


PARTS = st.sampled_from(
    [
        "..",
        ".",
        "",
        "/",
        "\\",
        "C:",
        "~",
        "con",
        "venue.toml",
        "sessions",
        "0001",
        "patterns",
        "\0",
        "a.png",
    ]
)


@settings(max_examples=500, deadline=None)
@given(st.one_of(st.text(max_size=60), st.lists(PARTS, max_size=6).map("/".join)))
def test_allowed_names_stay_in_the_folder(name: str) -> None:
    if is_allowed(name):
        assert Path("/v", name).resolve().is_relative_to("/v")
        assert name.isascii() and name.isprintable()
        assert not {"\\", ":", " ", "~"} & set(name)
        assert ".." not in name.split("/") and not name.startswith("/")
