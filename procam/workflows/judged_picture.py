"""What of a picture an audience will see: what clips, how dark darks are, how much contrast is left."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, Image

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of R, G, B in their white: ITU-R BT.709
DARK_SHARE = 0.25  # of what is lit: what counts as a picture's darks
LEVEL = 1e-6  # a contrast below it is a flat picture's rounding


@dataclass(frozen=True, slots=True)
class PictureFigures:
    """What is expected of one picture; shares are of the lit solid angle.

    Attributes
    ----------
    clipped_black, clipped_white : shares where some colour cannot be as dark, or as bright, as the
        picture asks for, when it is compensated.
    unclipped : the whole picture can be shown exactly.
    darkest : least level that can be shown beside the rest of the picture [rel to white].
    dark_lift_before, dark_lift_after : by how much the darkest quarter is too bright [rel to white].
    contrast_target, contrast_before, contrast_after : rms over mean of the luminance.
    contrast_restored : share of the lost contrast that compensation restores; NaN if none is lost.
    """

    clipped_black: float
    clipped_white: float
    unclipped: bool
    darkest: float
    dark_lift_before: float
    dark_lift_after: float
    contrast_target: float
    contrast_before: float
    contrast_after: float
    contrast_restored: float


@dataclass(frozen=True, slots=True)
class Seen:
    """A picture as asked for, as seen without and with compensation (N, N, 3), and what clips.

    `limits` (N, N) is 0 where it is exact, 1 too bright, 2 too dark, 3 unlit.
    """

    target: Image
    before: Image
    after: Image
    limits: NDArray[np.uint8]


class Shown(Protocol):
    """A compensated picture (H, W, 3): light that is sent and seen, and where no limit holds."""

    @property
    def direct(self) -> Image: ...  # noqa: D102
    @property
    def observed(self) -> Image: ...  # noqa: D102
    @property
    def free(self) -> BoolArray: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Judged:
    """What of a picture is judged: pixels (H, W) that are `lit`, of them those that may clip (`free`).

    `weight` (H, W) is the area of each; `black` the mean light of the projectors' black [rel].
    """

    lit: BoolArray
    free: BoolArray
    weight: Array
    black: float


def figures_of(
    content: Image, before: Image, exact: Shown, judged: Judged
) -> tuple[PictureFigures, Seen]:
    """What is expected of a picture (H, W, 3), from how it is seen `before`, and with compensation."""
    lit = judged.lit
    bright, dark = _limits(content, exact, lit & judged.free)
    solid = judged.weight[lit]
    shown = (content, before, exact.observed)
    target, without, after = (p[lit] @ LUMINANCE for p in shown)
    scattered = (exact.observed - exact.direct)[lit] @ LUMINANCE
    darks = solid * (target <= _quantile(target, solid, DARK_SHARE))
    contrast = [_rms_contrast(light, solid) for light in (target, without, after)]
    figures = PictureFigures(
        clipped_black=_mean(bright[lit], solid),
        clipped_white=_mean(dark[lit], solid),
        unclipped=not (bright | dark).any(),
        darkest=_mean(scattered, solid) + judged.black,
        dark_lift_before=_mean(without - target, darks),
        dark_lift_after=_mean(after - target, darks),
        contrast_target=contrast[0],
        contrast_before=contrast[1],
        contrast_after=contrast[2],
        contrast_restored=_restored(*contrast),
    )
    limits = np.select([~lit, bright, dark], [3, 1, 2]).astype(np.uint8)
    return figures, Seen(content, before, exact.observed, limits)


def _limits(content: Image, exact: Shown, free_to_clip: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Where some colour stays too bright, and where too dark, (N, N) each."""
    bound = ~exact.free & free_to_clip[..., None]
    bright = (bound & (exact.observed > content)).any(axis=-1)
    dark = (bound & (exact.observed < content)).any(axis=-1)
    return np.asarray(bright), np.asarray(dark)


def _mean(values: Array | BoolArray, solid: Array) -> float:
    return float(solid @ values / solid.sum())


def _quantile(values: Array, solid: Array, share: float) -> float:
    """Value below or at which `share` of the solid angle lies."""
    order = np.argsort(values)
    total = np.cumsum(solid[order])
    return float(values[order[np.searchsorted(total, share * total[-1])]])


def _rms_contrast(light: Array, solid: Array) -> float:
    mean = _mean(light, solid)
    return float(np.sqrt(_mean((light - mean) ** 2, solid))) / mean if mean > 0 else float("nan")


def _restored(target: float, before: float, after: float) -> float:
    return (after - before) / (target - before) if abs(target - before) > LEVEL else float("nan")
