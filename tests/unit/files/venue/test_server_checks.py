"""venue.toml of a dome behind a media server: what goes together, and what does not."""

import re
from pathlib import Path

import pytest
from venue_texts import edit, load_venue_of, mistakes

from procam.files.venue.load import template_text

PLAIN = template_text("through-server")
OTHER = "[projectors.extra]\nsize = [1280, 800]\n\n[capture]"


def test_the_template_and_all_its_examples_load(tmp_path: Path) -> None:
    plain = load_venue_of(tmp_path / "plain", PLAIN)
    entry = plain.table.projectors["server"]
    assert (entry.kind, entry.fov_deg, entry.rotation_deg) == ("dome-master", 180.0, 0.0)
    examples = re.sub(r"(?m)^# (?=\w+ = |\[\[)", "", PLAIN)
    examples = examples.replace('response = "linear"', "", 1).replace('"zenith-lenses.png", ', "")
    full = tmp_path / "full"
    full.mkdir()
    (full / "curve.csv").write_text("level,light\n0,0\n1,1\n")
    venue = load_venue_of(full, examples)
    assert venue.table.projectors["server"].masks and len(venue.fiducials) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "size = [4096, 4096]",
            "size = [4096, 2160]",
            "projectors.server.size is 4096x2160; it must be a square of 512 to 16384 px",
        ),
        (
            "size = [4096, 4096]",
            "size = [256, 256]",
            "projectors.server.size is 256x256; it must be a square of 512",
        ),
        (
            "[capture]",
            OTHER,
            "projectors.server.kind is 'dome-master', which must be the only projector; remove",
        ),
        (
            "radius_m = 6.0 ",
            "# radius_m = 6.0 ",
            "screen.radius_m is missing: with a projector of kind",
        ),
        (
            "[capture]",
            '[[distances]]\na = "zenith"\nb = "server"\nmetres = 3.0\n\n[capture]',
            "distances are not used with a projector of kind 'dome-master'",
        ),
        (
            "fov_deg = 180.0",
            'lens = "brown"\nfov_deg = 180.0',
            "projectors.server.lens belongs to kind = 'projector', and this kind is 'dome-master'",
        ),
        (
            'kind = "dome-master"',
            "masks = []",
            "projectors.server.fov_deg belongs to kind = 'dome-master', and this kind is 'projector'",
        ),
        ("fov_deg = 180.0", "fov_deg = 300.0", "fov_deg is 300.0; it must be 250 or less"),
    ],
)
def test_a_mistake(tmp_path: Path, old: str, new: str, message: str) -> None:
    found = mistakes(tmp_path, edit(old, new, PLAIN))
    assert any(message in line for line in found), found
