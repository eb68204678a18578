"""`procam doctor --photos`: test photographs of a rig that procam does not drive."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from picture_files import write_with_header
from test_cli_external import CAMERA, HandSession, photograph, start
from tiny_venue import procam

from procam.files.images.pixels import read_image, write_image

WANTED = ("dark", "white", "black", "stripes")
EXPOSURES = {"dark": (0.13, 6.5), "white": (0.09,), "black": (6.5,), "stripes": (0.09,)}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> HandSession:
    return start(tmp_path_factory.mktemp("rig") / "dome")


@pytest.fixture(scope="module")
def taken(rig: HandSession) -> Path:
    """White, black and two stripes of each projector, and two of the dark."""
    folder = rig.out.parent / "test"
    take(rig, folder)
    return folder


@pytest.fixture
def photos(taken: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(taken, tmp_path / "photos"))


def take(rig: HandSession, folder: Path, change: Callable = lambda c: c, **how: float) -> None:
    folder.mkdir()
    count: dict[tuple[str, str], int] = {}
    for entry in rig.order():
        kind = (entry["projector"], entry["purpose"])
        count[kind] = count.get(kind, 0) + 1
        if entry["purpose"] not in WANTED or count[kind] > 2:
            continue
        for exposure_s in EXPOSURES[entry["purpose"]]:
            counts = change(photograph(rig.out, entry, exposure_s, **how))
            path = folder / f"P{len(list(folder.iterdir())):03d}.tif"
            write_with_header(path, counts, ExposureTime=exposure_s)


def doctor(rig: HandSession, photos: Path, *more: object) -> tuple[int, dict]:
    venue = rig.session.parents[1]
    ran = procam("doctor", venue, "--photos", photos, "--camera", CAMERA, "--json", *more)
    assert ran.err == ""
    return ran.code, json.loads(ran.out)


def kinds(document: dict) -> dict[str, str]:
    return {f["kind"]: f["line"] for f in document["findings"]}


def test_sound_photographs_give_the_exposures(rig: HandSession, photos: Path) -> None:
    code, document = doctor(rig, photos)
    assert (code, document["findings"], document["photographs"]) == (0, [], 10)
    # white reaches 3000 of 4031 counts at 0.13 s
    assert document["capture"]["exposure_s"] == pytest.approx(0.92 * 4031 / 3000 * 0.13, rel=0.06)
    assert {v["projector"] for v in document["views"]} == {"south", "north"}
    ran = procam("doctor", rig.session.parents[1], "--photos", photos, "--camera", CAMERA)
    assert "all is well" in ran.out and "[capture] for all: exposure_s = " in ran.out


def test_white_that_clips(rig: HandSession, tmp_path: Path) -> None:
    take(rig, tmp_path / "p", lambda c: np.where(c > 1500, 4095, c).astype(np.uint16))
    code, document = doctor(rig, tmp_path / "p")
    assert code == 1
    assert "saturated at 0.09 s; try 0.0225 s" in kinds(document)["exposure"]


def test_out_of_focus(rig: HandSession, tmp_path: Path) -> None:
    take(rig, tmp_path / "p", blur_px=1.7)
    code, document = doctor(rig, tmp_path / "p")
    assert code == 1
    assert "edges of stripes blurred by" in kinds(document)["focus"]


def test_numbers_that_cannot_be_read(rig: HandSession, tmp_path: Path) -> None:
    take(rig, tmp_path / "p", blur_px=3.0)
    code, document = doctor(rig, tmp_path / "p")
    assert code == 1
    assert "no number of this plan in P002.tif" in kinds(document)["unread"]
    assert "black-level" not in kinds(document)


def test_twelve_bits_moved_up(rig: HandSession, tmp_path: Path) -> None:
    take(rig, tmp_path / "p", lambda c: (16 * c).astype(np.uint16))
    code, document = doctor(rig, tmp_path / "p")
    assert code == 1
    assert "multiples of 16 alone, 12 bits moved up to 16" in kinds(document)["left-aligned"]
    assert "was it scaled to 16 bits?" in kinds(document)["file"]


def test_what_is_missing_or_of_another_size(rig: HandSession, photos: Path) -> None:
    first = sorted(photos.iterdir())
    first[2].unlink()  # white of south
    write_with_header(first[5], np.zeros((20, 30, 3), np.uint16))
    code, document = doctor(rig, photos)
    assert code == 1
    assert (
        "patterns/south/0000.png and patterns/south/0001.png" in kinds(document)["not-photographed"]
    )
    assert "of 30x20 px" in kinds(document)["size"]


def test_photographs_without_headers_are_exposed_as_planned(
    rig: HandSession, tmp_path: Path
) -> None:
    (tmp_path / "p").mkdir()
    for number, entry in enumerate(rig.order()):
        if entry["purpose"] in {"white", "black"}:
            counts = photograph(rig.out, entry, float(entry["exposures_s"].split()[0]))
            write_image(tmp_path / "p" / f"{number:03d}.tif", counts)
    code, document = doctor(rig, tmp_path / "p")
    assert (code, document["findings"]) == (0, [])
    assert document["capture"]["black_exposure_s"] > 1


def test_stripes_that_are_no_pair_say_nothing_of_focus(rig: HandSession, tmp_path: Path) -> None:
    take(rig, tmp_path / "p")
    second = sorted((tmp_path / "p").iterdir())[5]
    second.unlink()  # the inverse of the stripes of south
    code, document = doctor(rig, tmp_path / "p")
    assert (code, document["findings"]) == (0, [])


def test_files_that_are_no_photographs_in_colour(rig: HandSession, photos: Path) -> None:
    first = sorted(photos.iterdir())
    write_with_header(first[-1], np.zeros((*read_image(first[0]).shape[:2], 1), np.uint16))
    first[-2].write_bytes(first[-2].read_bytes()[:300])
    code, document = doctor(rig, photos)
    assert code == 1
    assert "one channel" in kinds(document)["channels"] and "file" in kinds(document)


def test_refusals(rig: HandSession, photos: Path, tmp_path: Path) -> None:
    venue = rig.session.parents[1]
    ran = procam("doctor", venue, "--photos", photos, "--camera", "nobody")
    assert "no camera 'nobody'; venue.toml has" in ran.complaint
    ran = procam("doctor", venue, "--photos", photos, "--camera", CAMERA, "--behaviour")
    assert "--photos: with --behaviour it is for venues" in ran.complaint
    (tmp_path / "new").mkdir()
    shutil.copy(venue / "venue.toml", tmp_path / "new")
    ran = procam("doctor", tmp_path / "new", "--photos", photos, "--camera", CAMERA)
    assert "it has no pictures yet; run: procam session plan" in ran.complaint
