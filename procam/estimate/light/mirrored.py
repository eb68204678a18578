"""Checks that a projector shows its pictures as they are, not mirrored or upside down, in all photographs."""

from collections.abc import Callable, Mapping

import numpy as np

from procam.arrays import BoolArray, FloatArray, Image, IndexArray
from procam.errors import CalibrationError
from procam.estimate.light.projector_images import CameraSight, ProjectorImages
from procam.maths.warp import sample

FLIPS: Mapping[str, Callable[[Image], Image]] = {
    "mirrored": lambda picture: picture[:, ::-1],
    "upside down": lambda picture: picture[::-1],
    "upside down and mirrored": lambda picture: picture[::-1, ::-1],
}
# by which a flipped picture must correlate better with a photograph: right ones correlate by 0.8 or more,
# and a flipped one as much only where the picture is its own mirror image
BETTER = 0.3
MAX_PIXELS = 10_000
EVERY_CODE = 4  # picture of the code: its lines were decoded, so most of them are as they should be
LEAST_LIGHT = 0.2  # of the median of white: beside it ratios are noise
GREEN = 1


def check_not_mirrored(images: ProjectorImages, sight: CameraSight) -> None:
    """Refuse a projector that was switched to mirrored after it was decoded.

    Raises
    ------
    CalibrationError
        With the first photograph that shows a flipped picture.
    """
    full = sight.white[..., GREEN]
    use = _compared(full, sight.lit, sight.panel)
    if not use.size:
        return
    at = sight.panel.reshape(-1, 2)[use]
    for picture in images.in_turn(EVERY_CODE):
        light = picture.light()
        green = (light if light.ndim == 2 else light[..., GREEN]) - sight.base[..., GREEN]
        flip = found_flip(green.ravel()[use] / full.ravel()[use], picture.drive()[..., 0], at)
        if flip:
            raise CalibrationError(
                f"projector {images.name}: its picture is {flip} from {picture.id} ({picture.purpose}) on, "
                "and was not before: rear projection, ceiling mount or a flip was switched in its menu or in "
                "the player while it was photographed. Switch it back and photograph again"
            )


def _compared(full: Image, lit: BoolArray, panel: Image) -> IndexArray:
    """Indices of pixels of white (H, W) that are bright and see the panel."""
    light = np.where(lit, np.nan_to_num(full), 0)
    least = LEAST_LIGHT * np.median(light[lit]) if lit.any() else np.inf
    use = np.flatnonzero((light > max(least, 0.0)) & np.isfinite(panel).all(axis=-1))
    return use[:: max(1, len(use) // MAX_PIXELS)]


def found_flip(share: FloatArray, picture: Image, at: FloatArray) -> str:
    """Name of the flip by which a picture (H, W) fits shares of white's light (n,) at panel pixels; or ""."""
    shown = _correlation(share, picture, at)
    flipped = {what: _correlation(share, flip(picture), at) for what, flip in FLIPS.items()}
    best = max(flipped, key=lambda what: flipped[what])
    return best if flipped[best] > shown + BETTER else ""


def _correlation(share: FloatArray, picture: Image, at: FloatArray) -> float:
    """Correlation of shares (n,) with a picture's drive at panel pixels (n, 2); 0 of what is uniform."""
    drive = sample(np.ascontiguousarray(picture, np.float32), at)
    known = np.isfinite(share) & np.isfinite(drive)
    both = np.stack([share[known], drive[known]]).astype(float)
    if both.shape[1] < 2 or not (both.std(axis=1) > 0).all():
        return 0.0
    return float(np.corrcoef(both)[0, 1])
