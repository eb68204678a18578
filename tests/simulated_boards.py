"""Views of a bent board by simulated cameras, for the tests of the board estimators."""

import numpy as np

from procam.estimate.boards.camera import BoardView
from procam.maths.geometry.lenses import Lens, project
from procam.maths.geometry.pose import Pose, rotation_matrix

COLUMNS, ROWS, SQUARE_M = 13, 9, 0.0135
BOARD = np.stack([*np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), np.zeros((ROWS, COLUMNS))], -1)
BOARD = BOARD.reshape(-1, 3) * SQUARE_M
MIDDLE = np.array([*(BOARD[:, :2].max(axis=0) / 2), 0.0])
HALF = float(np.linalg.norm(MIDDLE))
BEND = np.array([0.003, -0.001, 0.0015])
NOISE_PX = 0.05  # of OpenCV's corner finder on a sharp photograph

FISHEYE = Lens(
    "kannala-brandt",
    np.array([311.0, 310.2]),
    np.array([652.3, 507.4]),
    np.array([0.03, -0.012, 0.004, -0.0007]),
)
PINHOLE = Lens(
    "brown",
    np.array([905.0, 903.1]),
    np.array([652.3, 507.4]),
    np.array([-0.28, 0.11, 0.0006, -0.0004, -0.02]),
)
SIZE = (1300, 1020)


def bent(points: np.ndarray, bend: np.ndarray) -> np.ndarray:
    u, v = ((points - MIDDLE)[:, :2] / HALF).T
    return points + np.stack([0 * u, 0 * u, np.stack([u * u, v * v, u * v], 1) @ bend], axis=1)


def looking_at(angle: float, azimuth: float, tilt: np.ndarray, distance: float) -> Pose:
    """A board with its middle `angle` off the axis, facing the camera except for its `tilt`."""
    axis = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    facing = rotation_matrix(axis * angle)
    rotation = facing @ rotation_matrix(tilt)
    return Pose(rotation, facing[:, 2] * distance - rotation @ MIDDLE)


def fisheye_views(
    rng: np.random.Generator, lens: Lens, number: int = 30, noise_px: float = NOISE_PX
) -> list[BoardView]:
    """Boards all over the half space and beyond; the first has a corner on the principal point."""
    angles = np.radians(np.linspace(0, 88, number))
    views = []
    for i, angle in enumerate(angles):
        pose = looking_at(angle, 2.4 * i, rng.normal(0, 0.35, 3), rng.uniform(0.13, 0.2))
        if i == 0:
            corner = pose.apply(bent(BOARD, BEND))[22]
            pose = Pose(pose.rotation, pose.translation - [corner[0], corner[1], 0.0])
        views.append(seen(rng, f"{i:02d}.png", pose, lens, noise_px))
    corner = views[0].pixels[22]
    corner[:] = lens.centre
    return views


def pinhole_views(rng: np.random.Generator, lens: Lens, number: int = 30) -> list[BoardView]:
    views = []
    while len(views) < number:
        tilt = rng.normal(0, 0.45, 3) * [1, 1, 0.3]
        pose = looking_at(rng.uniform(0, 0.65), rng.uniform(0, 7), tilt, rng.uniform(0.2, 0.45))
        views.append(seen(rng, f"{len(views):02d}.png", pose, lens))
        if len(views[-1].pixels) < len(BOARD) / 2:
            views.pop()
    return views


def seen(
    rng: np.random.Generator, name: str, pose: Pose, lens: Lens, noise_px: float = NOISE_PX
) -> BoardView:
    """Noisy corners that lie within the picture."""
    pixels = project(pose.apply(bent(BOARD, BEND)), lens)
    inside = ((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(axis=1)
    noisy = pixels + rng.normal(0, noise_px, pixels.shape)
    return BoardView(name, BOARD[inside], noisy[inside])


def add_outliers(
    rng: np.random.Generator, views: list[BoardView], share: float
) -> set[tuple[str, int]]:
    """Move some corners by 5 to 60 px; returns which."""
    outliers = set()
    for view, pixels in [(v.name, v.pixels) for v in views]:
        for index in np.flatnonzero(rng.random(len(pixels)) < share):
            angle, far = rng.uniform(0, 2 * np.pi), rng.uniform(5, 60)
            shifted = pixels[index] + far * np.array([np.cos(angle), np.sin(angle)])
            pixels[index] = np.clip(shifted, 0, np.array(SIZE) - 1)
            outliers.add((view, int(index)))
    return outliers
