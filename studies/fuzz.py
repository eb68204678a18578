"""Files that are damaged or of strangers: each reader refuses them in a sentence, or reads them.

Bytes are changed, cut, inserted and copied; values of JSON and words of text are replaced by others of
wrong type, size and sign. Counted are exceptions that no command turns into a sentence, reads of more than
a second, and the memory of all. Writes studies/fuzz.json and studies/fuzz.md; `python -m studies fuzz`
remakes them in half an hour.
"""

import atexit
import json
import random
import re
import resource
import shutil
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from procam.errors import ProcamError
from procam.files.venue.load import load_venue
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies.measure import side_by_side, write
from studies.photometry import calibrate_venue
from studies.readable_files import make_files
from studies.readers import READERS, Reader

CASES = 20_000  # of each reader, as far as its time goes
LIMIT_S = 900.0  # of a reader
# files that a disk need not keep, which would take ten times as long
FOLDER = "/dev/shm" if Path("/dev/shm").is_dir() else None
MEMORY = 4 * 2**30  # of a reader's process; more would end others
HANG_S, SLOW_S = 10, 1.0  # wall time; CPU time, which other processes do not lengthen
OUTCOMES = "read", "different", "refused", "slow"
SIZE = SceneSize(  # of maps that are quick to read
    projectors=1, projector_size=(128, 80), camera_size=(200, 200), rays=64, map_size=64
)
STRANGE: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, float("nan"), float("inf"), 10**30, -0.5, 3.7),
    *("", "x", "../../x", "\x00", "é" * 300, "1e999", [], {}, [[1]], [1, 2], {"a": 1}),
)
DEEP = 100_000
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


def fuzz(reader: Reader, folder: Path, cases: int, seed: int = 0) -> Counter[str]:
    """How many cases were "read", "refused", "slow", or ended in another exception, by its place.

    "different" are those that were read, but not as the undamaged file.
    """
    path = folder / reader.path
    content, rng, found = path.read_bytes(), random.Random(f"{reader.name} {seed}"), Counter[str]()
    original, before = reader.read(path), signal.signal(signal.SIGALRM, _hangs)
    try:
        until = time.monotonic() + LIMIT_S
        for _ in range(cases):
            if time.monotonic() > until:
                break
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


@cache
def _made() -> Path:
    """A folder with all files, made once by each process; readers are damaged in copies of it."""
    folder = Path(tempfile.mkdtemp(dir=FOLDER))
    (folder / "venue").mkdir()
    (folder / "venue" / "venue.toml").write_text(venue_text("standard", SIZE))
    calibrate_venue(load_venue(folder / "venue"))
    make_files(folder)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    atexit.register(shutil.rmtree, folder)
    return folder


def _row(number: int) -> dict[str, Any]:
    reader = READERS[number]
    with tempfile.TemporaryDirectory(dir=FOLDER) as name:
        folder = shutil.copytree(_made(), Path(name) / "files")
        found = fuzz(reader, folder, CASES)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "reader": reader.name,
        "lossless": reader.lossless,
        "cases": sum(found.values()) - found["slow"],
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
        f"Up to {CASES} of each. Refused: in one sentence, exit code 2. Read, but otherwise: of files with "
        "checksums alone. Memory: most of the process so far.",
        "",
        "| file | cases | read | read, but otherwise | refused | other exceptions | over 1 s | memory |",
        "|---|---|---|---|---|---|---|---|",
    )
    for row in rows:
        found = row["found"]
        others = sum(n for kind, n in found.items() if kind not in OUTCOMES)
        counts = [str(found.get(kind, 0)) for kind in ("read", "different", "refused")]
        counts[1] = counts[1] if row["lossless"] else "-"
        counts += [str(others), str(found.get("slow", 0))]
        yield (
            f"| {row['reader']} | {row['cases']} | {' | '.join(counts)} | {row['memory_gib']:.2f} GiB |"
        )
