"""Compares a calibration with the truth, by the definitions of the figures (docs/figures.md)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.files.calibration import load_calibration
from procam.maths.sphere import angle_between, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.quality import Figure, Goal

Array = NDArray[np.float64]
ALBEDO_WIDTH = 0.06


def judge(calibration_dir: Path, truth_dir: Path) -> dict[str, Figure]:
    """Figures of a calibration against the truth in the same format."""
    found, truth = load_calibration(calibration_dir), load_calibration(truth_dir)
    return {**_geometry(found, truth), **_transport(found, truth)}


def _geometry(found: Calibration, truth: Calibration) -> dict[str, Figure]:
    """Direction error over every pixel whose true ray meets an addressable point, unweighted."""
    errors, sums = [], []
    for name, projector in truth.projectors.items():
        addressable = projector.surface.valid
        ours = found.projectors[name].surface
        error = angle_between(
            ours.direction[addressable].astype(float),
            projector.surface.direction[addressable].astype(float),
        )
        errors.append(np.degrees(error) * 60)
        footprint = float(projector.surface.solid_angle_sr[addressable].sum(dtype=float))
        sums.append(float(ours.solid_angle_sr[ours.valid].sum(dtype=float)) / footprint - 1)
    error = np.concatenate(errors)
    sphere = found.quality.get("sphere_variance_ratio")
    figures = {
        "direction_error_rms_arcmin": Figure(
            float(np.sqrt(np.mean(error**2))), "arcmin", Goal("<=", 0.5), error.size
        ),
        "direction_error_max_arcmin": Figure(float(error.max()), "arcmin", None, error.size),
        "solid_angle_sum_error": Figure(
            float(max(sums, key=abs)), "-", Goal("<=", 3e-4), len(sums), "worst projector, signed"
        ),
    }
    if sphere is not None:
        figures["dome_is_sphere"] = Figure(
            bool(sphere.passed), "-", None, sphere.samples, f"variance ratio {sphere.value:.2f}"
        )
    return figures


def _transport(found: Calibration, truth: Calibration) -> dict[str, Figure]:
    low, high = found.albedo.interval()
    true_albedo = truth.albedo.value
    width = float(np.max((high - low) / 2 / found.albedo.value))
    covers = bool(np.all((low <= true_albedo) & (true_albedo <= high)) and width < ALBEDO_WIDTH)
    m_low, m_high = found.feedback.interval()
    solid = master_solid_angles(found.maps.size) * found.maps.coverage
    return {
        "feedback": Figure([float(v) for v in found.feedback.value], "-", None, 3),
        "feedback_error": _worst(found.feedback.value, truth.feedback.value, 0.02),
        "feedback_interval_covers": Figure(
            bool(np.all((m_low <= truth.feedback.value) & (truth.feedback.value <= m_high))), "-"
        ),
        "albedo": Figure([float(v) for v in found.albedo.value], "-", None, 3),
        "albedo_error": _worst(found.albedo.value, true_albedo, 0.04),
        "albedo_interval_covers": Figure(
            covers, "-", Goal("==", True), 3, f"95 % interval, half width {width:.1%} (limit 6 %)"
        ),
        "lit_solid_angle": Figure(float(solid.sum()), "sr"),
    }


def _worst(found: Array, true: Array, goal: float) -> Figure:
    error = found / true - 1
    return Figure(float(error[np.argmax(np.abs(error))]), "-", Goal("<=", goal), 3, "signed")
