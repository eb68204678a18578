"""Differences that a report maps: direction errors against the truth, and the loop's changes of the gain."""

from pathlib import Path

import numpy as np

from procam.arrays import Array
from procam.files.history.figures import calibration_figures
from procam.files.images.layers import read_layers
from procam.interfaces.report.data import Material
from procam.maths.geometry.sphere import angle_between


def true_errors(material: Material, name: str) -> Array | None:
    """Angles (H, W) [arcmin] between estimated and true pixel directions; NaN where unknown."""
    if material.truth is None or material.calibration is None:
        return None
    path = material.truth.directory / "maps" / f"{name}.exr"
    if not path.is_file():
        return None
    maps = read_layers(path)
    truth = maps["direction"]
    estimated = material.calibration.projectors[name].surface.direction
    error = np.degrees(angle_between(estimated.astype(float), truth.astype(float))) * 60
    return np.where(maps["valid"] > 0.5, error, np.nan)


def gain_change(material: Material, name: str) -> Array | None:
    """Factor (H, W) by which the loop changed a projector's gain; None without two calibrations.

    Calibrations that only added a venue state are passed over: they have the same gains.
    """
    change = None
    before = [p for p in material.calibrations if material.used and p.name < material.used.name]
    for earlier in reversed(before):
        found = _gain_since(earlier, material, name)
        if found is None:
            break
        change = found
        if (np.nan_to_num(change, nan=1.0) != 1).any():
            break
    return change


def _gain_since(earlier: Path, material: Material, name: str) -> Array | None:
    """Gain (H, W) over that of an earlier calibration of the same session; None if there is none."""
    newest = material.calibration
    session, _ = calibration_figures(earlier / "calibration.json")
    path = earlier / "maps" / f"{name}.exr"
    if newest is None or session != newest.provenance.get("session", "") or not path.is_file():
        return None
    old = read_layers(path)["gain"].sum(axis=-1, dtype=float)
    new = newest.projectors[name].photometry.gain.sum(axis=-1, dtype=float)
    return np.where(old > 0, new / np.where(old > 0, old, 1.0), np.nan)
