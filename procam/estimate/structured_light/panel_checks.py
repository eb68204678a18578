"""Checks that a projector can make a decoded map, and that it shows every pixel it is sent."""

import numpy as np

from procam.arrays import FloatArray
from procam.estimate.structured_light.codes import AXES, NAMES, Code
from procam.maths.warp import block_mean
from procam.model.correspondence import CorrespondenceMap

BLOCK_PX = 8  # camera pixels whose mean is taken; two cells, where several columns share a codeword
MIN_BLOCKS = 30
MIXED = 0.2  # share of mirrored blocks: of sound sets hardly any, of another code's half
PIXELS_PER_LINE = (
    30  # camera pixels that columns have on average, for a missing one to be significant
)
MAX_STEP_PX = 0.7  # projector pixels per camera pixel: a coarser camera misses columns itself
UNSEEN_SHARE = 0.03  # of the columns or rows between seen ones


def orientation(code: Code, found: CorrespondenceMap) -> tuple[list[str], list[str]]:
    """Notes if the camera sees the panel's picture mirrored, and why a map with both kinds is refused."""
    share = _mirrored_share(code, found)
    if share <= MIXED:
        return [], []
    if share < 1 - MIXED:
        return [], [
            f"pictures: {share:.0%} of the map is mirrored and the rest is not, as no surface makes it; they "
            f"are not of the code {code.name}, or in another order: check its description"
        ]
    return [
        "the camera sees the picture mirrored: right with rear projection or a mirror; otherwise shifts of "
        "one axis have the wrong sign, or rows and columns are exchanged"
    ], []


def _mirrored_share(code: Code, found: CorrespondenceMap) -> float:
    """Share of the blocks of camera pixels whose neighbours lie mirrored on the panel; 0 if there are few."""
    codings = (code.x, code.y)
    if any(c.waves is not None and c.waves.single and c.codewords is None for c in codings):
        return 0.0  # the position within a period alone
    size = max(BLOCK_PX, *(2 * coding.resolution_px for coding in codings))
    share = block_mean(found.valid[..., None].astype(np.float32), size)
    total = block_mean(np.where(found.valid[..., None], found.projector_xy, np.float32(0)), size)
    mean = np.where(share > 0.5, total / np.maximum(share, 0.5), np.nan)
    across, down = np.diff(mean, axis=1)[:-1], np.diff(mean, axis=0)[:, :-1]
    turn = across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]
    judged = np.isfinite(turn) & (turn != 0)
    return float(np.mean(turn[judged] < 0)) if judged.sum() >= MIN_BLOCKS else 0.0


def panel_notes(code: Code, found: CorrespondenceMap) -> list[str]:
    """Notes on columns and rows that are never seen between others that are.

    A projector that scales its input (keystone correction, another resolution) drops some, so that
    panel and screen do not match one to one. Only codes that identify single columns show it.
    """
    if code.has_waves or max(code.x.resolution_px, code.y.resolution_px) > 1:
        return []
    shares = {}
    for i, axis in enumerate(AXES):
        positions = found.projector_xy[..., i]
        if _step_px(positions) > MAX_STEP_PX:
            continue
        unseen = unseen_share(positions[found.valid])
        if unseen > UNSEEN_SHARE:
            shares[NAMES[axis]] = unseen
    if not shares:
        return []
    what = " and ".join(f"{share:.0%} of the {name}" for name, share in shares.items())
    return [
        f"{what} are never seen between others that are: the projector scales its picture, so that "
        "panel and screen do not match one to one; switch off its keystone correction and feed it "
        "its native resolution"
    ]


def _step_px(positions: FloatArray) -> float:
    """Mean distance [projector px] of neighbouring camera pixels, along the axis where it is larger."""
    steps = [np.abs(np.diff(positions, axis=axis)) for axis in (0, 1)]
    each = [float(np.nanmean(step)) if np.isfinite(step).any() else np.inf for step in steps]
    return max(each)


def unseen_share(positions: FloatArray) -> float:
    """Share of the columns between the first and last one seen into which no position (N,) falls."""
    if not len(positions):
        return 0.0
    column = np.rint(positions).astype(int)
    count = np.bincount(column - column.min())
    if len(positions) < PIXELS_PER_LINE * len(count):
        return 0.0
    around = np.convolve(count, np.ones(9), "same") / 9
    judged = around >= PIXELS_PER_LINE / 2
    return float(np.mean(count[judged] == 0)) if judged.any() else 0.0
