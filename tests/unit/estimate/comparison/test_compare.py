"""The verdict on two calibrations of one rig, for constructed differences."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome
from tolerances import SIGMAS

from procam.errors import NotEnoughData
from procam.estimate.comparison.common_pixels import CommonPixels
from procam.estimate.comparison.compare import compare_calibrations
from procam.estimate.comparison.verdict import judge_difference
from procam.estimate.geometry.pixel_directions import fit_pixel_directions
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.maths.geometry.lenses import Lens, unproject
from procam.maths.geometry.pose import Pose, rotation_matrix
from procam.maths.geometry.sphere import intersect_sphere, normalise
from procam.model.calibration import Calibration, ProjectorCalibration
from procam.model.photometry import ResponseCurve
from procam.model.transport import Measured

Steps = Callable[[str, np.ndarray], np.ndarray]
ARCMIN = np.radians(1 / 60)
FOUR = {"south": 0.0, "west": 1.5, "north": 3.1, "east": 4.8}  # azimuths [rad]
SIGMA = 0.2 * np.sqrt(2)  # of the fixture's differences [arcmin]


@pytest.fixture(scope="module")
def rig(make_calibration: Callable[..., Calibration]) -> Calibration:
    """Four projectors: the fixture's first one at four azimuths."""
    calibration = make_calibration()
    south = calibration.projectors["south"]
    projectors = {n: _turned(south, rotation_matrix([0, 0, a])) for n, a in FOUR.items()}
    return replace(calibration, projectors=projectors)


def _turned(projector: ProjectorCalibration, turn: np.ndarray) -> ProjectorCalibration:
    pose = projector.model.projector_from_dome
    model = replace(
        projector.model, projector_from_dome=Pose(pose.rotation @ turn.T, pose.translation)
    )
    direction = projector.surface.direction @ turn.T
    surface = replace(projector.surface, direction=direction.astype(np.float32))
    return replace(projector, model=model, surface=surface)


def _responding(
    calibration: Calibration, response: Callable[..., np.ndarray], sigma: float = 1e-3
) -> Calibration:
    """The calibration with another response of its last projector."""
    name, projector = list(calibration.projectors.items())[-1]
    old = projector.photometry.response
    values = np.broadcast_to(response(old.levels[:, None], old.values), old.values.shape)
    curve = ResponseCurve(old.levels, values, np.full_like(values, sigma))
    photometry = replace(projector.photometry, response=curve)
    projectors = {**calibration.projectors, name: replace(projector, photometry=photometry)}
    return replace(calibration, projectors=projectors)


def _bent(calibration: Calibration, steps: Steps) -> Calibration:
    """The calibration with `steps(name, direction)` added to its directions."""
    projectors = {}
    for name, projector in calibration.projectors.items():
        exact = projector.surface.direction.astype(float)
        direction = normalise(exact + steps(name, exact)).astype(np.float32)
        surface = replace(projector.surface, direction=direction)
        projectors[name] = replace(projector, surface=surface)
    return replace(calibration, projectors=projectors)


def _turned_rig(calibration: Calibration, vector: np.ndarray) -> Calibration:
    turn = rotation_matrix(vector)
    return _bent(calibration, lambda _, direction: direction @ turn.T - direction)


def _moved(calibration: Calibration, name: str, turn: np.ndarray, shift_m: float) -> Calibration:
    """A projector rotated and shifted, with the directions that follow."""
    projector = calibration.projectors[name]
    pose = projector.model.projector_from_dome
    rotation = rotation_matrix(turn) @ pose.rotation
    place = pose.origin + shift_m * np.array([0.5, -0.6, 0.3])
    width, height = projector.model.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    rays = unproject(pixels, projector.model.lens) @ rotation
    direction = normalise(intersect_sphere(place, rays, calibration.screen.radius_m))
    surface = replace(projector.surface, direction=direction.astype(np.float32))
    return _with(calibration, {name: replace(projector, surface=surface)})


def _with(calibration: Calibration, projectors: Mapping[str, ProjectorCalibration]) -> Calibration:
    return replace(calibration, projectors={**calibration.projectors, **projectors})


def _lens_error(arcmin: float, azimuth: float) -> Steps:
    """An outward error with the cube of the angle off an axis inclined towards `azimuth`."""
    axis = np.array([0.4 * np.cos(azimuth), 0.4 * np.sin(azimuth), np.sqrt(1 - 0.16)])

    def steps(_: str, direction: np.ndarray) -> np.ndarray:
        along = direction @ axis
        outwards = direction * along[..., None] - axis
        angle = np.arccos(np.clip(along, -1, 1))[..., None]
        return arcmin * ARCMIN * angle**3 * outwards / np.maximum(np.sin(angle), 1e-9)

    return steps


def _waves(direction: np.ndarray, phase: float) -> np.ndarray:
    """A field that neither a lens nor a motion causes, about 3 arcmin."""
    across = normalise(np.cross(direction, [0.3, 0.2, 1.0]))
    wave = np.sin(25 * direction @ np.array([0.6, -0.5, 0.4]) + phase)
    return 4 * ARCMIN * wave[..., None] * across


class TestVerdict:
    def test_the_same_twice(self, rig: Calibration) -> None:
        found = compare_calibrations(rig, rig)
        assert found.verdict.kind == "agree" and found.verdict.sound
        assert "the same to the last bit" in found.verdict.text
        together = found.together
        assert together.as_is.max == together.areas.rms == together.areas.sum == 0
        assert together.as_is.error_over_sigma == 0
        assert together.pixels == sum(p.surface.valid.sum() for p in rig.projectors.values())

    def test_a_turn_of_the_rig_is_gauge(self, rig: Calibration) -> None:
        turn = np.array([1.0, -2.0, 12.0]) * ARCMIN
        found = compare_calibrations(_turned_rig(rig, turn), rig)
        assert found.verdict.kind == "turned" and found.verdict.sound
        np.testing.assert_allclose(found.turn_arcmin, turn / ARCMIN, atol=1e-3)
        assert found.together.as_is.rms > 5
        assert found.together.turned.max < 1e-3
        assert "by 12.2 arcmin" in found.verdict.text
        assert found.verdict.text.endswith("set anew, or nothing fixes the rig in space")

    def test_one_projector_moved_and_the_rig_rotated(self, rig: Calibration) -> None:
        other = _moved(rig, "west", np.array([2e-3, -1e-3, 1e-3]), 0.01)
        found = compare_calibrations(rig, _turned_rig(other, np.array([0.0, 0.0, 0.01])))
        assert (found.verdict.kind, found.verdict.projectors) == ("moved", ("west",))
        assert found.projectors["west"].turned.rms > 5
        assert max(found.projectors[n].turned.max for n in FOUR if n != "west") < 0.01
        assert "projector west moved: west by" in found.verdict.text

    def test_one_of_two_moved_where_fiducials_fix_the_rig(self, calibration: Calibration) -> None:
        found = compare_calibrations(
            calibration, _moved(calibration, "north", np.full(3, 1e-3), 0.005)
        )
        assert (found.verdict.kind, found.verdict.projectors) == ("moved", ("north",))

    def test_two_moved_against_each_other(self, calibration: Calibration) -> None:
        other = _moved(calibration, "north", np.full(3, 1e-3), 0.005)
        found = compare_calibrations(calibration, _turned_rig(other, np.array([0.0, 0.0, 0.01])))
        assert found.verdict.projectors == ("south", "north")
        assert "each on its own" in found.verdict.text

    def test_a_change_that_is_not_a_motion(self, rig: Calibration) -> None:
        def steps(name: str, direction: np.ndarray) -> np.ndarray:
            return _waves(direction, 0.0) * (name == "east")

        found = compare_calibrations(rig, _bent(rig, steps))
        assert (found.verdict.kind, found.verdict.projectors) == ("changed", ("east",))
        assert "zoom" in found.verdict.text

    def test_an_unexplained_difference(self, rig: Calibration) -> None:
        found = compare_calibrations(
            rig, _bent(rig, lambda n, direction: _waves(direction, FOUR[n]))
        )
        assert found.verdict.kind == "differ"

    @pytest.mark.parametrize("names", [tuple(FOUR), ("south", "north")])
    def test_a_wrong_lens_in_a_camera_turned_by_90_degrees(
        self, rig: Calibration, names: tuple[str, ...], rng: np.random.Generator
    ) -> None:
        true = replace(rig, projectors={n: rig.projectors[n] for n in names})
        a, b = (_bent(true, _lens_error(5.0, azimuth)) for azimuth in (0.0, np.pi / 2))
        found = compare_calibrations(a, _noisy(b, rng, np.sqrt(2)))
        assert found.verdict.kind == "lens"
        assert "camera zenith" in found.verdict.text
        assert found.together.smooth_arcmin > 2
        assert found.together.rest_arcmin == pytest.approx(SIGMA, rel=0.1)

    def test_with_several_cameras_all_are_named(self, rig: Calibration) -> None:
        zenith = rig.cameras["zenith"]
        bent = _bent(rig, _lens_error(5.0, 1.0))
        other = replace(bent, cameras={"phone": zenith}, main_camera="phone")
        assert "a camera (zenith, phone)" in compare_calibrations(rig, other).verdict.text

    def test_with_one_projector_its_own_lens_is_named_too(self, rig: Calibration) -> None:
        alone = replace(rig, projectors={"south": rig.projectors["south"]})
        found = compare_calibrations(alone, _bent(alone, _lens_error(20.0, 1.0)))
        assert found.verdict.kind == "lens"
        assert "or the projector's zoom" in found.verdict.text


class TestExchanged:
    def test_all_in_a_ring_and_the_rig_rotated(self, rig: Calibration) -> None:
        """Nearly a rotation by 90 degrees; the smaller rotation is taken."""
        ring = dict(zip(FOUR, [rig.projectors[n] for n in (*list(FOUR)[1:], "south")], strict=True))
        found = compare_calibrations(rig, _turned_rig(_with(rig, ring), np.array([0.0, 0.0, 0.3])))
        assert "A's west is B's south" in found.verdict.text

    def test_two_that_face_each_other(self, calibration: Calibration) -> None:
        names = ("south", "north")
        swapped = dict(zip(names, [calibration.projectors[n] for n in names[::-1]], strict=True))
        verdict = compare_calibrations(calibration, _with(calibration, swapped)).verdict
        assert verdict.text == (
            "A's south is B's north, A's north is B's south: wrong projector on the wire"
        )

    def test_two_side_by_side_that_moved_are_not_exchanged(self, calibration: Calibration) -> None:
        """Each comes nearer to the other's old place than to its own, but to neither: 8 for 12 degrees."""
        south, degree = calibration.projectors["south"], np.radians(1.0)

        def at(*degrees: float) -> Calibration:
            names = zip(calibration.projectors, degrees, strict=True)
            each = {n: _turned(south, rotation_matrix([0, 0, a * degree])) for n, a in names}
            return replace(calibration, projectors=each)

        assert compare_calibrations(at(0, 20), at(12, 8)).verdict.kind != "exchanged"
        assert compare_calibrations(at(0, 20), at(20, 0)).verdict.kind == "exchanged"


class TestNumbers:
    def test_noise_of_the_stated_sigma_gives_a_ratio_of_1(
        self, rig: Calibration, rng: np.random.Generator
    ) -> None:
        found = compare_calibrations(_noisy(rig, rng), _noisy(rig, rng))
        assert found.verdict.text == "the calibrations agree within their error bars"
        for row in (found.together, *found.projectors.values()):
            # two components per pixel: the mean square is known to 1 / sqrt(pixels)
            for angles in (row.as_is, row.turned):
                assert abs(angles.error_over_sigma**2 - 1) < SIGMAS / np.sqrt(row.pixels)
            assert row.as_is.rms == pytest.approx(SIGMA * row.as_is.error_over_sigma, rel=1e-3)
            assert row.as_is.median == pytest.approx(SIGMA * np.sqrt(np.log(2)), rel=0.1)
            assert row.as_is.median < row.as_is.rms < row.as_is.p95 < row.as_is.max
            assert row.smooth_arcmin < 0.25 * row.rest_arcmin

    def test_areas(self, calibration: Calibration) -> None:
        north = calibration.projectors["north"]
        surface, grown = north.surface, north.surface.solid_angle_sr * np.float32(1.01)
        grown[::2] *= np.float32(1.02)
        valid = surface.valid & (np.cumsum(surface.valid).reshape(surface.valid.shape) > 10)
        other = replace(north, surface=replace(surface, solid_angle_sr=grown, valid=valid))
        found = compare_calibrations(calibration, _with(calibration, {"north": other}))
        row, still = found.projectors["north"].areas, found.projectors["south"].areas
        assert (still.median, still.rms, still.sum, still.alone) == (0, 0, 0, 0)
        assert row.alone == pytest.approx(10 / surface.valid.sum())
        ratio = (grown / surface.solid_angle_sr)[valid].astype(float) - 1
        assert row.rms == pytest.approx(np.sqrt(np.mean(ratio**2)), rel=1e-4)
        assert 0.01 < row.sum < 0.0302 and 0.0099 < row.median < 0.0303

    def test_pixels_with_a_corner_off_the_screen_are_left_out(
        self, calibration: Calibration
    ) -> None:
        north = calibration.projectors["north"]
        solid, sigma = north.surface.solid_angle_sr.copy(), north.surface.sigma_arcmin.copy()
        row, column = np.argwhere(north.surface.valid)[0]
        solid[row, column], sigma[row, column + 1] = np.nan, np.nan
        torn = replace(north.surface, solid_angle_sr=solid, sigma_arcmin=sigma)
        found = compare_calibrations(
            calibration, _with(calibration, {"north": replace(north, surface=torn)})
        )
        assert found.projectors["north"].pixels == north.surface.valid.sum() - 2
        assert found.verdict.kind == "agree" and found.together.areas.rms == 0

    def test_light(self, calibration: Calibration) -> None:
        m = calibration.feedback
        step = np.array([0, 0, 4 * np.hypot(0.004, 0.003)])
        brighter = Measured(m.value + step, np.full(3, 0.003))
        found = compare_calibrations(calibration, replace(calibration, feedback=brighter))
        np.testing.assert_allclose(found.light["feedback"].sigmas, [0, 0, 4], atol=1e-9)
        assert found.light["albedo"].sigmas == [0, 0, 0]
        assert found.verdict.sound
        assert found.screen == {"radius_m": (6.0, 6.0), "degree": (0, 0)}

    @pytest.mark.parametrize("times", [2.0, 0.5])
    def test_light_that_differs_by_more_than_its_errors(
        self, calibration: Calibration, times: float
    ) -> None:
        m = calibration.feedback
        other = replace(calibration, feedback=Measured(m.value * times, m.sigma))
        verdict = compare_calibrations(calibration, other).verdict
        assert (verdict.kind, verdict.sound) == ("light", False)
        most = np.abs(m.value * (times - 1) / m.sigma).max() / np.sqrt(2)
        assert f"feedback by {most:.3g} standard errors" in verdict.text
        assert "albedo" not in verdict.text and "the same to the last bit" in verdict.text

    def test_a_response_that_differs_is_named(self, calibration: Calibration) -> None:
        """By an input that takes full range for limited: its clipped ends."""
        other = _responding(calibration, lambda d, _: np.clip((255 * d - 16) / 219, 0, 1) ** 2.2)
        found = compare_calibrations(calibration, other)
        assert (found.verdict.kind, found.verdict.sound) == ("light", False)
        (name,) = found.verdict.projectors
        assert f"projector {name}: its light at drive" in found.verdict.text
        assert "Directions: the directions are the same" in found.verdict.text
        assert found.responses[name].size == pytest.approx(0.165, abs=0.02)

    def test_a_response_counts_beside_directions(self, calibration: Calibration) -> None:
        other = _responding(calibration, lambda d, _: d**2.6)
        moved = _bent(other, lambda _, d: 0.05 * np.cross([0, 0, 1.0], d) * (d[..., :1] > 0))
        verdict = compare_calibrations(calibration, moved).verdict
        assert not verdict.sound and ". Also, responses differ, projector" in verdict.text

    def test_a_response_within_its_errors(self, calibration: Calibration) -> None:
        near = _responding(calibration, lambda d, old: old + 0.07 * d * (1 - d))
        unsure = _responding(calibration, lambda d, old: old + 0.2 * d * (1 - d), sigma=0.02)
        for other in (near, unsure):
            assert compare_calibrations(calibration, other).verdict.sound

    def test_light_that_one_calibration_lacks(self, calibration: Calibration) -> None:
        dark = replace(calibration, albedo=Measured(np.full(3, np.nan), np.full(3, np.nan)))
        assert list(compare_calibrations(calibration, dark).light) == ["feedback"]

    def test_light_without_sigma(self, calibration: Calibration) -> None:
        exact = [
            replace(calibration, feedback=Measured(np.full(3, m), np.zeros(3))) for m in (1, 2)
        ]
        assert compare_calibrations(exact[0], exact[0]).light["feedback"].sigmas == [0, 0, 0]
        assert compare_calibrations(*exact).light["feedback"].sigmas == [np.inf] * 3

    def test_a_projector_that_is_not_seen_in_both(self, calibration: Calibration) -> None:
        north = calibration.projectors["north"]
        dark = replace(north.surface, valid=np.zeros_like(north.surface.valid))
        with pytest.raises(
            NotEnoughData, match="projector north: the calibrations share 0 of its pixels"
        ):
            compare_calibrations(
                calibration, _with(calibration, {"north": replace(north, surface=dark)})
            )

    def test_projectors_of_other_sizes_are_not_exchanged(self, rig: Calibration) -> None:
        """Exchanges are sought only between projectors of one size."""
        wide = rig.projectors["west"]
        model = replace(wide.model, size=(50, 30))
        grown = {
            name: np.pad(
                getattr(wide.surface, name), ((0, 0), (0, 2), (0, 0))[: 3 - (name != "direction")]
            )
            for name in ("direction", "solid_angle_sr", "valid", "measured", "sigma_arcmin")
        }
        other = replace(wide, model=model, surface=replace(wide.surface, **grown))
        odd = _with(rig, {"west": other})
        swapped = {"north": odd.projectors["east"], "east": odd.projectors["north"]}
        assert set(compare_calibrations(odd, _with(odd, swapped)).verdict.projectors) == {
            "north",
            "east",
        }


class TestSolvedRigs:
    """A dome solved twice with the same wrong lens, the camera rotated by 90 degrees in between."""

    @pytest.mark.parametrize(
        ("focal", "k1", "kind"),
        [
            (1.0, 0.0, "agree"),
            (1.0005, 0.0, "lens"),  # focal lengths that differ by 0.05 %
            (1.0, 0.002, "agree"),  # symmetric about the axis: only a tilt would show it
        ],
    )
    def test_a_turned_camera_shows_its_lens(self, focal: float, k1: float, kind: str) -> None:
        def wrong(lens: Lens) -> Lens:
            bend = lens.distortion + np.array([k1, 0, 0, 0])
            return replace(lens, focal=lens.focal * [focal, 1.0], distortion=bend)

        dome = SimulatedDome.build(2, projectors=2, cameras=1)
        a, b = (_solved(dome, turn, wrong) for turn in (0.0, np.pi / 2))
        pairs = {name: _common_pixels(a, b, name) for name in a.projectors}
        assert judge_difference(pairs, ["zenith"])[0].kind == kind


def _solved(dome: SimulatedDome, turn: float, wrong: Callable[[Lens], Lens]) -> GeometrySolution:
    camera = dome.cameras[0]
    pose = camera.camera_from_dome
    rotation = rotation_matrix([0, 0, turn]) @ pose.rotation
    turned = replace(camera, camera_from_dome=Pose(rotation, -rotation @ pose.origin))
    there = replace(dome, cameras=[turned])
    problem = there.problem(there.observations(48, 0.05), fiducials=there.fiducials(1e-4))
    cameras = {n: replace(c, lens=wrong(c.lens)) for n, c in problem.cameras.items()}
    return solve_geometry(replace(problem, cameras=cameras))


def _common_pixels(a: GeometrySolution, b: GeometrySolution, name: str) -> CommonPixels:
    """The upper half of a panel, which lights the dome, in two solved rigs."""
    x, y = np.arange(20.0, 1920, 40), np.arange(20.0, 800, 40)
    fitted = [fit_pixel_directions(solution, name) for solution in (a, b)]
    first, second = (each.directions(x, y).reshape(-1, 3) for each in fitted)
    sigma = [each.sigma_arcmin(x, y).ravel() * ARCMIN for each in fitted]
    place = a.projectors[name].projector_from_dome.origin / a.rig.shape.radius_m
    ones = np.ones(len(first), np.float32)
    variance = (sigma[0] ** 2 + sigma[1] ** 2).astype(np.float32)
    return CommonPixels(
        first.astype(np.float32), second.astype(np.float32), variance, ones, ones, 0.0, place
    )


def _noisy(calibration: Calibration, rng: np.random.Generator, times: float = 1.0) -> Calibration:
    """Directions with noise of their own standard error."""

    def steps(name: str, direction: np.ndarray) -> np.ndarray:
        sigma = calibration.projectors[name].surface.sigma_arcmin * ARCMIN * times
        return rng.normal(0, 1, direction.shape) * (sigma / np.sqrt(2))[..., None]

    return _bent(calibration, steps)
