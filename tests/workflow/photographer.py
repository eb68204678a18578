"""A venue that procam does not drive: its server shows PNGs, its camera writes TIFFs.

`main(VENUE, PICTURES, PHOTOS, FLOOR)` knows a folder with a venue.toml (of the simulated dome), the folder
that `procam session plan` or a round of `refine` made, and nothing else. FLOOR is the albedo of the floor,
when there are people.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from picture_files import write_with_header
from tiny_venue import CAMERA, quick_simulator

from procam.devices.rig import Rig
from procam.files.images.pixels import read_image, write_image
from procam.files.venue.load import load_venue
from procam.model.frame import CameraSettings
from procam.workflows.venue_rig import open_rig
from simulators.presets import PRESETS

Counts = NDArray[np.uint16]


def main(venue: Path, pictures: Path, photos: Path, floor: str = "") -> None:
    photos.mkdir()
    if floor:
        PRESETS["standard"] = replace(PRESETS["standard"], floor_albedo=float(floor))
    entries = list(csv.DictReader((pictures / "order.csv").read_text("utf-8").splitlines()))
    work = photograph_session if "shot" in entries[0] else photograph_round
    with quick_simulator(), open_rig(load_venue(venue)) as rig:
        rig.start()
        work(rig, entries, pictures, photos)


def photograph_round(rig: Rig, entries: list[dict[str, str]], pictures: Path, photos: Path) -> None:
    """Pictures of several projectors at once, each photographed several times."""
    number, camera = 0, rig.cameras[CAMERA]
    for entry in entries:
        lit = entry["projectors"].split()
        for name, projector in rig.projectors.items():
            if name not in lit:
                rig.darken(name)
                continue
            rig.light(name)
            picture = read_image(pictures / "pictures" / entry["picture"] / f"{name}.png")
            projector.show(np.asarray(picture, np.float32) / 65535)
        for _ in range(int(entry["photographs"])):
            exposure_s = float(entry["exposure_s"])
            camera.configure(CameraSettings(exposure_s))
            write_photo(photos / f"img_{number}.tif", camera.capture().counts, exposure_s)
            number += 1


def write_photo(path: Path, counts: Counts, exposure_s: float, **header: float | str) -> None:
    """Write a photograph (H, W, C) as a camera does, with its exposure."""
    known = {"compression": "none", "ExposureTime": exposure_s}  # quick to write
    write_with_header(path, counts, **known, **header)


def photograph_session(
    rig: Rig, entries: list[dict[str, str]], pictures: Path, photos: Path
) -> None:
    """One projector after the other, each picture at its exposures."""
    camera, lit = rig.cameras[CAMERA], ""
    for number, entry in enumerate(entries):
        if lit and entry["projector"] != lit:
            rig.darken(lit)
        lit = entry["projector"]
        if entry["picture"]:
            picture = np.asarray(read_image(pictures / entry["picture"]), np.float32) / 255
            drive = np.ascontiguousarray(np.broadcast_to(picture, (*picture.shape[:2], 3)))
            rig.light(entry["projector"])
            rig.projectors[entry["projector"]].show(drive)
        for exposure in map(float, entry["exposures_s"].split()):
            camera.configure(CameraSettings(exposure))
            write_image(photos / f"{number}_{exposure:g}.tif", camera.capture().counts)
