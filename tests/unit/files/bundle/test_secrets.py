"""A venue with every key that venue.toml can hold, and secrets in every file: what leaves it."""

import json
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from bundles import contents, relisted, take_session, write_bundle, write_zip
from picture_files import write_with_header
from venue_keys import EVERY_KEY, OF_ROOMS, OF_SERVERS, PLANTED, keys_of, leaves, with_server

from procam.files.bundle.read import open_bundle, read_manifest
from procam.files.session import Session
from procam.files.toml import read_toml
from procam.files.venue.load import load_venue
from procam.files.venue.sharing import PRIVATE, SHARED, paths_of

ALL = ", ".join(PLANTED.values())
FOREIGN = OF_ROOMS | OF_SERVERS  # keys that the venue of this test cannot have
HAND_MADE = """
[unattended]
interlock = "touch CANARY"
begin = "00:00"
end = "23:59"
power_on = true
notify = "touch CANARY"

[history]
keep_sessions = 1

[acme]
run = "touch CANARY"
"""


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A session of a venue in a folder that has a secret name itself."""
    return _taken(tmp_path, EVERY_KEY)


def _taken(tmp_path: Path, text: str) -> Session:
    folder = tmp_path / "annika" / "venue"
    (folder / "annika").mkdir(parents=True)
    (folder / "venue.toml").write_text(text, encoding="utf-8")
    _write_named(folder / "annika" / "desk.png", np.eye(64, dtype=np.uint8)[:40] * np.uint8(200))
    session = take_session(load_venue(folder))
    captures = session.directory / "captures" / "zenith"
    (captures / "response.csv").write_text("level,light\n0,0\n0.5,0.25\n1,1\n")
    for frame in captures.glob("*.tif"):
        pixels = oiio.ImageBuf(str(frame)).get_pixels(oiio.UINT16)
        _write_named(frame, pixels)
    for pattern in session.directory.glob("patterns/*/*.png"):
        _write_named(pattern, oiio.ImageBuf(str(pattern)).get_pixels(oiio.UINT8))
    _plant_in_tables(session)
    return session


def _write_named(path: Path, pixels: np.ndarray) -> None:
    """A picture whose header has every secret, and the place where it was taken."""
    keys = ("ImageDescription", "Artist", "HostComputer", "Exif__BodySerialNumber", "Copyright")
    path.unlink(missing_ok=True)
    write_with_header(path, pixels, GPS__Latitude=(48.0, 8.0, 13.75), **dict.fromkeys(keys, ALL))


def _plant_in_tables(session: Session) -> None:
    """Secrets in the plan, the index, logs, settings of devices, and the calibration of the session."""
    folder, venue = session.directory, session.directory.parents[1]
    plan = json.loads((folder / "plan.json").read_text())
    plan["shots"][1]["detail"] = {"by": "annika", "code": "micro-phase"}
    (folder / "plan.json").write_text(json.dumps(plan))
    index = folder / "captures" / "zenith" / "index.jsonl"
    index.write_text(index.read_text().replace('{"shot"', f'{{"by": "{ALL}", "shot"'))
    for name in ("log.json", "settings.json", "venue.toml", "notes.txt"):
        (folder / name).write_text(ALL)
    for name in ("notes.txt", "history.sqlite", "seats.json", "logs.txt"):
        (venue / name).write_text(ALL)
    calibration = venue / "calibrations" / "0001"
    calibration.mkdir(parents=True)
    named = {"value": [0.1] * 3, "sigma": [0.01] * 3, "unit": ALL, "note": ALL, "by": ALL}
    document = {
        "schema_version": 1,
        "feedback": named,
        "albedo": {**named, "value": [0.5, ALL, 0.5]},
        "quality": {
            "coverage": {**named, "goal": {"op": ">=", "value": 0.9, "by": ALL}, "pass": True},
            "additivity_error": {"value": ALL, "goal": {"op": ALL, "value": ALL}, "samples": ALL},
            ALL: named,
        },
        "provenance": {
            **{"session": "0001", "notes": [ALL], "backends": ["acme"], "input_sha256": ALL},
            **{"python": ALL, "versions": {ALL: "1.0", "numpy": ALL, "scipy": "1.14.1"}},
        },
    }
    (calibration / "calibration.json").write_text(json.dumps(document))


def test_the_venue_has_every_key_and_every_secret(session: Session) -> None:
    venue = session.directory.parents[1]
    assert keys_of(read_toml(venue / "venue.toml")) == set(leaves()) - FOREIGN
    everything = b"".join(p.read_bytes() for p in venue.rglob("*") if p.is_file())
    assert all(secret.encode() in everything for secret in PLANTED.values())
    assert all(secret in EVERY_KEY for name, secret in PLANTED.items() if name not in ELSEWHERE)


ELSEWHERE = ("place of a photograph", "time of day")  # not in venue.toml


def test_what_passes_is_the_list(session: Session, tmp_path: Path) -> None:
    venue = load_venue(session.directory.parents[1])
    manifest = write_bundle(venue, session, tmp_path / "out.zip")
    opened = open_bundle(tmp_path / "out.zip", tmp_path / "new")
    assert keys_of(read_toml(tmp_path / "new" / "venue.toml")) == set(paths_of(SHARED)) - FOREIGN
    named = {path.replace("zenith", "*").replace("south", "*") for path in manifest.redacted}
    assert named >= {*paths_of(PRIVATE), "tables of backends"}
    assert opened == manifest == read_manifest(tmp_path / "out.zip")  # nothing more to leave out


def test_keys_of_a_media_server_pass_too(tmp_path: Path) -> None:
    session = _taken(tmp_path, with_server(EVERY_KEY))
    write_bundle(load_venue(session.directory.parents[1]), session, tmp_path / "out.zip")
    open_bundle(tmp_path / "out.zip", tmp_path / "new")
    assert keys_of(read_toml(tmp_path / "new" / "venue.toml")) > OF_SERVERS


def test_no_secret_is_in_the_bundle(session: Session, tmp_path: Path) -> None:
    out = tmp_path / "out.zip"
    write_bundle(load_venue(session.directory.parents[1]), session, out)
    open_bundle(out, tmp_path / "new")
    pictures = [p for p in (tmp_path / "new").rglob("*") if p.suffix in (".png", ".tif")]
    headers = [oiio.ImageInput.open(str(path)).spec().serialize("text") for path in pictures]
    with zipfile.ZipFile(out) as archive:
        texts = [archive.read(info) for info in archive.infolist()]
        texts += [str(archive.infolist()).encode(), archive.comment]
    texts += [*(header.encode() for header in headers), out.read_bytes()]
    texts += [path.read_bytes() for path in (tmp_path / "new").rglob("*") if path.is_file()]
    for name, secret in {**PLANTED, "the folder": str(tmp_path)}.items():
        assert not [text[:60] for text in texts if secret.encode() in text], name
    assert not [header for header in headers if "GPS" in header or "Artist" in header]
    figures = json.loads(contents(out)["original/calibration.json"])
    assert figures["feedback"] == {"value": [0.1] * 3, "sigma": [0.01] * 3}
    assert figures["quality"]["coverage"]["goal"] == {"op": ">=", "value": 0.9}
    assert figures["provenance"]["versions"]["scipy"] == "1.14.1"


def test_marks_get_numbers_wherever_they_are_named(session: Session, tmp_path: Path) -> None:
    write_bundle(load_venue(session.directory.parents[1]), session, tmp_path / "out.zip")
    open_bundle(tmp_path / "out.zip", tmp_path / "new")
    venue = load_venue(tmp_path / "new")
    assert [mark.name for mark in venue.fiducials] == ["mark-1", "mark-2"]
    assert [(d.a, d.b) for d in venue.distances] == [("mark-1", "south")]


def test_a_mark_that_is_a_tag_keeps_its_name(session: Session, tmp_path: Path) -> None:
    path = session.directory.parents[1] / "venue.toml"
    path.write_text(
        path.read_text()
        .replace(
            'name = "Sternwarte Musterstadt, 10.1.2.3"', 'name = "tag 3"\nelevation_deg = 40.0'
        )
        .replace("azimuth_deg = 90.0", "azimuth_deg = 10.0")
    )
    venue = load_venue(path.parent)
    assert venue.tags[0].name == "tag 3"
    write_bundle(venue, session, tmp_path / "out.zip")
    open_bundle(tmp_path / "out.zip", tmp_path / "new")
    assert [f.name for f in load_venue(tmp_path / "new").fiducials] == ["mark-1", "tag 3"]


def test_a_hand_made_bundle_opens_without_its_commands(session: Session, tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    write_bundle(load_venue(session.directory.parents[1]), session, tmp_path / "good.zip")
    files = contents(tmp_path / "good.zip")
    text = files["venue.toml"].decode() + HAND_MADE.replace("CANARY", str(canary))
    text = text.replace("[cameras.zenith]", '[cameras.zenith]\nbackend = "acme"')
    text += '[projectors.south.control]\nprotocol = "escvp21"\nport = "/dev/ttyS7"\n'
    bundle = write_zip(tmp_path / "x.zip", relisted({**files, "venue.toml": text.encode()}))
    manifest = open_bundle(bundle, tmp_path / "new")
    assert keys_of(read_toml(tmp_path / "new" / "venue.toml")) == set(paths_of(SHARED)) - FOREIGN
    assert not [p for p in (tmp_path / "new").rglob("*.toml") if "CANARY" in p.read_text()]
    opened = load_venue(tmp_path / "new")
    assert opened.table.unattended is None and not any(opened.backends.values())
    keys = ("unattended", "history", "cameras.zenith.backend", "projectors.south.control")
    named = [f"{key} (when it was opened)" for key in (*keys, "tables of backends")]
    assert set(named) <= set(manifest.redacted)
    stored = json.loads((tmp_path / "new" / "manifest.json").read_text())
    assert stored["redacted"] == manifest.redacted
    written = (tmp_path / "new" / "venue.toml").stat().st_size
    assert stored["files"]["venue.toml"]["bytes"] == written
    assert not canary.exists()


def test_lines_of_a_manifest_do_not_steer_a_terminal(session: Session, tmp_path: Path) -> None:
    write_bundle(load_venue(session.directory.parents[1]), session, tmp_path / "good.zip")
    files = contents(tmp_path / "good.zip")
    document = json.loads(files["manifest.json"])
    document |= {"procam": "1\x1b[2J", "redacted": ["\x1b]0;x\x07\u202e"]}
    bundle = write_zip(
        tmp_path / "x.zip", {**files, "manifest.json": json.dumps(document).encode()}
    )
    manifest = read_manifest(bundle)
    assert (manifest.procam, manifest.redacted) == ("1?[2J", ["?]0;x??"])
