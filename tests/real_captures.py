"""Captures of other people, which calib_data/captures/README.md describes."""

from importlib import resources

import numpy as np

from procam.estimate.boards.camera import BoardView
from procam.estimate.structured_light.codes import AXES, make_code
from procam.estimate.structured_light.decode import Decoded, Decoder

GSOUP_SESSIONS = ("s00", "s03", "s05", "s11", "s15", "s17")
GSOUP_SIZE = (800, 800)
BITS = 10


def captured(name: str) -> dict[str, np.ndarray]:
    with (resources.files("calib_data") / "captures" / f"{name}.npz").open("rb") as file:
        return dict(np.load(file))


def gsoup_session(name: str) -> tuple[np.ndarray, Decoded, np.ndarray]:
    """White, the decoded code, and where the crop lies in the full frame (2,)."""
    stored = captured("gsoup_six_sessions")
    images, decoder = stored[name], Decoder(make_code("gray", GSOUP_SIZE))
    decoder.add(0, images[40])
    decoder.add(1, images[41])
    planes = [(axis, plane) for axis in range(len(AXES)) for plane in range(BITS)]
    for number, (axis, plane) in enumerate(planes):
        decoder.add(2 + 2 * number, images[axis * BITS + plane])
        decoder.add(3 + 2 * number, images[2 * BITS + axis * BITS + plane])
    return images[40], decoder.result(), stored["offsets"][GSOUP_SESSIONS.index(name)]


def ov_plane_views(split: str) -> list[BoardView]:
    """Views of a board by the real fisheye, of the split "train" or "test"."""
    stored = captured("ov_plane_corners")
    board, rows = stored["board_m"], stored[split]
    return [
        BoardView(f"{split}-{view}", board[part["corner"]], part["pixel"].astype(float))
        for view in np.unique(rows["view"])
        for part in [rows[rows["view"] == view]]
    ]
