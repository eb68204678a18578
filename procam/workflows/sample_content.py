"""Content to try a screen with: light that is anywhere but where it is wanted dark."""

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import angles_from_direction, master_directions
from procam.model.screen import RoomScreen, Screen

# what to look for
HALF_SKY_TEXT = (
    "A bright sky over a darker ground. Compare the ground: without compensation the sky's light makes "
    "it pale. The black trees stay a little grey even so, as no projector has negative light."
)
BLACK_TEXT = (
    "Black, after two minutes in the dark. No seam, no light from outside; what is seen is the black of the "
    "projectors."
)
HORIZON = np.radians(30.0)
TREE_SPACING = np.radians(45.0)
CEILING = np.radians(42.0)
WINDOW_SPACING = np.radians(50.0)


def half_sky(size: int, screen: Screen | None = None) -> Image:
    """A bright sky over a darker ground, split by elevation, with black trees: linear light.

    On the canvas (H, W, 3) of a screen, of that width; by default of a dome. The sky's light falls on the
    ground by way of the screen; the trees ask for less light than that, which no projector can give.
    """
    canvas = screen.canvas if screen else STANDARD
    direction, inside = canvas.directions(size)
    azimuth, elevation = angles_from_direction(direction)
    if isinstance(screen, RoomScreen):  # whose middle is half way up its walls
        elevation = elevation + HORIZON
    height = np.clip((elevation - HORIZON) / (np.pi / 2 - HORIZON), 0, 1)[..., None]
    furrow = 0.5 + 0.5 * np.cos(24 * azimuth) * np.cos(elevation / HORIZON * np.pi)
    ground = np.array([0.30, 0.27, 0.20]) * (0.85 + 0.5 * furrow)[..., None]
    from_trunk = np.abs((azimuth / TREE_SPACING) % 1 - 0.5) * TREE_SPACING * np.cos(elevation)
    tree = soft_step(np.radians(4) - from_trunk) * soft_step(0.8 * HORIZON - elevation)
    ground = over(ground, np.array(0.02), tree)
    return drawn(over(ground, sky(height), soft_step(elevation - HORIZON)), inside)


def interior(size: int) -> Image:
    """A room: windows in the front, pale walls and ceiling, dark furniture: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    to_front = (0.5 + 0.5 * direction[..., 0])[..., None]
    wall = np.array([0.36, 0.33, 0.29]) * (1.15 - 0.3 * to_front)
    ceiling = np.array([0.46, 0.45, 0.42]) * (0.8 + 0.4 * to_front)
    across = ((azimuth / WINDOW_SPACING + 0.5) % 1 - 0.5) * WINDOW_SPACING
    reach = np.abs(across) * np.cos(elevation)
    band = soft_step(elevation - np.radians(10)) * soft_step(np.radians(36) - elevation)
    window = band * soft_step(np.radians(15) - reach) * (np.abs(azimuth) < 1.5 * WINDOW_SPACING)
    chest = soft_step(np.radians(8) - elevation) * soft_step(np.radians(17) - reach)
    room = over(wall, np.array([0.05, 0.04, 0.03]), chest)
    room = over(room, np.array([0.88, 0.93, 1.0]), window)
    return drawn(over(room, ceiling, soft_step(elevation - CEILING)), inside)


def white(size: int) -> Image:
    """Full white: (N, N, 3) linear."""
    _, inside = master_directions(size)
    return drawn(np.ones((size, size, 3)), inside)


def sky(height: Array) -> Array:
    """Day's sky (..., 3) from the horizon at 0 to the zenith at 1."""
    return (1 - height) * np.array([0.62, 0.72, 0.85]) + height * np.array([0.30, 0.45, 0.80])


def over(under: Array, above: Array, share: Array) -> Array:
    """One picture (..., 3) over another, where `share` (...) is 1."""
    return np.asarray(under + share[..., None] * (above - under))


def drawn(picture: Array, inside: BoolArray) -> Image:
    """A picture (N, N, 3) within the circle of a dome master, black outside."""
    return (picture * inside[..., None]).astype(np.float32)


def soft_step(angle: Array) -> Array:
    """0 to 1 over two degrees: an edge that any projector can draw."""
    x = np.clip(angle / np.radians(2.0) + 0.5, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))
