"""Correspondence maps boiled down to what a bundle adjustment needs."""

import numpy as np

from procam.estimate.geometry.model import Observations
from procam.estimate.structured_light.outliers import keep_only
from procam.estimate.structured_light.panel_map import drop_inconsistent, fit_projector_map
from procam.model.correspondence import CorrespondenceMap


def gather_observations(found: CorrespondenceMap, size: tuple[int, int]) -> Observations:
    """Where a camera sees the centres of a panel's patches; `size` (width, height) of the panel [px].

    What is not finite counts as not seen, whatever the map says of it.
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
    )
