"""Two calibrations of a rig compared: directions, light, and the picture that each one's frames make."""

from dataclasses import replace

from procam.compensate.predicted_picture import predict_picture
from procam.estimate.comparison.compare import Comparison, compare_calibrations
from procam.estimate.comparison.verdict import PictureStep, judge_picture
from procam.model.calibration import Calibration


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Compare A and B, whose projectors have the same names and sizes; they agree if their pictures do too.

    Raises
    ------
    CalibrationError
        As `compare_calibrations`.
    """
    found = compare_calibrations(first, second)
    step = _picture_step(first, second)
    return replace(found, picture=step, verdict=judge_picture(found.verdict, step))


def _picture_step(first: Calibration, second: Calibration) -> PictureStep | None:
    """How a uniform picture by B's frames differs from that by A's, both on A's dome."""
    before, after = predict_picture(first), predict_picture(second, first)
    use = before.judged & (before.total > 0).all(axis=-1)
    if not use.any():
        return None
    ratio = after.total[use] / before.total[use]
    level = float(ratio.mean())
    shares = {name: (before.share_lit[name], after.share_lit[name]) for name in first.projectors}
    return PictureStep(level, float(ratio.std() / level) if level > 0 else 1.0, shares)
