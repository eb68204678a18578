"""`procam refine` on a small simulated dome, whose light is traced without the loop's formulas."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from linear_pictures import write_picture
from looped_dome import MASTER, SIZE, broad, quick_loop
from tiny_venue import (
    calibrated,
    procam,
    refused,
    replace_camera,
    watch_stage,
)

from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.maths.geometry.sphere import master_directions
from procam.model.calibration import Calibration
from procam.model.frame import Frame
from procam.model.screen import Dome
from procam.model.transport import Measured
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.refine import camera as loop_camera
from procam.workflows.refine import refine as refining
from procam.workflows.refine import shown_picture
from procam.workflows.venue_rig import open_rig
from simulators.mistakes import AlteringCamera


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Cells as wide as such a camera allows."""
    with quick_loop():
        yield


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory, quick: None) -> Path:
    return calibrated(tmp_path_factory.mktemp("dome"), SIZE).directory


@pytest.fixture(scope="module")
def good(once: Path) -> Calibration:
    return load_calibration(once / "calibrations" / "0001")


@pytest.fixture
def dome(once: Path, tmp_path: Path) -> Path:
    """A venue of its own, calibrated once."""
    shutil.copytree(once, tmp_path / "dome", ignore=shutil.ignore_patterns("sessions"))
    return tmp_path / "dome"


def _spoilt(calibration: Calibration, gain: float, scatter: float) -> Calibration:
    """Gains wrong by `gain` rms in slow waves, scatter wrong by the factor `scatter`."""
    projectors = {}
    for name, projector in calibration.projectors.items():
        wave = np.sin(5 * np.nan_to_num(projector.surface.direction) @ [0.6, 0.5, 0.7])
        wrong = (1 + gain * np.sqrt(2) * wave)[..., None].astype(np.float32)
        photometry = replace(projector.photometry, gain=projector.photometry.gain * wrong)
        projectors[name] = replace(projector, photometry=photometry)
    u = calibration.maps.scatter_per_flux * np.float32(scatter)
    m = calibration.feedback
    return replace(
        calibration,
        projectors=projectors,
        maps=replace(calibration.maps, scatter_per_flux=u),
        feedback=Measured(m.value * scatter, m.sigma),
    )


def _refined(dome: Path, calibration: Calibration) -> refining.Refined:
    venue = load_venue(dome)
    with open_rig(venue) as rig:
        photographer = DrivenPhotographer(rig, calibration)
        return result_of(refining.refine(photographer, venue, calibration, broad()))


def _alter(monkeypatch: pytest.MonkeyPatch, change: Callable[[Frame, int], Frame]) -> None:
    """Change the photographs of the rigs that are opened from now on."""
    watch_stage(
        monkeypatch,
        lambda stage: replace_camera(stage.backend, lambda camera: AlteringCamera(camera, change)),
    )


class TestLoop:
    def test_wrong_gains_and_wrong_feedback_are_found(self, once: Path, good: Calibration) -> None:
        spoilt = _spoilt(good, 0.05, 1.1)
        refined = _refined(once, spoilt)
        assert not refined.worse
        assert refined.residual[-1] < 0.35 * refined.residual[0]
        assert refined.own_residual < 0.4 * refined.residual[0]
        assert refined.own_jnd < 0.4 * refined.left_jnd[0]
        before, after = refined.unseen
        assert after < 0.4 * before
        assert refined.better
        np.testing.assert_allclose(
            refined.calibration.feedback.value, good.feedback.value, rtol=0.03
        )

    def test_the_feedback_of_a_good_calibration_does_not_change(
        self, once: Path, good: Calibration
    ) -> None:
        refined = _refined(once, good)
        assert not refined.worse
        np.testing.assert_array_equal(refined.scatter_factor, 1)
        assert refined.residual[-1] <= refined.residual[0]
        assert refined.calibration.quality.keys() >= refined.figures().keys()
        assert refined.calibration.quality.keys() >= good.quality.keys()


class TestCommand:
    def test_a_new_version_with_its_own_figures(self, dome: Path) -> None:
        ran = procam("refine", dome, "--json")
        document = json.loads(ran.out)
        assert document["calibration"] == str(dome / "calibrations" / "0002")
        assert ran.code == int(any(f["pass"] is False for f in document["figures"].values()))
        found = load_calibration(dome / "calibrations" / "0002")
        assert found.quality["loop_own_jnd"].value == document["figures"]["loop_own_jnd"]["value"]
        curve = json.loads((dome / "loop" / "loop.json").read_text())
        assert curve["residual"] == document["figures"]["loop_residual_by_iteration"]["value"]

    @pytest.mark.parametrize(
        ("harmless", "words"), [(0.001, "% of white before"), (1.0, "light at azimuth")]
    )
    def test_a_regression_is_reported_and_the_old_calibration_kept(
        self, dome: Path, monkeypatch: pytest.MonkeyPatch, harmless: float, words: str
    ) -> None:
        monkeypatch.setattr(refining, "HARMLESS", harmless)
        monkeypatch.setattr(
            refining, "with_gains", lambda calibration, _: _spoilt(calibration, 0.1, 1)
        )
        ran = procam("refine", dome)
        assert ran.code == 1
        line = ran.out.splitlines()[-1]
        old = dome / "calibrations" / "0001"
        assert line.startswith(f"nothing written, {old} stays newest: ")
        assert words in line and "before the loop" in line
        assert not (dome / "calibrations" / "0002").exists()

    def test_nothing_to_correct(self, dome: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(shown_picture, "converged", lambda *_: True)
        ran = procam("refine", dome)
        old = dome / "calibrations" / "0001"
        assert ran.out.splitlines()[-1] == f"nothing to correct, {old} stays newest"
        assert not (dome / "calibrations" / "0002").exists()

    @pytest.mark.parametrize("level", [0.5, 1.0])
    def test_what_is_unseen_can_be_shown_whatever_the_picture(self, level: float) -> None:
        """Inverted, white would be black everywhere, where nothing can be measured."""
        content = np.full((MASTER, MASTER, 3), level, np.float32)
        unseen = refining.turned_and_inverted(content, Dome(6.0, 1.5))
        inside = master_directions(MASTER)[1]
        assert unseen[inside].min() >= refining.DIM and (unseen[~inside] == 0).all()

    def test_a_picture_of_black_is_refused(self, dome: Path, tmp_path: Path) -> None:
        write_picture(tmp_path / "black.exr", np.zeros((MASTER, MASTER, 3), np.float32))
        assert "choose another --picture" in refused(
            "refine", dome, "--picture", tmp_path / "black.exr"
        )


def _put_light(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """A lamp in the room: 2 % of full scale in every photograph after the `first` ones."""

    def lit(frame: Frame, taken: int) -> Frame:
        lamp = 80 * frame.settings.exposure_s / 0.1 * (taken >= first)
        return replace(frame, counts=(frame.counts + np.uint16(lamp)).clip(0, 4095))

    _alter(monkeypatch, lit)


class TestRoomLight:
    def test_light_that_stays_is_not_learnt(
        self, dome: Path, good: Calibration, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        alone = _refined(dome, good)
        _put_light(monkeypatch, 0)
        lit = _refined(dome, good)
        assert lit.residual[0] == pytest.approx(alone.residual[0], rel=0.3)
        difference = lit.photographs["before"] - alone.photographs["before"]
        assert abs(difference[alone.free].mean()) < 5e-4

    def test_light_that_changes_is_refused(
        self, dome: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        _put_light(monkeypatch, 12)
        assert "the light in the room changed by" in refused("refine", dome)
        assert not (dome / "calibrations" / "0002").exists()


def test_a_picture_that_one_exposure_cannot_hold_is_bracketed(
    once: Path, good: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Merged brackets give the same light as single photographs."""
    monkeypatch.setattr(shown_picture, "converged", lambda *_: True)
    single = _refined(once, good)
    monkeypatch.setattr(loop_camera, "bracket_for", lambda light, sigma, e: (e, 4 * e))
    bracketed = _refined(once, good)
    dark = 4 + 1  # of the room, before and after
    assert (single.shots, bracketed.shots) == (dark + 5, dark + 1 + 4 + 2 + 2 * 4 + 1)
    dark = bracketed.free & (bracketed.target < 0.3)
    alone, merged = (r.photographs["after"][dark] for r in (single, bracketed))
    assert abs(merged.mean() / alone.mean() - 1) < 0.005
