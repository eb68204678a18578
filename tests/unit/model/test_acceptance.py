"""Figures against a client's limits."""

from dataclasses import replace

import numpy as np
import pytest

from procam.model.acceptance import CRITERIA, Finding, Side, Verdict, findings, judge
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.model.transport import Measured

NAN, INF = float("nan"), float("inf")


def _judged(
    value: float | list[float], sigma: float | list[float], limit: float, side: Side
) -> Verdict:
    values, sigmas = np.atleast_1d(value).astype(float), np.atleast_1d(sigma).astype(float)
    return judge(values, sigmas, limit, side)


@pytest.mark.parametrize(
    ("value", "sigma", "limit", "side", "verdict"),
    [
        (0.5, 0.1, 1.0, "most", "pass"),
        (1.0, 0.0, 1.0, "most", "pass"),  # the limit is within
        (0.8, 0.1, 1.0, "most", "pass"),  # 0.996: standard errors of 1.96, not 1 or 3
        (0.8, 0.11, 1.0, "most", "not shown"),  # 1.016
        (1.1, 0.5, 1.0, "most", "fail"),  # the value decides, whatever the interval reaches
        (0.95, 0.02, 0.9, "least", "pass"),
        (0.95, 0.03, 0.9, "least", "not shown"),
        (0.89, 0.1, 0.9, "least", "fail"),
        (-1.1, 0.5, 1.0, "within", "fail"),
        (-0.8, 0.1, 1.0, "within", "pass"),
        (-0.8, 0.11, 1.0, "within", "not shown"),
        (NAN, 0.1, 1.0, "most", "not shown"),
        (0.5, NAN, 1.0, "most", "not shown"),
        (0.5, INF, 1.0, "most", "not shown"),
        (-INF, 0.0, 1.0, "most", "not shown"),
        ([0.5, 0.5, 1.1], [0.01, 0.5, 0.01], 1.0, "most", "fail"),
        ([0.5, 0.5, NAN], [0.01, 0.01, 0.01], 1.0, "most", "not shown"),
        ([1.1, 0.5, NAN], [0.01, 0.01, 0.01], 1.0, "most", "fail"),
    ],
)
def test_the_whole_interval_must_be_within(
    value: float | list[float],
    sigma: float | list[float],
    limit: float,
    side: Side,
    verdict: Verdict,
) -> None:
    assert _judged(value, sigma, limit, side) == verdict


class TestFinding:
    def test_a_figure_without_a_standard_error_is_judged_by_its_value(self) -> None:
        at_limit = Finding("coverage", 0.9, np.array([0.9]), None)
        assert at_limit.verdict == "pass" and at_limit.interval() is None

    def test_a_measured_one_that_lost_its_standard_error_is_not_shown(self) -> None:
        assert Finding("albedo", 0.9, np.array([0.1]), None).verdict == "not shown"
        assert Finding("albedo", 0.05, np.array([0.1]), None).verdict == "fail"

    def test_a_stated_standard_error_counts(self) -> None:
        finding = Finding("coverage", 0.9, np.array([0.91]), np.array([0.01]))
        assert finding.verdict == "not shown"
        low, high = finding.interval() or ([], [])
        assert (low[0], high[0]) == (pytest.approx(0.8904), pytest.approx(0.9296))

    def test_json_has_null_for_what_is_not_known(self) -> None:
        entry = Finding("feedback", 0.5, np.array([0.1, NAN, 0.3]), None).as_dict()
        assert entry["value"] == [0.1, None, 0.3]
        assert (entry["low"], entry["high"], entry["verdict"]) == (None, None, "not shown")
        assert Finding("coverage", 0.9, None, None).as_dict()["value"] is None


class TestFindings:
    def test_each_limit_finds_its_figure(self, calibration: Calibration) -> None:
        quality = {
            "coverage": Figure(0.93, "-"),
            "direction_sigma_arcmin": Figure(7.0, "arcmin", sigma=0.5),
            "loop_unseen_residual": Figure([0.02, 0.004], "rel", sigma=[0.001, 0.0005]),
        }
        limits = {
            "loop_unseen_residual": 0.01,
            "coverage": 0.9,
            "albedo": 0.5,
            "feedback": 0.5,
            "direction_sigma_arcmin": 7.5,
            "loop_own_jnd": 1.0,
        }
        found = {f.name: f for f in findings(replace(calibration, quality=quality), limits)}
        verdicts = {name: finding.verdict for name, finding in found.items()}
        assert verdicts == {
            "direction_sigma_arcmin": "not shown",
            "coverage": "pass",
            "feedback": "pass",
            "albedo": "fail",  # 0.57 of blue
            "loop_own_jnd": "not shown",  # not measured
            "loop_unseen_residual": "pass",  # the value after, not the one before
        }
        assert list(found) == [name for name in CRITERIA if name in limits]
        unseen = found["loop_unseen_residual"]
        assert (unseen.value, unseen.sigma) == (np.array([0.004]), np.array([0.0005]))

    def test_without_a_calibration_nothing_is_shown(self) -> None:
        assert [f.verdict for f in findings(None, {"albedo": 0.5})] == ["not shown"]

    def test_an_interval_that_reaches_beyond_is_not_shown(self, calibration: Calibration) -> None:
        albedo = Measured(np.array([0.4, 0.49, 0.4]), np.full(3, 0.01))
        (found,) = findings(replace(calibration, albedo=albedo), {"albedo": 0.5})
        assert found.verdict == "not shown"
