"""A venue that procam does not drive: its server shows PNGs, its camera writes TIFFs.

`python photographer.py VENUE PICTURES PHOTOS`: a process of its own, which is given a folder with a
venue.toml (what the simulated dome is), the folder that `procam patterns` made, and nothing else.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from tiny_venue import CAMERA, quick_simulator

from procam.files.images.pixels import read_image, write_image
from procam.files.venue.load import load_venue
from procam.model.frame import CameraSettings
from procam.workflows.venue_rig import open_rig


def main(venue: Path, pictures: Path, photos: Path) -> None:
    photos.mkdir()
    entries = list(csv.DictReader((pictures / "order.csv").read_text("utf-8").splitlines()))
    with quick_simulator(), open_rig(load_venue(venue)) as rig:
        rig.start()
        camera = rig.cameras[CAMERA]
        for number, entry in enumerate(entries):
            if entry["picture"]:
                picture = np.asarray(read_image(pictures / entry["picture"]), np.float32) / 255
                drive = np.ascontiguousarray(np.broadcast_to(picture, (*picture.shape[:2], 3)))
                rig.light(entry["projector"])
                rig.projectors[entry["projector"]].show(drive)
            for exposure in map(float, entry["exposures_s"].split()):
                camera.configure(CameraSettings(exposure))
                write_image(photos / f"{number}_{exposure:g}.tif", camera.capture().counts)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
