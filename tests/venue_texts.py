"""Texts of venue.toml, valid and with mistakes."""

from pathlib import Path

import pytest

from procam.errors import InputError
from procam.files.venue.load import Venue, load_venue, template_text

PLAIN = template_text("simulated-ideal")
TAGS = """
[[apriltags]]
id = 7
azimuth_deg = -30.0
sigma_deg = 0.02

[[apriltags]]
family = "25h9"
id = 8
azimuth_deg = 10.0
elevation_deg = 40.0
sigma_deg = 0.02

"""
DISTANCE = '[[distances]]\na = "zenith"\nb = "south"\nmetres = 3.0\n\n[capture]'
MARK_PIXEL = "pixel = [302.50, 1023.38]"


def load_venue_of(folder: Path, text: str) -> Venue:
    """Write and load FOLDER/venue.toml."""
    folder.mkdir(exist_ok=True)
    (folder / "venue.toml").write_text(text, encoding="utf-8")
    return load_venue(folder)


def mistakes(folder: Path, text: str) -> list[str]:
    """The lines of the error about a venue.toml."""
    with pytest.raises(InputError) as caught:
        load_venue_of(folder, text)
    return str(caught.value).splitlines()


def edit(old: str, new: str, text: str = PLAIN) -> str:
    """A venue.toml with `old` replaced by `new`."""
    assert old in text
    return text.replace(old, new)
