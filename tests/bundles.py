"""A venue with secrets, its session of a few frames, and bundles that were tampered with."""

import hashlib
import json
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from procam.files.bundle.manifest import Manifest
from procam.files.bundle.write import writing_bundle
from procam.files.images.pixels import write_image
from procam.files.session import Session
from procam.files.venue.load import Venue, load_venue
from procam.generators import result_of
from procam.model.frame import CameraSettings, Frame
from procam.model.plan import Plan, Shot
from simulators.scene import SceneSize
from simulators.template import venue_text

SIZE = SceneSize(projectors=1, projector_size=(64, 40), camera_size=(60, 60), rays=64)
WHITE = Shot("south-0000", "south", "patterns/south/0000.png", "white", (0.13,), "mono")
DARK = Shot("dark", "", "", "dark", (0.13, 6.5))
FRAME = "sessions/0001/captures/zenith/dark@0.13.tif"
PATTERN = "sessions/0001/patterns/south/0000.png"
SECRETS = ("s3cret", "10.1.2.3", "ttyS7", "acme", "annika", "2000000000")
Content = dict[str, bytes]


def make_venue(folder: Path) -> Venue:
    """A venue with a mask and a response in files, and secrets in each place that may have some."""
    text = venue_text("standard", SIZE).split("[simulated]")[0]
    text = text.replace('backend = "simulated"', 'backend = "acme"')
    text = text.replace('port = "backend"', 'port = "/dev/ttyS7"')
    text = text.replace('response = "linear"', 'response = "annika.csv"')
    text = text.replace("[capture]", '[acme]\nhost = "10.1.2.3"\npassword = "s3cret"\n\n[capture]')
    text = text.replace("[projectors.south]", '[projectors.south]\nmasks = ["annika/desk.png"]')
    text = text.replace(
        "[screen]", '[screen]\nprotected = [[[0, 30], [9, 30], [5, 40]], "annika/desk.png"]'
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "venue.toml").write_text(text + "# annika's dome\n", encoding="utf-8")
    (folder / "annika.csv").write_text("level,light\n0,0\n0.5,0.25\n1,1\n")
    write_image(folder / "annika" / "desk.png", np.eye(64, dtype=np.uint8)[:40] * np.uint8(200))
    return load_venue(folder)


def take_session(venue: Venue, name: str = "0001") -> Session:
    """Three frames of two shots, with times of a wall clock."""
    session = Session(venue.directory / "sessions" / name)
    session.write_plan(Plan((DARK, WHITE)), {WHITE.pattern: np.full((40, 64), 255, np.uint8)})
    rng = np.random.default_rng(1)
    for i, (shot, exposure) in enumerate([(DARK, 0.13), (DARK, 6.5), (WHITE, 0.13)]):
        shape = (60, 60) if shot.pixel_format == "mono" else (60, 60, 3)
        counts = rng.integers(0, 4096, shape).astype(np.uint16)
        at = 2e9 + 10 * i
        frame = Frame(counts, CameraSettings(exposure, shot.pixel_format), at, at + exposure)
        session.store("zenith", shot, exposure, frame)
    return session


def contents(bundle: Path) -> Content:
    """Files of a bundle by name."""
    with zipfile.ZipFile(bundle) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def entry(name: str, mode: int = stat.S_IFREG | 0o644) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    info.external_attr = mode << 16
    return info


def write_zip(path: Path, files: Content) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(entry(name), content)
    return path


def relisted(files: Content) -> Content:
    """The files with a manifest that fits them, as somebody would forge it."""
    document = json.loads(files["manifest.json"])
    document["files"] = {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in files.items()
        if name != "manifest.json"
    }
    return {**files, "manifest.json": json.dumps(document).encode()}


def with_manifest(files: Content, change: Callable[[dict], object]) -> Content:
    """The files with a changed manifest."""
    document = json.loads(files["manifest.json"])
    change(document)
    return {**files, "manifest.json": json.dumps(document).encode()}


def write_bundle(venue: Venue, session: Session, out: Path) -> Manifest:
    """Write a bundle to its end."""
    return result_of(writing_bundle(venue, session, out))
