"""Correspondence maps reduced to the observations of a bundle adjustment."""

import numpy as np

from procam.estimate.geometry.model import Observations
from procam.estimate.structured_light.outliers import keep_only
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.model.correspondence import CorrespondenceMap


def gather_observations(found: CorrespondenceMap, size: tuple[int, int]) -> Observations:
    """Camera pixels that see the centres of a panel's patches.

    `size` is (width, height) of the panel [px]. Values that are not finite are ignored, also where
    the map marks them as valid.
    """
    there = np.isfinite(found.projector_xy)
    found = keep_only(found, there[..., 0] & there[..., 1])
    panel = fit_projector_map(found, size)
    kept = drop_inconsistent(found, panel)
    if kept.valid.sum() < found.valid.sum():
        panel = fit_projector_map(kept, size)
    rows, columns = np.nonzero(panel.valid)
    centres = (np.stack([columns, rows], axis=1) + 0.5) * panel.patch_px - 0.5
    return Observations(
        panel.camera_px[panel.valid].astype(float),
        centres.astype(float),
        panel.sigma_px[panel.valid].astype(float),
        panel.patch_px,
    )
