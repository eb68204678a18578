"""manifest.json of a bundle: what wrote it, what was left out, and the size and sha256 of each file."""

import hashlib
import json
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

from procam.errors import FileFormatError
from procam.files.session_tables import checked, parse_object

SCHEMA = 1


def _printable(line: str) -> str:
    """The line without what would steer a terminal."""
    return "".join(c if c.isprintable() else "?" for c in line)


Line = Annotated[str, AfterValidator(_printable)]


class FileEntry(BaseModel):
    """Size [bytes] and sha256 of a file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    bytes: Annotated[int, Field(ge=0)]
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class Manifest(BaseModel):
    """The whole file but for its schema.

    `procam` is the version that wrote it; of `planned` frames `frames` were captured; `redacted` lists in
    words what the venue has and the bundle has not, or what was left out when it was opened; `files` has all
    but the manifest itself.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    procam: Line
    frames: Annotated[int, Field(ge=0)]
    planned: Annotated[int, Field(ge=0)]
    redacted: list[Line]
    files: dict[str, FileEntry]

    def text(self) -> str:
        """The file's content."""
        return json.dumps({"schema": SCHEMA, **self.model_dump()}, indent=1) + "\n"


def entry_of(content: bytes) -> FileEntry:
    """Size and sha256 of a file's content."""
    return FileEntry(bytes=len(content), sha256=hashlib.sha256(content).hexdigest())


def parse_manifest(path: Path, content: bytes) -> Manifest:
    """The manifest of a bundle.

    Raises
    ------
    FileFormatError
        If `content` is none, or one of a later version; `path` is its name in the message.
    """
    document = parse_object(path, content)
    schema = document.pop("schema", None)
    if schema != SCHEMA:
        raise FileFormatError(
            f"{path} has schema {schema!r}, and this version of procam reads {SCHEMA}; open the bundle with "
            "the version that wrote it"
        )
    return checked(Manifest, document, path, "ask for the bundle again")
