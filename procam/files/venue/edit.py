"""Keys of a camera put into venue.toml as its owner would: order and comments stay as they are."""

import tomllib
from codecs import BOM_UTF8
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AbstractTable, Whitespace

from procam.errors import InputError
from procam.files.atomic import rewrite
from procam.files.venue.load import checked_venue, load_venue

# begins what is replaced with the value; what follows is the owner's comment
OURS, REST = "# +-", " -- "


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a camera and its value; `sigma` is its standard error in words, with what else is known."""

    name: str
    value: str | float | Sequence[float]
    sigma: str = ""

    def item(self, earlier: Any = None) -> Any:
        """The value as tomlkit has it, in place of an `earlier` one, whose owner may have commented it."""
        value = self.value if isinstance(self.value, (str, float, int)) else list(self.value)
        item = tomlkit.item(value)
        comment = earlier.trivia.comment if earlier is not None else ""
        owners = (
            comment.partition(REST)[2] if comment.startswith(OURS) else comment.removeprefix("# ")
        )
        ours = f"{OURS} {self.sigma}" if self.sigma else ""
        both = REST.join(filter(None, [ours, owners]))
        if both:
            spaces = earlier.trivia.comment_ws if comment else "  "
            item.trivia.comment_ws, item.trivia.comment = spaces, both if ours else f"# {both}"
        return item

    @property
    def line(self) -> str:
        """The line of venue.toml."""
        item = self.item()
        return f"{self.name} = {item.as_string()}{item.trivia.comment_ws}{item.trivia.comment}"


def set_camera_keys(venue_dir: Path, camera: str, keys: Sequence[Key]) -> None:
    """Write keys of [cameras.CAMERA] in VENUE/venue.toml.

    Raises
    ------
    InputError
        There is no such camera, or the file would have a mistake with the keys; it stays as it was.
    """
    rewrite(venue_dir / "venue.toml", edited(venue_dir, camera, keys))


def edited(venue_dir: Path, camera: str, keys: Sequence[Key]) -> bytes:
    """venue.toml with keys of [cameras.CAMERA]; what is wrong is refused as for writing it."""
    require_camera(venue_dir, camera)
    path = venue_dir / "venue.toml"
    content = path.read_bytes()
    mark = BOM_UTF8 if content.startswith(BOM_UTF8) else b""
    try:
        document: Any = tomlkit.parse(content.removeprefix(mark).decode())
    except TOMLKitError as error:  # what tomllib reads it should, but it is another program
        raise InputError(
            f"{path} cannot be edited ({error}); write the lines into it yourself"
        ) from error
    table = document["cameras"][camera]
    body = table.value.body if isinstance(table, AbstractTable) else []  # of dotted keys
    below = _cut_below(body)
    for key in keys:
        table[key.name] = key.item(table.get(key.name))
    body += below
    text = tomlkit.dumps(document)
    checked_venue(venue_dir, tomllib.loads(text))
    return mark + text.encode()


def _cut_below(body: list[Any]) -> list[Any]:
    """Take off what follows a blank line below the last key: it belongs to the next table."""
    last = max((i for i, (name, _) in enumerate(body) if name), default=0)
    blank = (i for i in range(last, len(body)) if isinstance(body[i][1], Whitespace))
    end = next(blank, len(body))
    below, body[end:] = body[end:], []
    return below


def require_camera(venue_dir: Path, camera: str) -> None:
    """Refuse a venue that has no such camera."""
    cameras = load_venue(venue_dir).table.cameras
    if camera not in cameras:
        raise InputError(
            f"--camera {camera!r} is not in {venue_dir / 'venue.toml'}; choose one of {', '.join(cameras)}"
        )
