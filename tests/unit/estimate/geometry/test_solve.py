"""Rigs solved from simulated observations: exact without noise, correct sigmas, no start values."""

from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome, step_between

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.geometry.adjustment import SQUARE
from procam.estimate.geometry.diagnosis import pixel_aspect
from procam.estimate.geometry.fiducial_checks import missing_fiducials
from procam.estimate.geometry.model import Observations, ParameterLayout
from procam.estimate.geometry.solve import (
    MAX_SPHERE_RATIO,
    solve_geometry,
    square_panels,
)
from procam.estimate.geometry.start import ProjectorPrior
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import normalise
from procam.model.optics import Distance
from simulators.observations import lit_points
from simulators.presets import REALISTIC


class TestSphere:
    @pytest.mark.parametrize("cameras", [1, 2])
    def test_exact_observations_give_the_exact_rig(self, cameras: int) -> None:
        dome = SimulatedDome.build(1, projectors=2, cameras=cameras)
        found = solve_geometry(
            dome.problem(dome.observations(48, 0.0), fiducials=dome.fiducials(off=0))
        )
        step = step_between(found.rig, dome.rig())
        layout = ParameterLayout.of(found.rig)
        for block in (*layout.cameras.values(), *layout.projectors.values()):
            assert np.abs(step[block][:6]).max() < 1e-6  # rad, m
        assert (found.sphere_systematic_ratio, found.rig.shape.degree, len(found.freedoms)) == (
            1.0,
            0,
            0,
        )

    def test_errors_agree_with_the_covariance(self) -> None:
        """Mahalanobis distance of all parameters over several domes; fiducials have errors too."""
        total, count = 0.0, 0
        for seed in range(8):
            dome = SimulatedDome.build(seed, projectors=2)
            fiducials = dome.fiducials(1e-4)
            found = solve_geometry(dome.problem(dome.observations(48), fiducials=fiducials))
            free = np.diag(found.covariance) > 0
            step = step_between(found.rig, dome.rig())[free]
            root = np.sqrt(np.diag(found.covariance)[free])
            scaled = found.covariance[np.ix_(free, free)] / np.outer(root, root)
            total += float((step / root) @ np.linalg.solve(scaled, step / root))
            count += int(free.sum())
        assert abs(total - count) < 4 * np.sqrt(2 * count)

    @pytest.mark.parametrize("seed", range(8))
    def test_every_rig_is_found_without_start_values(self, seed: int) -> None:
        dome = SimulatedDome.build(100 + seed, projectors=4)
        found = solve_geometry(dome.problem(dome.observations(64)))
        assert max(found.scale.values()) < MAX_SPHERE_RATIO
        errors, _ = dome.direction_errors(found)
        assert np.sqrt(np.mean(errors**2)) < 0.3
        assert errors.max() < 1.0


class TestSquarePixels:
    def test_weakly_seen_panels_have_square_pixels(self) -> None:
        dome = SimulatedDome.build(4, projectors=2, cameras=1)
        found = solve_geometry(dome.problem(dome.observations(24, 0.3)))
        for name in found.rig.projectors:
            ratio, sigma = pixel_aspect(found.rig, found.covariance, name)
            assert abs(ratio - 1) < 3 * SQUARE and 0 < sigma < 1.01 * SQUARE

    def test_a_stretched_picture_contradicts_that(self) -> None:
        dome = SimulatedDome.build(4, projectors=2, cameras=1)
        seen = dome.observations(24)
        for pair in [pair for pair in seen if pair[1] == "north"]:
            wide = seen[pair].projector_px * [1.004, 1.0]
            seen[pair] = Observations(seen[pair].camera_px, wide, seen[pair].sigma_px)
        found = solve_geometry(dome.problem(seen))
        stretched, sigma = pixel_aspect(found.rig, found.covariance, "north")
        assert abs(stretched - 1.004) < 3 * sigma and sigma < 1e-3
        assert max(found.scale.values()) < MAX_SPHERE_RATIO

    def test_what_all_panels_share_is_hardly_seen_and_their_differences_are(self) -> None:
        """Errors of 0.1 % in common, and of 1e-5 of each panel."""
        rig = SimulatedDome.build(4, projectors=3, cameras=1).rig()
        layout = ParameterLayout.of(rig)
        common, covariance = np.zeros(layout.count), np.zeros((layout.count, layout.count))
        for name, projector in rig.projectors.items():
            first, focal = layout.projectors[name].start + 6, projector.lens.focal[0]
            common[first] = 1e-3 * focal
            covariance[first, first] = (1e-5 * focal) ** 2
        covariance += np.outer(common, common)

        def square(**stretched: float) -> set[str]:
            projectors = dict(rig.projectors)
            for name, ratio in stretched.items():
                lens = projectors[name].lens
                wide = replace(lens, focal=lens.focal[0] * np.array([ratio, 1.0]))
                projectors[name] = replace(projectors[name], lens=wide)
            return set(square_panels(replace(rig, projectors=projectors), covariance))

        names = set(rig.projectors)
        assert square(**dict.fromkeys(names, 1.001)) == names
        assert square(north=1.0005) == names - {"north"}
        assert square(**dict.fromkeys(names, 1.01)) == set()


class TestNotASphere:
    def test_a_real_dome(self) -> None:
        dome = SimulatedDome.build(5, REALISTIC)
        found = solve_geometry(dome.problem(dome.observations(16)))
        errors, sigmas = dome.direction_errors(found)
        assert found.sphere_systematic_ratio > 5 and found.rig.shape.degree >= 6
        assert np.sqrt(np.mean(errors**2)) < 1.0
        assert np.mean((errors / sigmas) ** 2) < 1.3

    def test_one_camera_reduces_the_error_and_states_the_rest(self) -> None:
        """Projectors and one camera see the shape too, but less well than two cameras."""
        dome = SimulatedDome.build(0, REALISTIC, projectors=3, cameras=1)
        problem = dome.problem(dome.observations(48), fiducials=dome.fiducials(3e-4))
        found, sphere = (solve_geometry(replace(problem, most_degree=most)) for most in (8, 0))
        assert found.rig.shape.degree >= 6 and sphere.rig.shape.degree == 0
        assert found.sphere_systematic_ratio > 5
        (errors, sigmas), (before, _) = (dome.direction_errors(x) for x in (found, sphere))
        assert np.mean(errors**2) < 0.25 * np.mean(before**2)
        assert 0.1 < np.mean((errors / sigmas) ** 2) < 2

    def test_a_lens_that_ripples_is_no_bump(self) -> None:
        """One camera cannot tell; bumps would have to explain most of it."""
        dome = SimulatedDome.build(4, projectors=3, cameras=1)
        lens = dome.rig().cameras["zenith"].lens
        seen = {}
        for pair, some in dome.observations(48, 0.02).items():
            away = some.camera_px - lens.centre
            radius = np.linalg.norm(away, axis=1, keepdims=True)
            ripple = 0.3 * np.sin(2 * np.pi * radius / radius.max()) * away / radius
            seen[pair] = replace(some, camera_px=some.camera_px + ripple)
        found = solve_geometry(dome.problem(seen, fiducials=dome.fiducials(3e-4), most_degree=8))
        assert found.sphere_systematic_ratio > MAX_SPHERE_RATIO
        assert found.rig.shape.degree == 0


class TestGauge:
    """Nothing, the radius, one fiducial, two: 4, 3, 1, 0 gauge freedoms (docs/theory/geometry.md)."""

    @pytest.mark.parametrize(
        ("cameras", "radius_known", "fiducials", "expected"),
        [
            (1, False, 0, 4),
            (2, False, 0, 4),
            (2, True, 0, 3),
            (1, True, 1, 1),
            (2, True, 2, 0),
            (1, False, 2, 1),
        ],
    )
    def test_rank(self, cameras: int, radius_known: bool, fiducials: int, expected: int) -> None:
        dome = SimulatedDome.build(2, projectors=2, cameras=cameras)
        problem = dome.problem(
            dome.observations(48),
            fiducials=dome.fiducials(count=fiducials),
            radius_known=radius_known,
        )
        found = solve_geometry(problem)
        assert len(found.freedoms) == found.gauge_freedoms == expected
        assert bool(missing_fiducials(radius_known, problem.fiducials, expected)) == (expected > 0)

    def test_a_distance_gives_the_size(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        first, second = (c.camera_from_dome.origin for c in dome.cameras)
        metres = float(np.linalg.norm(first - second))
        found = solve_geometry(
            dome.problem(
                dome.observations(48),
                shape=RoundShape(5.0),
                radius_known=False,
                distances=[Distance("zenith", "second", metres, 1e-3)],
            )
        )
        assert len(found.freedoms) == 0
        assert found.rig.shape.radius_m == pytest.approx(8.0, abs=0.01)

    def test_a_springline_and_a_front(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        front, left, right = dome.fiducials()
        marks = [
            replace(front, elevation=None),
            replace(left, azimuth=None),
            replace(right, azimuth=None),
        ]
        found = solve_geometry(dome.problem(dome.observations(48), fiducials=marks))
        errors, _ = dome.direction_errors(found)
        assert len(found.freedoms) == 0
        assert errors.max() < 0.3

    def test_a_fiducial_that_a_projector_shows(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        marks = dome.fiducials(count=1)
        build = dome.projectors[1]
        pixel = np.array([900.0, 300.0])
        place = normalise(lit_points(dome.surface, build, pixel[None]))[0]
        shone = replace(
            marks[0],
            name="cross",
            azimuth=float(np.arctan2(place[1], place[0])),
            elevation=float(np.arcsin(place[2])),
            device=build.name,
            pixel=pixel,
        )
        found = solve_geometry(dome.problem(dome.observations(48), fiducials=[*marks, shone]))
        errors, _ = dome.direction_errors(found)
        assert len(found.freedoms) == 0
        assert errors.max() < 0.3

    def test_the_fiducial_that_contradicts_the_others_is_named(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        front, left, right = dome.fiducials()
        wrong = replace(left, elevation=left.elevation + np.radians(3))
        with pytest.raises(
            CalibrationError, match=r"fiducials: left does not fit the others, off by"
        ):
            solve_geometry(dome.problem(dome.observations(48), fiducials=[front, wrong, right]))
        with pytest.raises(CalibrationError, match=r"fiducials: front, left do not fit together"):
            solve_geometry(dome.problem(dome.observations(48), fiducials=[front, wrong]))


class TestLenses:
    @pytest.mark.parametrize("mode", ["prior", "solve"])
    def test_intrinsics_are_solved_on_the_dome(self, mode: str) -> None:
        dome = SimulatedDome.build(4)
        problem = dome.problem(dome.observations(64))
        cameras = {}
        for name, camera in problem.cameras.items():
            lens = camera.lens
            off = Lens(
                lens.kind,
                lens.focal * 1.002,
                lens.centre + np.array([1.5, -1.0]),
                lens.distortion + np.array([0.002, 0, 0, 0]),
            )
            cameras[name] = replace(camera, lens=off)
        trusted = solve_geometry(replace(problem, cameras=cameras, most_degree=0))
        intrinsics = dict.fromkeys(cameras, mode)
        solved = solve_geometry(replace(problem, cameras=cameras, intrinsics=intrinsics))
        before, after = (dome.direction_errors(s)[0] for s in (trusted, solved))
        assert np.sqrt(np.mean(before**2)) > 3.0
        assert np.sqrt(np.mean(after**2)) < 0.5
        assert len(solved.freedoms) == 0

    def test_a_moving_entrance_pupil(self) -> None:
        dome = SimulatedDome.build(6)
        dome = replace(dome, cameras=[replace(c, pupil=(0.02, 0.0)) for c in dome.cameras])
        intrinsics = {c.name: "prior" for c in dome.cameras}
        fixed = solve_geometry(dome.problem(dome.observations(64), most_degree=0))
        found = solve_geometry(dome.problem(dome.observations(64), intrinsics=intrinsics))
        before, after = (np.sqrt(np.mean(dome.direction_errors(s)[0] ** 2)) for s in (fixed, found))
        assert after < 0.3 < before
        for camera in found.rig.cameras.values():
            assert camera.pupil[0] == pytest.approx(0.02, abs=0.004)

    def test_a_fisheye_projector(self) -> None:
        dome = SimulatedDome.build(7, projectors=2)
        lens = Lens(
            "kannala-brandt",
            np.full(2, 400.0),
            np.array([963.0, 590.0]),
            np.array([0.01, -0.002, 0, 0]),
        )
        dome = replace(dome, projectors=[replace(p, lens=lens) for p in dome.projectors])
        priors = {p.name: ProjectorPrior(p.name, p.size, "kannala-brandt") for p in dome.projectors}
        found = solve_geometry(dome.problem(dome.observations(32), projectors=priors))
        errors, _ = dome.direction_errors(found)
        assert np.sqrt(np.mean(errors**2)) < 0.3


class TestBadInput:
    def test_too_few_correspondences(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        seen = dome.observations(48)
        pairs = {p: o if p[1] == "south" else o.some(slice(0, 9)) for p, o in seen.items()}
        with pytest.raises(
            NotEnoughData, match=r"projector north: no camera with a pose sees 40 or more"
        ):
            solve_geometry(dome.problem(pairs))

    def test_a_mirrored_picture_is_named(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        seen = dome.observations(48)
        for pair, some in seen.items():
            if pair[1] == "north":
                flipped = some.projector_px * [-1, 1] + [1919, 0]
                seen[pair] = Observations(some.camera_px, flipped, some.sigma_px)
        with pytest.raises(CalibrationError, match="projector north: its picture arrives mirrored"):
            solve_geometry(dome.problem(seen))

    def test_cameras_that_share_nothing(self) -> None:
        dome = SimulatedDome.build(2, projectors=2)
        seen = dome.observations(48)
        apart = {p: o for p, o in seen.items() if p in (("zenith", "south"), ("second", "north"))}
        with pytest.raises(
            NotEnoughData, match=r"camera \w+: it shares 0 patches .* Turn it so that"
        ):
            solve_geometry(dome.problem(apart))
