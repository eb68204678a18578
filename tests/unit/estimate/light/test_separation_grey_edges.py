"""Direct and scattered light where stripes have grey edges, as a media server's resampling makes them.

A pattern and its inverse do not add up to white there: half the drive is a fifth of the light.
"""

import numpy as np

from procam.estimate.light.picture_flux import PictureFlux
from procam.estimate.light.separation import Separation
from procam.maths.codes.gray import stripe

SIZE, BITS = 256, (3, 4)
SCATTER = 0.3  # of the mean light, everywhere
GAMMA = 2.2


def drawn(bit: int, inverse: int, axis: str) -> np.ndarray:
    """Light (N, N) of a stripe picture, interpolated between pixels before the projector's gamma."""
    line = (stripe(SIZE, bit) ^ bool(inverse)).astype(float)
    line = (np.roll(line, 1) + 2 * line + np.roll(line, -1)) / 4
    line[[0, -1]] = line[[1, -2]]
    light = line**GAMMA
    return np.broadcast_to(light[None, :] if axis == "x" else light[:, None], (SIZE, SIZE))


def test_edges_take_nothing_from_the_direct_light() -> None:
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    direct = 1 + 0.3 * np.sin(x / 40) + 0.2 * np.cos(y / 50)
    solid = np.full((SIZE, SIZE), 1e-4)

    def seen(light: np.ndarray) -> np.ndarray:
        total = light * direct + SCATTER * np.mean(light * direct)
        noisy = total * (1 + rng.normal(0, 0.002, total.shape))
        return np.repeat(noisy[..., None], 3, axis=2).astype(np.float32)

    xy = np.stack([x, y], axis=-1).astype(np.float32)
    lit = np.ones((SIZE, SIZE), bool)
    white = seen(np.ones((SIZE, SIZE)))
    separation = Separation(white, xy, lit, PictureFlux(solid, white))
    for axis in ("x", "y"):
        for bit in BITS:
            pictures = (seen(drawn(bit, inverse, axis)) for inverse in (0, 1))
            separation.add_pair(axis, bit, *pictures)
    light = separation.result()
    inner = np.s_[12:-12, 12:-12]
    scattered = SCATTER * float(direct.mean())
    # without care the edges, one pixel of sixteen, would take 4 % away
    ratio = light.direct[inner][..., 1] / direct[inner]
    assert abs(float(ratio.mean()) - 1) < 0.002
    assert abs(float(light.scattered[inner][..., 1].mean()) / scattered - 1) < 0.005
