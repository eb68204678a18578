"""Everything that procam reads of files and pipes that another program or a person may have written.

Each `Reader` names a file in the folder that `readable_files.make_files` fills, and what reads it.
`studies.fuzz` damages them; tests/workflow/test_fuzz.py refuses a reader of procam that none of these runs.
"""

import hashlib
import io
import json
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from procam.errors import FileFormatError, InputError
from procam.files.bundle.original import original_figures
from procam.files.bundle.read import open_bundle, read_manifest
from procam.files.calibration import load_calibration, load_dome, metered_white
from procam.files.code_file import load_code
from procam.files.dataset import load_dataset
from procam.files.form_factors import read_form_factors
from procam.files.history.figures import calibration_figures
from procam.files.history.read import figures_csv, list_runs, verify_unchanged
from procam.files.history.record import recorded
from procam.files.images.layers import read_channels
from procam.files.images.movies import MovieReader
from procam.files.images.photos import load_response, read_photo
from procam.files.images.pixels import read_header
from procam.files.images.stills import read_picture, read_still
from procam.files.lock import locked
from procam.files.mesh_file import read_mesh
from procam.files.meter import read_meter
from procam.files.output_log import OutputLog
from procam.files.seats import other_seats
from procam.files.session import Session
from procam.files.system import try_lock
from procam.files.venue.edit import Key, edited
from procam.files.venue.load import load_venue
from procam.files.venue.masks import read_mask
from procam.files.venue.mesh_screen import MeshFile, read_room
from procam.files.versions import calibrated_session, calibration_in_use, solved_sessions
from procam.interfaces.report.stored_loop import read_loop
from procam.model.plan import Plan
from procam.model.screen import RoomScreen
from procam.workflows.capture.photo_index import read_index
from procam.workflows.capture.settings import read_settings
from procam.workflows.playout.pipe_clip import read_frame
from procam.workflows.playout.sources import read_clip_frame
from procam.workflows.refine.stored_pictures import read_frames, read_square
from simulators.room_obj import GROUPS
from studies.preference import answers, plan
from studies.readable_files import CALIBRATION, ROOM, SESSION, SHOTS, WANTED, all_files, rounds_in

WHITE_LIGHT = 0.9  # of which a picture may not become black by a profile


@dataclass(frozen=True)
class Reader:
    """A kind of file: where it is in the folder of `make_files`, and what reads it.

    A `lossless` one has checksums: what it reads as must not change without a word.
    """

    name: str
    path: str
    read: Callable[[Path], object]
    lossless: bool = False


def _session(path: Path) -> object:
    session = Session(next(p for p in path.parents if p.parent.name == "sessions"))
    shot = session.read_plan().shots[0]
    return session.load("zenith", shot, shot.exposures_s[0], (200, 200))


def _movie(path: Path) -> object:
    """What is shown when; a movie with a note is as good as refused."""
    with MovieReader(path) as movie:
        shown = [(frame.pts, hash(frame.rgb.tobytes())) for frame in movie]
        if movie.note:
            raise FileFormatError(movie.note)
        return shown


def _settings(path: Path) -> object:
    return read_settings(Session(path.parents[2]), path.parent.name)


def _edited(path: Path) -> object:
    """As the commands of `procam lens` write into it."""
    camera = next(iter(load_venue(path.parent).cameras), "")
    return edited(path.parent, camera, [Key("glare", 0.003, "0.0001"), Key("k", [0.0] * 4)])


def _rounds(path: Path) -> object:
    rounds = rounds_in(path.parent)
    return rounds.ask([WANTED]), rounds.order()


def _recorded_calibration(path: Path) -> object:
    """As commands read one that the history knows: all its numbers, and hashes of its maps."""
    verify_unchanged(path.parents[2], path.parent)
    calibration = load_calibration(path.parent)
    return calibration.feedback.value.tolist(), calibration.maps.albedo.tobytes()


def _listed(path: Path) -> object:
    """What commands take from a calibration that they do not load."""
    venue_dir = path.parents[2]
    seats = list(other_seats(venue_dir, venue_dir / "calibrations" / "0001"))
    session = calibrated_session(venue_dir), solved_sessions(venue_dir), metered_white(path.parent)
    return seats, session, original_figures(venue_dir, "0001"), calibration_figures(path)


def _history(path: Path) -> object:
    """As `procam venue status` reads it."""
    _remove_logs(path)
    return list_runs(path.parent), figures_csv(path.parent)


def _record(path: Path) -> object:
    """As every command writes it; figures of earlier runs stay."""
    _remove_logs(path)
    with recorded(path.parent, "verify"):
        pass
    return figures_csv(path.parent)


def _remove_logs(path: Path) -> None:
    for end in ("-wal", "-shm"):
        path.with_name(f"{path.name}{end}").unlink(missing_ok=True)


def _bundle(path: Path) -> object:
    """Each file that a bundle unpacks to."""
    read_manifest(path)
    return _unpacked(path, path.with_name("unpacked"))


def _unpacked(bundle: Path, folder: Path) -> object:
    shutil.rmtree(folder, ignore_errors=True)
    open_bundle(bundle, folder)
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _forged(path: Path) -> object:
    """A bundle of the files of a folder; its manifest fits them, unless that is what was changed."""
    folder = next(p for p in path.parents if p.name == "forged")
    files = {p.relative_to(folder).as_posix(): p.read_bytes() for p in all_files(folder)}
    if path.name != "manifest.json":
        document = json.loads(files["manifest.json"])
        document["files"] = {
            name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in files.items()
            if name != "manifest.json"
        }
        files["manifest.json"] = json.dumps(document).encode()
    bundle = folder.with_name("forged.zip")
    with zipfile.ZipFile(bundle, "w") as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return _unpacked(bundle, folder.with_name("unpacked"))


def _dataset(path: Path) -> object:
    folder = next(p for p in path.parents if p.name == "dataset")
    sessions = load_dataset(folder, folder / "work")
    return [
        (each.name, each.room, each.seed, each.truth.feedback.value.tolist()) for each in sessions
    ]


def _profile(path: Path) -> object:
    """A TIFF with an ICC profile."""
    data = np.frombuffer(path.read_bytes() or b"\0", np.uint8)
    spec = oiio.ImageSpec(4, 4, 3, "uint8")
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(data)}]"), data)
    return _not_black(_written(path.with_suffix(".tif"), spec, np.uint8))


def _primaries(path: Path) -> object:
    """An EXR with so many chromaticities."""
    data = path.read_bytes()
    points = struct.unpack(f"<{len(data) // 4}f", data[: len(data) // 4 * 4])
    spec = oiio.ImageSpec(4, 4, 3, "float")
    if len(points) > 1:
        spec.attribute("chromaticities", oiio.TypeDesc(f"float[{len(points)}]"), points)
    return _not_black(_written(path.with_suffix(".exr"), spec, np.float32))


def _chunks(path: Path) -> object:
    """A PNG with chunks between header and pixels, whatever is in them."""
    rows = (b"\0" + 12 * b"\xff") * 4
    parts = [(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0))]
    data = path.read_bytes()
    while data:
        (length,) = struct.unpack(">H", data[:2].rjust(2, b"\0"))
        parts.append((data[2:6].ljust(4, b"x"), data[6 : 6 + length]))
        data = data[6 + length :]
    parts += [(b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    whole = b"".join(
        struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in parts
    )
    png = path.with_suffix(".png")
    png.write_bytes(b"\x89PNG\r\n\x1a\n" + whole)
    return _not_black(png)


def _written(path: Path, spec: oiio.ImageSpec, kind: type) -> Path:
    white = np.full((4, 4, 3), 255 if kind is np.uint8 else 1, kind)
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), spec)
    output.write_image(white)
    output.close()
    return path


def _not_black(path: Path) -> object:
    """What a white picture is read as: white; one with a profile that is only named is as good as refused."""
    still = read_still(path)
    if still.note and not still.converted:
        raise FileFormatError(still.note)
    top = 255 if still.rgb.dtype == np.uint8 else 1.0
    assert still.rgb.min() >= WHITE_LIGHT * top, "white is no longer white"
    return still.rgb


def _answers(path: Path) -> object:
    return answers.read_answers(plan.read_plan(path.parent), [path])


def _preference(path: Path) -> object:
    read = plan.read_plan(path.parent)
    return read, answers.read_answers(read, [path.with_name("answers.csv")])


def _output_log(path: Path) -> object:
    kept = OutputLog(path, "key").kept(path.with_name("code.toml"), [1, 2])
    if kept is None:
        raise FileFormatError("its output is made again")
    return kept


def _pipe(path: Path) -> object:
    stream, frame = io.BytesIO(path.read_bytes()), np.zeros((48, 64, 3), np.uint8)
    return [frame.tobytes() for number in range(3) if read_frame(stream, frame, number)]


def _mesh(path: Path) -> object:
    return read_room(MeshFile(path, GROUPS, (1536, 2048)))


def _stored_mesh(path: Path) -> object:
    """What a calibration compares with the digest that it has."""
    return RoomScreen.of_mesh(read_mesh(path), ROOM.lit, ROOM.others).digest


def _factors(path: Path) -> object:
    """The light that faces see, each with another light."""
    light = np.arange(len(ROOM.room.faces), dtype=float)[:, None]
    return read_form_factors(path, ROOM).gather(light).tobytes()


def _index(path: Path) -> object:
    return read_index(path, Plan(SHOTS), [path.with_name("a.png"), path.with_name("b.png")])


def _other_holds(path: Path) -> object:
    """What the refusal says of the process that holds a venue."""
    with path.open("rb") as file:
        try_lock(file)
        try:
            with locked(path.parent, "verify"):
                raise AssertionError("two processes hold one venue")
        except InputError as error:
            return str(error)


CALIBRATED = f"{CALIBRATION}/calibration.json"
READERS = (
    Reader("calibration.json", CALIBRATED, lambda p: load_calibration(p.parent)),
    Reader("calibration.json that is recorded", CALIBRATED, _recorded_calibration, lossless=True),
    Reader("calibration.json, not loaded", CALIBRATED, _listed),
    Reader("maps of the dome", f"{CALIBRATION}/maps/dome.exr", lambda p: load_dome(p.parents[1])),
    Reader("maps of a projector", f"{CALIBRATION}/maps/south.exr", read_channels),
    Reader("in-use", "venue/calibrations/in-use", lambda p: calibration_in_use(p.parents[1])),
    Reader("history.sqlite", "venue/history.sqlite", _history, lossless=True),
    Reader("history.sqlite, written", "small/history.sqlite", _record, lossless=True),
    Reader(".lock", "locked/.lock", _other_holds),
    Reader("plan.json", f"{SESSION}/plan.json", _session),
    Reader("index.jsonl", f"{SESSION}/captures/zenith/index.jsonl", _session),
    Reader("wanted.json", "venue/sessions/refine-0001/wanted.json", _rounds),
    Reader("settings.json", f"{SESSION}/captures/zenith/settings.json", _settings),
    Reader("frame", f"{SESSION}/captures/zenith/dark@0.13.tif", _session),
    Reader("venue.toml", "venue/venue.toml", lambda p: load_venue(p.parent)),
    Reader("venue.toml that is edited", "venue/venue.toml", _edited),
    Reader("bundle", "bundle.zip", _bundle, lossless=True),
    Reader("manifest.json of a bundle", "forged/manifest.json", _forged),
    Reader("venue.toml of a bundle", "forged/venue.toml", _forged),
    Reader("plan.json of a bundle", "forged/sessions/0001/plan.json", _forged),
    Reader("dataset.json", "dataset/dataset.json", _dataset),
    Reader("bundle of a data set", "dataset/bundles/one.zip", _dataset, lossless=True),
    Reader("PNG", "still.png", read_still),
    Reader("TIFF", "still.tif", read_still),
    Reader("EXR", "still.exr", read_still),
    Reader("JPEG", "photo.jpg", read_photo),
    Reader("header of a picture", "still.png", read_header),
    Reader(
        "content", "square.png", lambda p: (read_picture(p), read_square(p), read_clip_frame(p))
    ),
    Reader("frames of a projector", "frames/south.png", lambda p: read_frames(p.parent)),
    Reader("mask", "still.png", lambda p: read_mask(p, (64, 48))),
    Reader("ICC profile", "profile.icc", _profile),
    Reader("chunks of PNG", "chunks.bin", _chunks),
    Reader("chromaticities of EXR", "primaries.bin", _primaries),
    Reader("FFV1 in Matroska", "movie.mkv", _movie, lossless=True),
    Reader("ProRes in QuickTime", "movie.mov", _movie),
    Reader("frames on a pipe", "frames.rgb", _pipe),
    Reader("mesh, OBJ", "room.obj", _mesh),
    Reader("mesh, NPZ", "screen.npz", _stored_mesh),
    Reader("loop.json", "loop/loop.json", read_loop),
    Reader("code.toml", "code.toml", load_code),
    Reader("form factors", "form-factors.npz", _factors, lossless=True),
    Reader("response.csv", "response.csv", lambda p: load_response(p.name, p.parent)),
    Reader("meter.csv", "meter.csv", lambda p: read_meter(p, ["south"])),
    Reader("photographs.csv", "photographs.csv", _index),
    Reader("plan.json of a preference test", "asked/plan.json", _preference),
    Reader("answers.csv", "asked/answers.csv", _answers),
    Reader("log of outputs", "outputs.jsonl", _output_log, lossless=True),
)
