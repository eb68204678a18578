"""The CSV that assigns photographs to shots by hand."""

import csv
from pathlib import Path

from procam.errors import FileFormatError
from procam.model.plan import Plan


def read_index(path: Path, plan: Plan, photos: list[Path]) -> dict[str, str]:
    """Shot by file name, from lines "file,shot"."""
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; it needs lines file,shot")
    lines = _index_lines(path)
    files, shots = {p.name for p in photos}, {shot.id for shot in plan.shots}
    claims: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if len(line) != 2:
            raise FileFormatError(f"{path}: entry {number}: {line} is not of the form file,shot")
        file, shot = (cell.strip() for cell in line)
        for what, value, known in (("file", file, files), ("shot", shot, shots)):
            if value not in known:
                raise FileFormatError(
                    f"{path}: entry {number}: the {what} {value!r} is none of the "
                    f"{len(known)} {what}s of the {'plan' if what == 'shot' else 'folder'}"
                )
        if file in claims:
            raise FileFormatError(f"{path}: entry {number}: the file {file!r} stands there twice")
        claims[file] = shot
    return claims


def _index_lines(path: Path) -> list[list[str]]:
    """Lines of a CSV, without empty ones and the head; a byte order mark is skipped."""
    try:
        text = path.read_text("utf-8-sig")
        lines = [line for line in csv.reader(text.splitlines()) if line]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(
            f"{path}: not UTF-8 text ({error}); save its lines file,shot as CSV in UTF-8 "
            "(in spreadsheets 'CSV UTF-8', not 'Unicode text')"
        ) from error
    headed = bool(lines) and [cell.strip() for cell in lines[0]] == ["file", "shot"]
    return lines[headed:]
