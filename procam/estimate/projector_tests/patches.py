"""Camera pixels that see the test patches, and the light of the patches in a photograph."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, label, median_filter

from procam.arrays import AnyArray, Array, BoolArray, IndexArray
from procam.errors import NotEnoughData
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.projector_tests.patterns import COUNT, PatchLayout, patch_bits, patch_codes

CLEAR_SIGMAS = 6.0  # by which light must exceed the noise
FAINT_SHARE = 0.02  # of the brightest light: pixels with less are not used as divisors
INSIDE = 0.5  # of a patch's plateau: its geometrical border
MARGIN_PX = 3.0  # of the projector: blur and sharpening do not reach further
MIN_CAMERA_PIXELS = 4
MIN_PATCHES = 6


@dataclass(frozen=True, slots=True)
class PatchLight:
    """Mean signals (8, C) of the patches above the black level [DN], and their variances; NaN if unseen."""

    mean: Array
    variance: Array

    def scaled(self, factor: float) -> "PatchLight":
        """The same light at an exposure `factor` times as long."""
        return PatchLight(factor * self.mean, factor**2 * self.variance)

    def __add__(self, other: "PatchLight") -> "PatchLight":
        return PatchLight(self.mean + other.mean, self.variance + other.variance)

    def __sub__(self, other: "PatchLight") -> "PatchLight":
        return self + other.scaled(-1)

    def where(self, chosen: BoolArray, other: "PatchLight") -> "PatchLight":
        """These values for the patches `chosen` (8,), those of the other light for the rest."""
        pick = chosen[:, None]
        return PatchLight(
            np.where(pick, self.mean, other.mean), np.where(pick, self.variance, other.variance)
        )

    def over(self, other: "PatchLight") -> "PatchLight":
        """Ratio to an independent light."""
        ratio = self.mean / other.mean
        return PatchLight(ratio, (self.variance + ratio**2 * other.variance) / other.mean**2)

    def all_channels(self) -> "PatchLight":
        """Sum over the channels (8, 1)."""
        return PatchLight(
            self.mean.sum(axis=1, keepdims=True), self.variance.sum(axis=1, keepdims=True)
        )


@dataclass(frozen=True, slots=True)
class Patches:
    """Camera pixels well inside the patches, and the camera's scale there.

    Attributes
    ----------
    place : (H, W) index of the patch of each camera pixel, -1 for none.
    camera_px : (8,) side of a projector pixel [camera px]; NaN for patches that are not seen.
    """

    place: IndexArray
    camera_px: Array

    @property
    def largest_px(self) -> float:
        """Side of a projector pixel where it appears largest [camera px]."""
        return float(np.nanmax(self.camera_px))

    @property
    def scale(self) -> float:
        """Median side of a projector pixel [camera px]."""
        return float(np.nanmedian(self.camera_px))

    def read(self, signal: AnyArray, noise: NoiseLaw) -> PatchLight:
        """Mean light of each patch in a photograph of signals (H, W, C) above black [DN]."""
        inside = self.place >= 0
        index = self.place[inside]
        values = np.asarray(signal[inside], float)
        count = np.bincount(index, minlength=COUNT)[:, None].astype(float)
        sums = np.stack([np.bincount(index, v, COUNT) for v in values.T], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(count > 0, sums / count, np.nan)
            return PatchLight(mean, noise.variance(np.maximum(mean, 0)) / count)


def find_patches(
    pair: tuple[Array, Array],
    bits: Sequence[Array],
    span: Array,
    noise: NoiseLaw,
    layout: PatchLayout,
) -> Patches:
    """Find the patches in photographs; each is identified by three bits.

    Parameters
    ----------
    pair : signals (H, W) of `PatchLayout.pair`. bits : of `PatchLayout.bit` 1 and 2.
    span : white - black (H, W). noise : of the camera.

    Raises
    ------
    NotEnoughData : fewer than six patches are well seen.
    """
    clear = span > np.maximum(CLEAR_SIGMAS * noise.variance(span) ** 0.5, FAINT_SHARE * span.max())
    direct = pair[0] - pair[1]
    share = np.where(clear, np.abs(direct) / np.where(clear, span, 1), 0)
    share = median_filter(share, 3)
    plateau = float(np.quantile(share[share > INSIDE * share.max()], 0.5)) if share.any() else 1.0
    middle = 0.5 * (pair[0] + pair[1])
    codes = (direct > 0).astype(np.intp)
    for bit, signal in enumerate(bits, start=1):
        codes |= median_filter(signal > middle, 3).astype(np.intp) << bit
    place = np.full(span.shape, -1)
    camera_px = np.full(COUNT, np.nan)
    for index, code in enumerate(patch_codes()):
        blob = _largest((share > INSIDE * plateau) & (codes == code))
        scale = float(blob.sum()) ** 0.5 / layout.side_px
        inner = distance_transform_edt(blob) > max(MARGIN_PX * scale, 1.0)
        if inner.sum() >= MIN_CAMERA_PIXELS:
            place[inner], camera_px[index] = index, scale
    seen = int(np.isfinite(camera_px).sum())
    if seen < MIN_PATCHES:
        raise NotEnoughData(
            f"test patches: the camera sees {seen} of {COUNT} well and needs {MIN_PATCHES}; turn it "
            "towards the picture, or use more pixels"
        )
    return Patches(place, camera_px)


def direct_light(pair: tuple[PatchLight, PatchLight]) -> PatchLight:
    """Direct light of white patches; scattered light cancels in the difference of the pair."""
    return (pair[0] - pair[1]).where(patch_bits(0), pair[1] - pair[0])


def _largest(mask: BoolArray) -> BoolArray:
    """The largest connected part of a mask (H, W)."""
    labels, count = label(mask)
    if count == 0:
        return mask
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(labels == sizes.argmax())
