"""Files that are damaged or of strangers: each reader refuses them in a sentence, or reads them.

Bytes are changed, cut, inserted and copied; values of JSON and words of text are replaced by others of
wrong type, size and sign. Counted are exceptions that no command turns into a sentence, reads of more than
a second, and the memory of all.
"""

import json
import random
import re
import resource
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np

import procam.estimate.calibration
from procam.errors import FileFormatError, ProcamError
from procam.files.calibration import load_calibration, load_dome
from procam.files.code_file import load_code
from procam.files.images.layers import read_channels
from procam.files.images.movies import MovieReader
from procam.files.images.photos import load_response, read_photo
from procam.files.images.pixels import write_image
from procam.files.images.stills import read_still
from procam.files.meter import read_meter
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.workflows.capture.settings import keep_settings, read_settings
from procam.workflows.photographs.driven import Wanted
from procam.workflows.photographs.rounds import Rounds
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies.measure import side_by_side, write
from studies.photometry import calibrate_venue

MAP_SIZE = 64  # of the dome's maps: quick to read
CASES = 20_000  # of each reader
HANG_S, SLOW_S = 10, 1.0  # wall time; CPU time, which other processes do not lengthen
OUTCOMES = "read", "different", "refused", "slow"
SIZE = SceneSize(projectors=1, projector_size=(128, 80), camera_size=(200, 200), rays=64)
STRANGE: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, float("nan"), float("inf"), 10**30, -0.5, 3.7),
    *("", "x", "../../x", "\x00", "é" * 300, "1e999", [], {}, [[1]], [1, 2], {"a": 1}),
)
CODE = (
    'order = ["white", "black", "columns-phase", "columns-gray", "rows-phase", "rows-gray"]\n'
    + "".join(
        f"[{axis}]\nperiods_px = [16, 18]\nsteps = 3\ngray_cell_px = 16\n"
        for axis in ("columns", "rows")
    )
)
METER = "projector,patch,azimuth_deg,elevation_deg,Y,x,y\n" + "".join(
    f"south,{patch},10,40,{light},0.31,0.33\n"
    for patch, light in (("white", 11.5), ("black", 0.02))
)


DEEP = 100_000
WANTED = Wanted({"south": np.zeros((80, 128, 3), np.float32)}, 0.1)
FOREIGN: dict[str, bytes] = {
    "nothing": b"",
    "zeros": bytes(1000),
    "no text": b"\xff\xfe" * 50,
    "deep list": b"[" * DEEP + b"]" * DEEP,
    "deep object": b'{"a":' * DEEP + b"1" + b"}" * DEEP,
    "deep TOML": b"a = " + b"[" * 50_000 + b"]" * 50_000,
    "deep tables": b"a = " + b"{b=" * 20_000 + b"1" + b"}" * 20_000,
    "long key": b".".join([b"a"] * 50_000) + b" = 1\n",
    "many tables": b"".join(b"a%d.b.c = 1\n" % i for i in range(30_000)),
    "huge number": b"a = 1" + b"0" * 6000,
    "huge JSON number": b'{"a": 1' + b"0" * 6000 + b"}",
    "control characters": b"a = '\x01\x1b[31m'\n",
    "GIF": b"GIF89a\1\0\1\0\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\1\0\1\0\0\2\2D\1\0;",
}


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


def _rounds(path: Path) -> object:
    camera = load_venue(path.parents[2]).cameras["zenith"]
    rounds = Rounds(path.parent, camera, 0.1, "a sky")
    return rounds.ask([WANTED]), rounds.order()


CALIBRATION, SESSION = "venue/calibrations/0001", "venue/sessions/0001"
READERS = (
    Reader(
        "calibration.json", f"{CALIBRATION}/calibration.json", lambda p: load_calibration(p.parent)
    ),
    Reader("maps of the dome", f"{CALIBRATION}/maps/dome.exr", lambda p: load_dome(p.parents[1])),
    Reader("maps of a projector", f"{CALIBRATION}/maps/south.exr", read_channels),
    Reader("plan.json", f"{SESSION}/plan.json", _session),
    Reader("index.jsonl", f"{SESSION}/captures/zenith/index.jsonl", _session),
    Reader("wanted.json", "venue/sessions/refine-0001/wanted.json", _rounds),
    Reader("settings.json", f"{SESSION}/captures/zenith/settings.json", _settings),
    Reader("frame", f"{SESSION}/captures/zenith/dark@0.13.tif", _session),
    Reader("venue.toml", "venue/venue.toml", lambda p: load_venue(p.parent)),
    Reader("PNG", "still.png", read_still),
    Reader("TIFF", "still.tif", read_still),
    Reader("EXR", "still.exr", read_still),
    Reader("JPEG", "photo.jpg", read_photo),
    Reader("FFV1 in Matroska", "movie.mkv", _movie, lossless=True),
    Reader("ProRes in QuickTime", "movie.mov", _movie),
    Reader("code.toml", "code.toml", load_code),
    Reader("response.csv", "response.csv", lambda p: load_response(p.name, p.parent)),
    Reader("meter.csv", "meter.csv", lambda p: read_meter(p, ["south"])),
)


def make_files(folder: Path) -> None:
    """Add pictures, movies and tables to a folder whose `venue` has a session and a calibration."""
    light = np.random.default_rng(0).random((48, 64, 3))
    write_image(folder / "still.png", (light * 255).astype(np.uint8))
    write_image(folder / "still.tif", (light * 65535).astype(np.uint16))
    write_image(folder / "still.exr", light.astype(np.float32), ("R", "G", "B"))
    for name, codec, layout in (
        ("movie.mkv", "ffv1", "bgr0"),
        ("movie.mov", "prores_ks", "yuv422p10le"),
    ):
        with av.open(str(folder / name), "w") as movie:
            stream = movie.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, layout
            for shift in range(4):
                rgb = np.roll((light * 255).astype(np.uint8), shift, axis=1)
                frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
                movie.mux(stream.encode(frame.reformat(format=layout)))
            movie.mux(stream.encode())
    _rounds(folder / "venue/sessions/refine-0001/wanted.json")
    keep_settings(Session(folder / SESSION), "zenith", {"ISO": 100.0, "aperture f/": 4.0})
    import cv2  # noqa: PLC0415 - for one JPEG

    cv2.imwrite(str(folder / "photo.jpg"), (light * 255).astype(np.uint8))
    (folder / "code.toml").write_text(CODE)
    (folder / "meter.csv").write_text(METER)
    (folder / "response.csv").write_text("level,light\n0,0\n0.3,0.1\n0.8,0.6\n1,1\n")


def fuzz(reader: Reader, folder: Path, cases: int, seed: int = 0) -> Counter[str]:
    """How many cases were "read", "refused", "slow", or ended in another exception, by its place.

    "different" are those that were read, but not as the undamaged file.
    """
    path = folder / reader.path
    content, rng, found = path.read_bytes(), random.Random(f"{reader.name} {seed}"), Counter[str]()
    original, before = reader.read(path), signal.signal(signal.SIGALRM, _hangs)
    try:
        for _ in range(cases):
            path.write_bytes(changed(content, path.suffix, rng))
            started = time.process_time()
            signal.alarm(HANG_S)
            found[_outcome(reader, path, original)] += 1
            signal.alarm(0)
            found["slow"] += time.process_time() - started > SLOW_S
    finally:
        path.write_bytes(content)
        signal.signal(signal.SIGALRM, before)
    return +found


def foreign(reader: Reader, folder: Path) -> dict[str, str]:
    """What becomes of each of `FOREIGN` in the place of a file: "refused", "read", "slow" or a mistake."""
    path, found = folder / reader.path, dict[str, str]()
    content, original = path.read_bytes(), reader.read(path)
    for kind, other in FOREIGN.items():
        path.write_bytes(other)
        started = time.process_time()
        found[kind] = _outcome(reader, path, original)
        if time.process_time() - started > SLOW_S:
            found[kind] = "slow"
    path.write_bytes(content)
    return found


def _outcome(reader: Reader, path: Path, original: object) -> str:
    try:
        now = reader.read(path)
    except (ProcamError, OSError):
        return "refused"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"[
            :120
        ]
    return "different" if reader.lossless and now != original else "read"


def _hangs(*_: object) -> None:
    raise TimeoutError("no end in sight")


def changed(content: bytes, suffix: str, rng: random.Random) -> bytes:
    """The content of a file with one mistake."""
    if suffix in (".json", ".jsonl") and rng.random() < 0.6:
        return _json(content, suffix, rng)
    if suffix in (".toml", ".csv") and rng.random() < 0.6:
        words = list(re.finditer(rb"[^\s,=\[\]]+", content))
        word, new = rng.choice(words), str(rng.choice(STRANGE)).encode()
        return content[: word.start()] + new + content[word.end() :]
    return _bytes(bytearray(content), rng)


def _bytes(data: bytearray, rng: random.Random) -> bytes:
    place, how = rng.randrange(len(data)), rng.randrange(6)
    if how == 0:
        del data[place:]
    elif how == 1:
        for _ in range(rng.choice((1, 3, 20))):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif how == 2:  # headers stand at the beginning
        data[rng.randrange(min(400, len(data)))] = rng.choice((0, 1, 127, 128, 255))
    elif how == 3:
        data[place:place] = rng.randbytes(rng.randrange(1, 40))
    elif how == 4:
        del data[place : place + rng.randrange(1, 60)]
    else:
        other = rng.randrange(len(data))
        data[place : place + 30] = data[other : other + 30]
    return bytes(data)


def _json(content: bytes, suffix: str, rng: random.Random) -> bytes:
    """JSON in which one value or key is another, or is missing."""
    lines = content.decode().splitlines() if suffix == ".jsonl" else [content.decode()]
    line = rng.randrange(len(lines))
    document = json.loads(lines[line])
    place, key = rng.choice(list(_places(document)))
    how = rng.random()
    if how < 0.2:
        del place[key]
    elif how < 0.3 and isinstance(place, dict):
        place[rng.choice(("x", "../y", "", "a.b"))] = place.pop(key)
    else:
        place[key] = rng.choice(STRANGE)
    lines[line] = json.dumps(document)
    return "\n".join([*lines, ""]).encode()


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    entries = document.items() if isinstance(document, dict) else enumerate(document[:6])
    for key, value in entries:
        yield document, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _row(number: int) -> dict[str, Any]:
    reader = READERS[number]
    procam.estimate.calibration.MAP_SIZE = MAP_SIZE
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "venue").mkdir()
        (folder / "venue" / "venue.toml").write_text(venue_text("standard", SIZE))
        calibrate_venue(load_venue(folder / "venue"))
        make_files(folder)
        found = fuzz(reader, folder, CASES)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "reader": reader.name,
        "lossless": reader.lossless,
        "found": dict(found),
        "memory_gib": memory,
    }


def main() -> None:
    """Run all readers and write studies/fuzz.json and .md."""
    rows = side_by_side(_row, range(len(READERS)))
    write("fuzz", {"cases": CASES, "rows": rows}, _table(rows))


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# Damaged files and files of strangers",
        "",
        f"{CASES} of each. Refused: in one sentence, exit code 2. Read, but otherwise: of files with "
        "checksums alone. Memory: most of the process so far.",
        "",
        "| file | read | read, but otherwise | refused | other exceptions | slower than 1 s | memory |",
        "|---|---|---|---|---|---|---|",
    )
    for row in rows:
        found = row["found"]
        others = sum(n for kind, n in found.items() if kind not in OUTCOMES)
        counts = [str(found.get(kind, 0)) for kind in ("read", "different", "refused")]
        counts[1] = counts[1] if row["lossless"] else "-"
        yield (
            f"| {row['reader']} | {' | '.join(counts)} | {others} | {found.get('slow', 0)} | "
            f"{row['memory_gib']:.2f} GiB |"
        )
