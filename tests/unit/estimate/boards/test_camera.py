"""A camera from views of a board: simulated views with known truth, and a published real fisheye."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from real_captures import ov_plane_views
from simulated_boards import (
    BEND,
    BOARD,
    FISHEYE,
    MIDDLE,
    NOISE_PX,
    PINHOLE,
    SIZE,
    add_outliers,
    fisheye_views,
    looking_at,
    pinhole_views,
    seen,
)
from tolerances import SIGMAS

from procam.errors import InputError, NotEnoughData
from procam.estimate.boards.camera import BoardView, CameraFit, better_fit, fit_camera, rms
from procam.estimate.boards.corners import BoardRig, residuals, stack_corners
from procam.estimate.boards.robust_fit import IDENTITY, fit_poses
from procam.estimate.boards.start import pose_from_rays
from procam.maths.geometry.lenses import Lens, lens_parameters, project, unproject
from procam.maths.geometry.pose import Pose, align_rotation, rotation_matrix

EDGE_PX = 0.1  # error of a lens at the largest angle that its photographs show


def z_scores(found: Lens, truth: Lens, covariance: np.ndarray) -> np.ndarray:
    miss = lens_parameters(found) - lens_parameters(truth)
    return miss / np.sqrt(np.diag(covariance))


def view_residuals(fit: CameraFit, views: list[BoardView]) -> dict[str, np.ndarray]:
    """Predicted minus observed pixel (N, 2) in new views, of which only the poses are fitted."""
    boards = tuple(pose_from_rays(v.points, unproject(v.pixels, fit.lens)) for v in views)
    corners = stack_corners([v.points for v in views], [v.pixels[None] for v in views])
    corners = replace(corners, area=fit.area)
    rig = fit_poses(corners, BoardRig((fit.lens,), (IDENTITY,), boards, fit.bend))
    error = residuals(corners, rig)[0]
    return {v.name: error[part] for v, part in zip(views, corners.views, strict=True)}


class TestTruth:
    @pytest.mark.parametrize(
        ("lens", "make"),
        [(FISHEYE, fisheye_views), (PINHOLE, pinhole_views)],
        ids=["fisheye", "brown"],
    )
    def test_parameters_lie_within_their_sigmas(self, rng, lens, make) -> None:
        views = make(rng, lens)
        outliers = add_outliers(rng, views[1:], 0.05)
        assert len(outliers) > 20
        fit = fit_camera(views, SIZE, lens.kind)
        assert {(d.view, d.index) for d in fit.dropped} == outliers
        assert not fit.dropped_views
        z = z_scores(fit.lens, lens, fit.covariance)
        assert np.abs(z).max() < SIGMAS, dict(zip(fit.sigma, z, strict=True))
        # noise along two axes; the fitted poses absorb a little of it
        assert rms(fit.residual_px) == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.06)
        assert rms(fit.held_out_px) == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.08)
        assert set(fit.held_out_px) == {v.name for v in views}
        self.check_edge(fit.lens, lens, views)

    @staticmethod
    def check_edge(found: Lens, truth: Lens, views: list[BoardView]) -> None:
        """The projection agrees all round the largest observed angle."""
        reach = unproject(np.concatenate([v.pixels for v in views]), truth)[:, 2].min()
        turn = np.linspace(0, 2 * np.pi, 60)
        side = np.sqrt(1 - reach**2)
        rim = np.stack([side * np.cos(turn), side * np.sin(turn), np.full(60, reach)], axis=1)
        inside = ((project(rim, truth) > 0) & (project(rim, truth) < SIZE)).all(axis=1)
        assert inside.sum() > 3
        # a rotation of the lens is equivalent to one of the camera
        every = np.concatenate([v.pixels for v in views])
        turned = align_rotation(unproject(every, truth), unproject(every, found))
        miss = np.linalg.norm(project(rim @ turned.T, found) - project(rim, truth), axis=1)
        assert miss[inside].max() < EDGE_PX

    def test_sigmas_cover_repeated_noise(self) -> None:
        """With noise alone the sigmas, which also allow for misfits, are at most twice the error."""
        scores = []
        for seed in range(8):
            rng = np.random.default_rng(seed)
            fit = fit_camera(pinhole_views(rng, PINHOLE, 8), SIZE, "brown")
            scores.append(z_scores(fit.lens, PINHOLE, fit.covariance))
        # eight independent sets: the rms of a parameter's z is within 1 +- 0.7 if its sigma is right
        assert 0.5 * 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.2
        assert np.mean(np.abs(scores) <= 2) >= 0.9

    def test_exact_corners_give_the_exact_lens(self, rng) -> None:
        fit = fit_camera(fisheye_views(rng, FISHEYE, 8, noise_px=0.0), SIZE, "kannala-brandt")
        np.testing.assert_allclose(fit.lens.focal, FISHEYE.focal, rtol=1e-7)
        np.testing.assert_allclose(fit.bend, BEND, atol=1e-8)

    def test_a_view_of_another_board_is_dropped_and_named(self, rng) -> None:
        views = pinhole_views(rng, PINHOLE)
        other = views[4]
        wrong = rng.uniform(200, 800, other.pixels.shape)
        views[4] = replace(other, pixels=wrong)
        fit = fit_camera(views, SIZE, "brown")
        assert fit.dropped_views == (other.name,)
        assert other.name not in fit.residual_px
        assert np.abs(z_scores(fit.lens, PINHOLE, fit.covariance)).max() < SIGMAS

    def test_views_left_out_are_predicted_by_the_others_alone(self, rng) -> None:
        """Of six views the first and the last are left out together, from a fit of four."""
        views = pinhole_views(rng, PINHOLE, 6)
        found = fit_camera(views, SIZE, "brown").held_out_px
        alone = view_residuals(fit_camera(views[1:5], SIZE, "brown"), [views[0], views[5]])
        for name, expected in alone.items():
            np.testing.assert_allclose(found[name], expected, atol=0.02 * NOISE_PX)


class TestRealFisheye:
    """BabelCalib's "ov plane" reports 0.482 px on its training pictures and 0.475 px on the others."""

    def test_unseen_pictures_are_predicted(self) -> None:
        fit = fit_camera(ov_plane_views("train"), (1280, 800), "kannala-brandt")
        test = view_residuals(fit, ov_plane_views("test"))
        lengths = np.linalg.norm(np.concatenate([*test.values()]), axis=1)
        print(
            f"train {rms(fit.residual_px):.3f} px, held out {rms(fit.held_out_px):.3f}, test "
            f"{rms(test):.3f}, median {np.median(lengths):.3f}, {len(fit.dropped)} dropped"
        )
        assert rms(test) <= 0.50
        assert np.median(lengths) <= 0.33
        assert len(fit.dropped) < 0.01 * sum(map(len, fit.residual_px.values()))


class TestBetterKind:
    def test_another_kind_is_suggested_only_if_it_predicts_better(self, rng) -> None:
        views = fisheye_views(rng, FISHEYE, 14)[:8]  # within 50 degrees, where both kinds converge
        wrong = fit_camera(views, SIZE, "brown")
        better = better_fit(wrong, views)
        assert better is not None
        assert better.lens.kind == "kannala-brandt"
        assert rms(better.held_out_px) < 0.5 * rms(wrong.held_out_px)
        assert better_fit(better, views) is None

    def test_too_few_views_to_leave_any_out_suggest_nothing(self, rng) -> None:
        views = fisheye_views(rng, FISHEYE, 10)[:5]
        assert better_fit(fit_camera(views, SIZE, "brown"), views) is None


class TestFocals:
    @pytest.mark.parametrize("focal", [200.0, 1500.0])
    def test_any_fisheye_focal_is_found(self, rng, focal: float) -> None:
        lens = replace(FISHEYE, focal=np.full(2, focal), distortion=np.zeros(4))
        views = [v for v in fisheye_views(rng, lens, 40) if len(v.points) > 20]
        views[0].pixels[:] = np.clip(views[0].pixels, 0, np.array(SIZE) - 1)
        fit = fit_camera(views[1:], SIZE, "kannala-brandt")
        assert abs(fit.lens.focal[0] - focal) < SIGMAS * fit.sigma["fx"]

    @pytest.mark.parametrize("focal", [600.0, 6000.0])
    def test_any_pinhole_focal_is_found(self, rng, focal: float) -> None:
        lens = replace(PINHOLE, focal=np.full(2, focal), distortion=np.zeros(5))
        views = [
            seen(
                rng,
                f"{i}",
                looking_at(0.1, i, rng.normal(0, 0.5, 3), focal / 600 * 0.2),
                lens,
            )
            for i in range(15)
        ]
        fit = fit_camera([v for v in views if len(v.points) > 20], SIZE, "brown")
        assert abs(fit.lens.focal[0] - focal) < SIGMAS * fit.sigma["fx"]


class TestRefusals:
    def test_too_few_views(self, rng) -> None:
        with pytest.raises(NotEnoughData, match=r"only 2 of the board; at least 3 .* tilted"):
            fit_camera(pinhole_views(rng, PINHOLE, 2), SIZE, "brown")

    @pytest.mark.parametrize("lens", [FISHEYE, PINHOLE], ids=["fisheye", "brown"])
    def test_parallel_boards(self, rng, lens: Lens) -> None:
        tilt = rotation_matrix([0.3, 0.1, 0.0])
        places = itertools.product((-0.05, 0.05), (-0.04, 0.04), (0.3, 0.5))
        views = [
            seen(rng, str(i), Pose(tilt, np.array(place) - tilt @ MIDDLE), lens)
            for i, place in enumerate(places)
        ]
        with pytest.raises(NotEnoughData, match=r"parallel within .* leaves the focal length open"):
            fit_camera(views, SIZE, lens.kind)

    def test_slightly_tilted_boards(self, rng) -> None:
        far = [looking_at(0.05, i, 0.06 * rng.normal(size=3), 3.0) for i in range(5)]
        views = [seen(rng, str(i), pose, PINHOLE) for i, pose in enumerate(far)]
        with pytest.raises(NotEnoughData, match="focal length"):
            fit_camera(views, SIZE, "brown")

    def test_corners_along_a_line(self, rng) -> None:
        views = pinhole_views(rng, PINHOLE, 4)
        views[2] = BoardView("thin.png", BOARD[:13], views[2].pixels[:13])
        with pytest.raises(NotEnoughData, match=r"thin\.png: 13 corners do not determine"):
            fit_camera(views, SIZE, "brown")

    def test_names_and_places(self, rng) -> None:
        views = pinhole_views(rng, PINHOLE, 4)
        with pytest.raises(InputError, match="have the same name"):
            fit_camera([*views, views[0]], SIZE, "brown")
        with pytest.raises(
            InputError, match=r"00\.png: some corners .* outside the picture of 640x480"
        ):
            fit_camera(views, (640, 480), "brown")
