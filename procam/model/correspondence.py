"""Maps between camera pixels, projector pixels and directions on the dome."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.arrays import BoolArray, Map


@dataclass(frozen=True, slots=True)
class CorrespondenceMap:
    """Per camera pixel: `projector_xy` (H, W, 2) [px] and its standard error `sigma_px` (H, W, 2).

    Both are NaN where not `valid` (H, W). `shared_px` (H, W, 2) is the part of the standard error
    that neighbouring pixels share, so that averaging does not reduce it; None for none.
    """

    projector_xy: Map
    sigma_px: Map
    valid: BoolArray
    shared_px: Map | None = None


@dataclass(frozen=True, slots=True)
class ProjectorMap:
    """For each square patch of a panel, the place in the camera where its centre is seen.

    Attributes
    ----------
    patch_px : edge of the patches [px]; patch (row i, column j) is centred on projector pixel
        ((j + 1/2) patch_px - 1/2, (i + 1/2) patch_px - 1/2).
    camera_px : (h, w, 2) position in the camera [px]; NaN where not `valid` (h, w).
    sigma_px : (h, w) standard error in PROJECTOR pixels, along x and along y.
    slope : (h, w, 2, 2) projector pixels per camera pixel.
    coverage : (h, w) share of the patch that camera pixels see. count : (h, w) their number.
    """

    patch_px: int
    camera_px: Map
    sigma_px: Map
    slope: Map
    coverage: Map
    count: NDArray[np.int32]
    valid: BoolArray


@dataclass(frozen=True, slots=True)
class ProjectorSurface:
    """For each projector pixel, its direction and its solid angle, seen from the dome's centre.

    Attributes
    ----------
    direction : (H, W, 3) unit vectors; NaN where the ray misses the screen.
    solid_angle_sr : (H, W) [sr].
    valid : (H, W) light of this pixel reaches the screen.
    measured : (H, W) share of the pixel that a camera saw lit, 0..1.
    sigma_arcmin : (H, W) standard error of the direction [arcmin].
    """

    direction: Map
    solid_angle_sr: Map
    valid: BoolArray
    measured: Map
    sigma_arcmin: Map
