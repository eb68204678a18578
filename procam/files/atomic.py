"""Writes that survive a kill: temporary name, flush to disk, rename; logs that lose no whole line."""

import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from secrets import token_hex
from zlib import crc32

from procam.errors import FileFormatError
from procam.files.system import flush, is_running, open_here

SPARE_BYTES = 65536  # more than a library holds back until it closes a file
ABANDONED_S = 86400.0  # since a process that cannot be seen from here wrote its temporary file
TEMPORARY = re.compile(r"\..*\.([0-9a-f]{8})-(\d{1,9})-[0-9a-f]{8}\.tmp(\.|$)")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside `path`, renamed to `path` when the block ends without an error.

    A reader of `path` finds the old file or the complete new one, also after a power cut. Of a library that
    writes the temporary file and ignores errors, ask `require_room`. Of two processes that write one file at
    once, the later is kept.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _temporary(path, path.suffix)
    try:
        with _named(path, temporary):
            yield temporary
            flush(temporary)
            temporary.replace(path)
        flush(path.parent)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _temporary(path: Path, suffix: str = "") -> Path:
    """A name beside `path` that no other process uses, on any computer; what killed runs left is removed."""
    _remove_abandoned(path.parent.resolve())
    # nobody can put a link there that leads elsewhere: the last part cannot be guessed
    mine = f"{_this_computer()}-{os.getpid()}-{token_hex(4)}"
    return path.with_name(f".{path.name}.{mine}.tmp{suffix}")


@cache
def _remove_abandoned(folder: Path) -> None:
    """Remove temporary files and folders of killed runs: once for each folder, which may have many files."""
    with suppress(OSError):  # a folder that may be written and not be listed
        for path in folder.iterdir():
            found = TEMPORARY.match(path.name)
            with suppress(OSError):  # it may be renamed meanwhile
                if found and _is_abandoned(path, found[1], int(found[2])):
                    _remove(path)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()


def _is_abandoned(path: Path, computer: str, process: int) -> bool:
    running = is_running(process) if computer == _this_computer() else None
    if running is None:
        return time.time() - path.lstat().st_mtime > ABANDONED_S
    return not running


@cache
def _this_computer() -> str:
    """Of this computer and of how it numbers processes, which containers do by themselves."""
    known = platform.node()
    with suppress(OSError):  # macOS and Windows have neither
        known += Path("/etc/machine-id").read_text("utf-8")
    with suppress(OSError):
        known += str(Path("/proc/self/ns/pid").readlink())
    return f"{crc32(known.encode()):08x}"


def require_room(path: Path) -> None:
    """Grow a file and cut it again; on a full disk it may lack its last bytes, and that fails.

    Libraries write those when they close a file, and then ignore errors.
    """
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        file.write(bytes(SPARE_BYTES))
        file.flush()
        file.truncate(size)


@contextmanager
def replacing_directory(path: Path) -> Iterator[Path]:
    """Yield a temporary directory beside `path`, renamed to `path` when the block ends without an error.

    `path` must not exist, or be empty: a finished directory is never overwritten.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _temporary(path)
    try:
        with _named(path, temporary):
            temporary.mkdir()
            yield temporary
            for file in sorted(temporary.rglob("*")):
                flush(file)
            flush(temporary)
        temporary.rename(path)
        flush(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def _named(path: Path, temporary: Path) -> Iterator[None]:
    """Name what was to be written in errors of the system, not its temporary name."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename2:
            raise
        where = str(error.filename or path).replace(str(temporary), str(path))
        raise OSError(error.errno, error.strerror, where) from error


def write_text(path: Path, text: str) -> None:
    """Write `text` durably; an existing file is replaced as a whole."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def rewrite(path: Path, content: bytes) -> None:
    """Replace the content of a file that is there durably; its permissions stay, and a link to it too."""
    path = path.resolve()
    with replacing(path) as temporary:
        temporary.touch(mode=0o600)
        temporary.write_bytes(content)
        shutil.copymode(path, temporary)


def append_line(path: Path, line: str) -> None:
    """Append one line and flush it to disk, after removing an incomplete last line; a link is refused."""
    with open(path, "ab+", opener=open_here) as file:
        if size := file.seek(0, os.SEEK_END):
            file.seek(size - 1)
            if file.read() != b"\n":  # a process was killed while it wrote
                file.seek(0)
                file.truncate(file.read().rfind(b"\n") + 1)
        file.write(line.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def read_lines(path: Path) -> list[str]:
    """The complete lines of a log, without an incomplete last one. A log that is absent has none."""
    if not path.exists():
        return []
    content = path.read_bytes()
    try:
        return content[: content.rfind(b"\n") + 1].decode().splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"{path} is not a text file ({error.reason}); restore the log"
        ) from error
