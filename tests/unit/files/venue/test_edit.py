"""Keys of a camera written into venue.toml: what the owner wrote stays."""

from pathlib import Path

import pytest

from procam.errors import InputError
from procam.files.venue.edit import Key, set_camera_keys
from procam.files.venue.load import create_venue, load_venue

GLARE = Key("glare", 0.004, "0.0002; a.tif 0.0041")


@pytest.fixture
def venue(tmp_path: Path) -> Path:
    return create_venue(tmp_path / "venue", "by-hand")


def line(venue: Path, key: str) -> str:
    text = (venue / "venue.toml").read_text("utf-8")
    return next(each for each in text.splitlines() if each.startswith(f"{key} = "))


def test_the_standard_error_stands_before_the_owners_comment_and_is_replaced(venue: Path) -> None:
    owners = line(venue, "glare").partition("# ")[2]
    for sigma in ("0.0002", "0.0003; b.tif"):
        set_camera_keys(venue, "zenith", [Key("glare", 0.004, sigma)])
        assert line(venue, "glare").split("# ")[1] == f"+- {sigma} -- {owners}"
    assert load_venue(venue).cameras["zenith"].sensor.glare == 0.004


@pytest.mark.parametrize("begin", [b"", b"\xef\xbb\xbf"])
def test_line_ends_a_byte_order_mark_and_permissions_stay(venue: Path, begin: bytes) -> None:
    path = venue / "venue.toml"
    path.write_bytes(begin + path.read_bytes().replace(b"\n", b"\r\n"))
    path.chmod(0o600)
    before = path.read_bytes().split(b"\r\n")
    set_camera_keys(venue, "zenith", [GLARE])
    after = path.read_bytes().split(b"\r\n")
    assert path.stat().st_mode & 0o777 == 0o600
    assert (
        len(before) == len(after) and sum(a != b for a, b in zip(before, after, strict=True)) == 1
    )


def test_a_link_stays_one(venue: Path, tmp_path: Path) -> None:
    real = (venue / "venue.toml").rename(tmp_path / "real.toml")
    (venue / "venue.toml").symlink_to(real)
    set_camera_keys(venue, "zenith", [GLARE])
    assert (venue / "venue.toml").is_symlink() and "glare = 0.004" in real.read_text("utf-8")


def test_what_would_be_a_mistake_is_refused(venue: Path) -> None:
    before = (venue / "venue.toml").read_bytes()
    for key in (Key("glare", 2.0), Key("response", "gone.csv"), Key("size", (1, 1))):
        with pytest.raises(InputError, match=f"cameras.zenith.{key.name}"):
            set_camera_keys(venue, "zenith", [key])
    assert (venue / "venue.toml").read_bytes() == before


def test_a_name_that_stands_for_a_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="stands for a calibration"):
        create_venue(tmp_path / "dome@2", "by-hand")
