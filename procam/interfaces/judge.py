"""Compares a calibration and its pictures with the truth.

The truth is a calibration directory that the simulator writes when a run has ended. `judge` compares
directions, areas, feedback and albedo; `judge_pictures` compares what the simulated dome shows with the
target, where no limit holds. The figures are defined in docs/figures.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from procam.arrays import Array, BoolArray, Image
from procam.errors import FileFormatError
from procam.estimate.closed_loop.patches import CELL_QUANTILE, just_noticeable
from procam.files.calibration import load_calibration
from procam.files.images.layers import RGB, read_channels
from procam.maths.geometry.sphere import (
    angle_between,
    master_directions,
    master_pixels,
    master_solid_angles,
)
from procam.maths.warp import block_mean
from procam.model.calibration import Calibration
from procam.model.quality import Figure, Goal

ALBEDO_WIDTH = 0.06  # largest relative half width of an interval that is worth its name
PATCHES = 256  # edge of the dome master whose pixels are the patches, 0.7 degrees wide
LSB = 1 / 255
WHOLE = 0.999  # share from which a patch counts as lit, or as free of limits


def judge(calibration_dir: Path, truth_dir: Path) -> dict[str, Figure]:
    """Figures of a calibration against the truth in the same format."""
    found, truth = load_calibration(calibration_dir), load_calibration(truth_dir)
    missing = set(truth.projectors) - set(found.projectors)
    if missing:
        raise FileFormatError(
            f"{calibration_dir} has no projector {', '.join(sorted(missing))}, which {truth_dir} has; is it "
            "the truth of another venue?"
        )
    return {**_geometry(found, truth), **_transport(found, truth)}


def judge_pictures(venue_dir: Path, calibration_dir: Path, truth_dir: Path) -> dict[str, Figure]:
    """What is wrong with the pictures that the simulator shows.

    interreflection_left = sqrt(sum_F a (x + s - t)^2 / sum_F a s0^2) for x the direct light asked for, s its
    scattered light, s0 that of the uncompensated picture, t the target, over F: lit patches and channels
    where no limit holds. scatter_left has what was shown instead of x + s. Worst channel; the signed mean
    apart. picture_error_jnd is over all that is lit; its parts are not exclusive.
    """
    calibration, truth = load_calibration(calibration_dir), load_calibration(truth_dir)
    pictures = _Pictures.read(venue_dir, calibration, truth, truth_dir)
    free = _free(calibration, truth, pictures)
    figures = _interreflection_left(pictures, free)
    figures |= _visible_errors(pictures, truth.maps.coverage > WHOLE)
    uncompensated = pictures.shown["none"] - pictures.target
    for method, name, goal in (
        ("exact", "scatter_left_exact", Goal("<=", 0.02)),
        ("paper-eq12", "scatter_left_paper_eq12", None),
        ("refined", "scatter_left_refined", Goal("<=", 0.02)),
    ):
        if method in pictures.shown:
            error = pictures.shown[method] - pictures.target
            coarse = _patches(error, PATCHES), _patches(uncompensated, PATCHES)
            figures |= _scatter(name, goal, *coarse, free)
            fine = _scatter(name, None, error, uncompensated, free)[name]
            figures[f"{name}_fine"] = replace(fine, note="the same on patches of 0.18 degrees")
    figures["scatter_before"] = _scatter_before(_patches(uncompensated, PATCHES), free)
    return figures


@dataclass(frozen=True, slots=True)
class _Pictures:
    """Pictures (N, N, 3) in content channels, of the same content.

    `target` is wanted, `direct` the light asked for; `shown` and its part `scattered` are what the
    dome shows, by method; `black` is the direct light of black.
    """

    target: Image
    direct: Image
    black: Image
    shown: Mapping[str, Image]
    scattered: Mapping[str, Image]

    @classmethod
    def read(
        cls, venue_dir: Path, calibration: Calibration, truth: Calibration, truth_dir: Path
    ) -> "_Pictures":
        to_content = calibration.content_from_camera.T.astype(np.float32)
        shown, scattered = (
            {p.stem: _rgb(p) @ to_content for p in sorted((truth_dir / kind).glob("*.exr"))}
            for kind in ("pictures", "scattered")
        )
        target, direct = (_rgb(venue_dir / "pictures" / f"{x}.exr") for x in ("target", "direct"))
        return cls(target, direct, truth.maps.lo @ to_content, shown, scattered)

    @property
    def asked(self) -> Image:
        """Light on a dome whose projectors draw exactly what they are asked for."""
        return self.direct + self.scattered["exact"]


def _interreflection_left(pictures: _Pictures, free: Image) -> dict[str, Figure]:
    left = _patches(pictures.asked - pictures.target, PATCHES)
    before = _patches(pictures.scattered["none"], PATCHES)
    return _scatter("interreflection_left", Goal("<=", 0.01), left, before, free)


def _visible_errors(pictures: _Pictures, lit: BoolArray) -> dict[str, Figure]:
    """Errors over `lit` (N, N) of the uncompensated and of the compensated picture, and parts of it."""
    shown, exact = pictures.shown, pictures.shown["exact"]
    drawn = exact - pictures.scattered["exact"]
    errors = {
        "picture_error_jnd_before": shown["none"] - pictures.target,
        "picture_error_jnd": exact - pictures.target,
        "picture_error_jnd_interreflection": pictures.asked - pictures.target,
        "picture_error_jnd_black": np.maximum(pictures.black - pictures.direct, 0),
        "picture_error_jnd_drawing": drawn - np.maximum(pictures.direct, pictures.black),
    }
    return {name: _visible(error[lit], pictures.target[lit]) for name, error in errors.items()}


def _visible(error: Image, light: Image) -> Figure:
    """What 95 % of the values of `error` (n, C) do not exceed, in JND of `light` (n, C)."""
    visible = np.abs(error) / just_noticeable(np.asarray(light, np.float64))
    note = f"{CELL_QUANTILE:.0%} of the lit picture is off by at most this"
    return Figure(float(np.quantile(visible, CELL_QUANTILE)), "JND", None, visible.size, note)


def _free(calibration: Calibration, truth: Calibration, pictures: _Pictures) -> Image:
    """F (N, N, 3): lit in truth, compensated, and with direct light clear of black and white."""
    direct = pictures.direct
    free = (direct > pictures.black + LSB) & (direct < calibration.maps.hi - LSB)
    direction, _ = master_directions(len(direct))
    protected = calibration.maps.is_protected(master_pixels(direction, calibration.maps.size))
    compared = (truth.maps.coverage > WHOLE) & ~protected
    return (free & compared[..., None]).astype(np.float32)


def _weight(free: Image, size: int) -> Array:
    """Solid angle (P, P, 3) of the patches and channels that lie in F as a whole, 0 elsewhere."""
    return np.asarray(master_solid_angles(size)[..., None] * (_patches(free, size) > WHOLE))


def _scatter(
    name: str, goal: Goal | None, error: Image, scattered: Image, free: Image
) -> dict[str, Figure]:
    weight = _weight(free, error.shape[0])
    left = np.sqrt(_sum(weight * error**2) / _sum(weight * scattered**2))
    mean = _sum(weight * error) / _sum(weight * scattered)
    count = int((weight > 0).sum())
    return {
        name: Figure(float(left.max()), "-", goal, count, "worst channel"),
        f"{name}_mean": Figure(float(mean[np.argmax(np.abs(mean))]), "-", None, count, "signed"),
    }


def _scatter_before(scattered: Image, free: Image) -> Figure:
    weight = _weight(free, scattered.shape[0])
    mean = _sum(weight * scattered) / _sum(weight)
    return Figure(float(mean.max()), "rel", None, int((weight > 0).sum()), "mean, worst channel")


def _sum(values: Array) -> Array:
    return np.asarray(values.sum(axis=(0, 1)))


def _patches(picture: Image, size: int) -> Image:
    return block_mean(picture, picture.shape[0] // size)


def _rgb(path: Path) -> Image:
    channels = read_channels(path)
    return np.stack([channels[c] for c in RGB], axis=-1)


def _geometry(found: Calibration, truth: Calibration) -> dict[str, Figure]:
    """Direction errors over every pixel whose true ray meets an addressable point, unweighted."""
    pairs, sums, stated = list[tuple[Array, Array]](), [], []
    for name, projector in truth.projectors.items():
        addressable = projector.surface.valid
        estimated = found.projectors[name].surface
        pairs.append(
            (
                estimated.direction[addressable].astype(float),
                projector.surface.direction[addressable].astype(float),
            )
        )
        stated.append(estimated.sigma_arcmin[addressable & estimated.valid])
        footprint = float(projector.surface.solid_angle_sr[addressable].sum(dtype=float))
        sums.append(
            float(estimated.solid_angle_sr[estimated.valid].sum(dtype=float)) / footprint - 1
        )
    estimate, true = (np.concatenate(each) for each in zip(*pairs, strict=True))
    error, relative = direction_errors(estimate, true)
    sigma = _rms(np.concatenate(stated).astype(float))
    return {
        "direction_error_relative_rms_arcmin": Figure(
            _rms(relative), "arcmin", Goal("<=", 0.5), error.size, "less a common rotation"
        ),
        "direction_error_rms_arcmin": Figure(
            _rms(error),
            "arcmin",
            Goal("<=", round(2 * sigma, 3)),
            error.size,
            f"with the survey of the marks, which makes the calibration state {sigma:.2g}",
        ),
        "direction_error_max_arcmin": Figure(float(error.max()), "arcmin", None, error.size),
        "lit_area_found": _found_area(found, truth),
        "solid_angle_sum_error": _within(
            np.array(sums), 3e-4, "worst projector, signed, footprint against the true one"
        ),
        **_sphere(found),
    }


def _found_area(found: Calibration, truth: Calibration) -> Figure:
    """Share of the truly lit dome that the calibration covers; other figures leave the rest out."""
    lit = master_solid_angles(truth.maps.size) * truth.maps.coverage
    share = float((lit * np.minimum(found.maps.coverage, 1)).sum() / lit.sum())
    return Figure(share, "-", Goal(">=", 0.995), 1, "share of the truly lit dome")


def direction_errors(estimated: Array, true: Array) -> tuple[Array, Array]:
    """Angles (n,) [arcmin] between unit vectors (n, 3), and those left after the best common rotation."""
    turn, _ = Rotation.align_vectors(true, estimated)
    absolute, relative = (
        np.degrees(angle_between(x, true)) * 60 for x in (estimated, turn.apply(estimated))
    )
    return absolute, relative


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _sphere(found: Calibration) -> dict[str, Figure]:
    test = found.quality.get("sphere_variance_ratio")
    if test is None:
        return {}
    note = f"variance ratio {test.value:.2f}, above 2.25 it is no sphere"
    return {"dome_is_sphere": Figure(bool(test.passed), "-", None, test.samples, note)}


def _transport(found: Calibration, truth: Calibration) -> dict[str, Figure]:
    low, high = found.albedo.interval()
    true_albedo = truth.albedo.value
    width = float(np.max((high - low) / 2 / found.albedo.value))
    covers = bool(np.all((low <= true_albedo) & (true_albedo <= high)) and width < ALBEDO_WIDTH)
    m_low, m_high = found.feedback.interval()
    m_covers = bool(np.all((m_low <= truth.feedback.value) & (truth.feedback.value <= m_high)))
    return {
        "feedback": Figure([float(v) for v in found.feedback.value], "-", None, 3),
        "feedback_error": _within(found.feedback.value / truth.feedback.value - 1, 0.02, "signed"),
        "feedback_interval_covers": Figure(m_covers, "-", None, 3, "95 % interval"),
        "albedo": Figure([float(v) for v in found.albedo.value], "-", None, 3),
        "albedo_error": _within(found.albedo.value / true_albedo - 1, 0.04, "signed"),
        "albedo_interval_covers": Figure(
            covers, "-", Goal("==", True), 3, f"95 % interval, half width {width:.1%} (limit 6 %)"
        ),
    }


def _within(errors: Array, limit: float, note: str) -> Figure:
    """The worst of signed errors, which must lie within +-limit."""
    worst = float(errors[np.argmax(np.abs(errors))])
    return Figure(worst, "-", Goal("abs<=", limit), len(errors), note)
