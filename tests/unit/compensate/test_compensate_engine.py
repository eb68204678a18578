"""The engine's promises: optimum, certificate, types of picture, strength, white."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import cycle, pairwise
from typing import Any

import numpy as np
import pytest
from furnished_domes import furnished
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from procam import kernels
from procam.compensate.compensator import METHODS, Compensator
from procam.compensate.equations import FrameEquations, Solution
from procam.compensate.solved_frame import DARKEST, SolvedFrame, certificate
from procam.compensate.solver import BLACK
from procam.errors import DidNotConverge, InputError, ShapeError
from procam.kernels.frame.coding import Coding
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.transfer import transfer
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.model.transport import Measured
from procam.model.venue_state import VenueState

SMALL = 20
SIZE = 96
WHOLE = {np.uint8: 255, np.uint16: 65535}
TYPES = [np.uint8, np.uint16, np.float16, np.float32]


def harmonics(place: np.ndarray, degree: int) -> np.ndarray:
    """Made orthonormal over the upper half sphere, by their closed forms: (P, terms)."""
    one = np.ones(len(place))
    each = (one, 2 * np.sqrt(3) * (place[:, 2] - 0.5), *(np.sqrt(3) * place[:, :2].T))
    return np.column_stack(each)[:, : (degree + 1) ** 2]


def scatter(
    calibration: Calibration, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Factors U, V (P, K) of one colour's scattered light U V^T b, where it is lit; solid angles; where."""
    maps, direction = calibration.maps, master_directions(size)[0]
    lit = maps.coverage > 0
    area = (master_solid_angles(size) * maps.coverage)[lit]
    ortho = harmonics(direction[lit], maps.kernel.degree)
    paint = maps.scatter_per_flux[lit][:, 0] / (ortho @ maps.kernel.profile[0])
    return paint[:, None] * (ortho @ maps.kernel.matrix[0]), ortho * area[:, None], area, lit


def operator(calibration: Calibration, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """N (P, P) of one colour, pixel by pixel, where it is lit; their solid angles; which they are."""
    back, gathered, area, lit = scatter(calibration, size)
    return np.eye(len(area)) + back @ gathered.T, area, lit


@pytest.fixture(params=[False, True], ids=["one scalar", "degree 1"])
def known(
    request: pytest.FixtureRequest, make_calibration: Callable[..., Calibration]
) -> Calibration:
    found = make_calibration(size=SMALL, feedback=(0.5, 0.4, 0.3), lo=0.01)
    return furnished(found) if request.param else found


@pytest.fixture(scope="session")
def small(make_calibration: Callable[..., Calibration]) -> Calibration:
    return furnished(make_calibration(size=SMALL, feedback=(0.5, 0.4, 0.3), lo=0.01))


@pytest.fixture
def content(rng: np.random.Generator) -> np.ndarray:
    picture = rng.uniform(0.05, 1.0, (SMALL, SMALL, 3)).astype(np.float32)
    picture[3:9, 5:11] = 0.0
    picture[12:16, 5:11] = 2.0
    return picture


class TestOptimum:
    def test_least_squares_is_that_of_a_solver_of_its_own(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        """(W), weighed by solid angle, of each pixel against scipy's bounded least squares."""
        whole, area, lit = operator(known, SMALL)
        lo, hi = known.maps.lo[lit][:, 0].astype(float), known.maps.hi[lit][:, 0].astype(float)
        root = np.sqrt(area)
        wanted = np.minimum(content[lit][:, 0], whole @ hi)  # what a place can show at full drive
        best = lsq_linear(root[:, None] * whole, root * wanted, (lo, hi), "bvls", tol=1e-14)
        compensator = Compensator(known, SMALL, "least-squares")
        with kernels.forced("numpy"):  # in double precision
            solved = compensator.solve(content)
            terms = compensator.fields.model.terms
            found = np.clip(_wanted(compensator, solved, content, terms)[lit], lo, hi)
            certificate = solved.certificate
        np.testing.assert_allclose(found, best.x, atol=1e-7)
        assert certificate.kkt < 1e-8
        assert 0 < certificate.share_lo[0] < 1
        assert 0 < certificate.share_hi[0] < 1

    @pytest.mark.parametrize("kind", [np.float16, np.float32])
    @pytest.mark.parametrize("name", ["linear", "srgb"])
    def test_a_sun_counts_as_the_brightest_that_can_be_shown(
        self, known: Calibration, content: np.ndarray, kind: type, name: str
    ) -> None:
        """(W) left with a sun of 1e5, or of infinity once encoded, would light the whole dome."""
        compensator = Compensator(known, SMALL, "least-squares", transfer_name=name)
        encode = transfer(name).encode
        bright, dim = (encode(0.2 * content).astype(kind) for _ in range(2))
        bright[6:9, 6:9], dim[6:9, 6:9] = 6e4, encode(compensator.fields.full_white[6:9, 6:9])
        np.testing.assert_allclose(compensator.frame(bright), compensator.frame(dim), atol=2e-3)

    def test_exact_is_the_fixed_point_pixel_by_pixel(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        whole, _, lit = operator(known, SMALL)
        found = Compensator(known, SMALL).predict(content)
        direct = found.direct[lit][:, 0].astype(float)
        seen = whole @ direct
        free = found.free[lit][:, 0]
        assert 0.3 < free.mean() < 1
        np.testing.assert_allclose(seen[free], content[lit][:, 0][free], atol=1e-6)

    def test_exact_is_the_fixed_point_of_pictures_larger_than_a_sample(
        self, make_calibration: Callable[..., Calibration], rng: np.random.Generator
    ) -> None:
        size = 160
        known = furnished(make_calibration(size=size, feedback=(0.5, 0.4, 0.3), lo=0.01))
        content = (2 * rng.random((size, size, 3)) ** 3).astype(np.float32)
        back, gathered, _, lit = scatter(known, size)
        found = Compensator(known, size).predict(content)
        direct = found.direct[lit][:, 0].astype(float)
        free = found.free[lit][:, 0]
        assert 0.3 < free.mean() < 1
        seen = direct + back @ (gathered.T @ direct)
        np.testing.assert_allclose(seen[free], content[lit][:, 0][free], atol=1e-6)

    def test_subtract_takes_off_what_would_bounce_without_limits(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        whole, _, lit = operator(known, SMALL)
        maps = known.maps
        without = np.linalg.solve(whole, content[lit][:, 0].astype(float))
        expected = np.clip(without, maps.lo[lit][:, 0], maps.hi[lit][:, 0])
        found = Compensator(known, SMALL, "subtract").predict(content)
        np.testing.assert_allclose(found.direct[lit][:, 0], expected, atol=1e-6)
        assert np.isnan(found.solved.certificate.kkt)
        assert found.solved.certificate.self_consistency > 1e-3  # limits were not counted

    @pytest.mark.parametrize("method", ["exact", "least-squares"])
    def test_slope_is_that_of_the_residual_where_limits_hold(
        self, known: Calibration, content: np.ndarray, method: str
    ) -> None:
        compensator = Compensator(known, SMALL, method)
        equations, given, coding, solution = _certified(compensator.solve(content))
        assert equations._root is not None
        value = equations._root.value
        slope = equations._slope(solution, given, coding)
        for i in range(value.shape[1]):
            step = np.zeros_like(value)
            step[:, i] = 1e-4
            above, below = (
                equations.residual(given, coding, equations._solution(value + turn))
                for turn in (step, -step)
            )
            np.testing.assert_allclose((above - below) / 2e-4, slope[:, :, i], rtol=5e-3, atol=5e-3)

    @settings(max_examples=25, deadline=None)
    @given(seed=st.integers(0, 2**31), bright=st.floats(0.01, 3.0))
    def test_certificates_hold_for_any_content(
        self, small: Calibration, seed: int, bright: float
    ) -> None:
        rng = np.random.default_rng(seed)
        picture = (bright * rng.random((SMALL, SMALL, 3)) ** rng.uniform(0.2, 5)).astype(np.float32)
        for method in ("exact", "least-squares"):
            compensator = Compensator(small, SMALL, method)
            assert compensator.solve(picture).certificate.kkt < 1e-6


def _certified(solved: SolvedFrame) -> tuple[FrameEquations, np.ndarray, Coding, Solution]:
    """The equations of a frame, its content with its coding, and its solution."""
    assert isinstance(solved.certify, partial)
    equations, content, coding, solution, _ = solved.certify.args
    return equations, content, coding, solution


def _wanted(
    compensator: Compensator, solved: SolvedFrame, content: np.ndarray, terms: int
) -> np.ndarray:
    """Light before limits (N, N) of the first colour, from the solution's numbers alone."""
    found = solved.coefficients, _certified(solved)[3].pull
    direction = np.moveaxis(master_directions(SMALL)[0], -1, 0)
    mono = np.stack([np.ones((SMALL, SMALL)), *direction])[:terms]
    scatter, pull = (np.tensordot(n[0, :terms], mono, 1) for n in found)
    paint = compensator.fields.model.spread[..., 0].astype(float)
    return content[..., 0] - paint * scatter + pull


class TestCertificate:
    def test_shares_and_fluxes(self, calibration: Calibration) -> None:
        picture = np.full((SIZE, SIZE, 3), 0.5, np.float32)
        picture[: SIZE // 2] = 0
        compensator = Compensator(calibration, SIZE)
        found = compensator.predict(picture)
        certificate = found.solved.certificate
        area = master_solid_angles(SIZE) * calibration.maps.coverage
        np.testing.assert_allclose(certificate.flux_in, np.tensordot(area, picture, 2), rtol=1e-5)
        np.testing.assert_allclose(certificate.flux_out, found.flux, rtol=1e-6)
        dark = (area * (found.direct[..., 0] <= calibration.maps.lo[..., 0])).sum() / area.sum()
        np.testing.assert_allclose(certificate.share_lo[0], dark, rtol=1e-5)
        assert not certificate.share_hi.any()
        assert certificate.kkt < 1e-6 and certificate.self_consistency < 1e-6

    @pytest.mark.parametrize("method", ["exact", "least-squares"])
    def test_moments_that_are_wrong_show(self, calibration: Calibration, method: str) -> None:
        """If e more light is assumed than is sent, e (1 + m) of it is missing where no limit holds."""
        compensator = Compensator(calibration, SIZE, method)
        solved = compensator.solve(np.full((SIZE, SIZE, 3), 0.6, np.float32))
        equations, content, coding, right = _certified(solved)
        error = 0.01
        assumed = (1 + error) * right.moments
        wrong = replace(
            right,
            moments=assumed,
            coefficients=compensator.fields.coefficients_of(assumed),
        )
        sent = right.moments[:, 0] - error * calibration.feedback.value * right.moments[:, 0]
        expected = (assumed[:, 0] - sent).max() / sent.max()
        found = certificate(equations, content, coding, wrong, None)
        assert found.self_consistency == pytest.approx(expected, rel=0.1)
        assert found.kkt >= found.self_consistency > 0.01


def test_codes_and_sizes_that_make_no_sense_are_refused(calibration: Calibration) -> None:
    compensator = Compensator(calibration, SIZE)
    with pytest.raises(InputError, match="uint8 is encoded; predict takes linear light"):
        compensator.predict(np.full((SIZE, SIZE, 3), 76, np.uint8))
    for size in (0, -5):
        with pytest.raises(InputError, match=f"size: {size} px is too small"):
            Compensator(calibration, size)
    with pytest.raises(InputError, match="list is no picture"):
        compensator.frame([[0.0]])


class TestPictures:
    @pytest.mark.parametrize("kind", TYPES)
    def test_any_type_is_the_same_light(self, calibration: Calibration, kind: type) -> None:
        """Each against float32, as decoded; encoded values lie within their own rounding."""
        rng, whole = np.random.default_rng(4), WHOLE.get(kind)
        content = rng.uniform(0.2, 0.9, (SIZE, SIZE, 3))
        content = (content * (whole or 1)).astype(kind)
        known = transfer("srgb" if whole else "linear")
        linear = np.asarray(known.decode(content.astype(np.float32) / np.float32(whole or 1)))
        expected = Compensator(calibration, SIZE).frame(linear.astype(np.float32))
        found = Compensator(calibration, SIZE).frame(content)
        assert found.dtype == kind
        encoded = np.asarray(known.encode(np.clip(expected, 0, 1 if whole else None)))
        step = {np.uint8: 1.05, np.uint16: 0.7, np.float16: 2**-11, np.float32: 1e-6}[kind]
        np.testing.assert_allclose(found, encoded * (whole or 1), atol=step)

    def test_dither_keeps_the_mean_of_dark_steps(self, calibration: Calibration) -> None:
        """A slow ramp of the dark comes out with its slope, not in steps."""
        content = np.full((SIZE, SIZE, 3), 70, np.uint8)
        found = Compensator(calibration, SIZE).frame(content)
        expected = Compensator(calibration, SIZE).frame(
            np.full((SIZE, SIZE, 3), transfer("srgb").decode(np.array(70 / 255)), np.float32)
        )
        exact = 255 * np.asarray(transfer("srgb").encode(expected))
        part = slice(32, 64)
        off = found[part, part].astype(float) - exact[part, part]
        assert abs(off.mean()) < 0.02 and np.abs(off).max() < 1

    def test_in_place(self, calibration: Calibration) -> None:
        content = np.random.default_rng(5).integers(0, 256, (SIZE, SIZE, 3), dtype=np.uint8)
        expected = Compensator(calibration, SIZE).frame(content)
        compensator = Compensator(calibration, SIZE)
        solved = compensator.solve(content, content)
        assert solved.sent is content
        np.testing.assert_array_equal(content, expected)
        with pytest.raises(InputError, match="the frame was written over its content"):
            _ = solved.certificate

    @pytest.mark.parametrize("kind", [np.uint8, np.float32])
    def test_the_last_evaluation_writes_the_picture(
        self, calibration: Calibration, kind: type, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Pans and cuts: the last evaluation writes, or the frame is written again."""
        compensator, other = (Compensator(furnished(calibration), SIZE) for _ in range(2))
        written_late, apply = [], FrameEquations.apply
        monkeypatch.setattr(
            FrameEquations, "apply", lambda *given: written_late.append(given[0]) or apply(*given)
        )
        rng = np.random.default_rng(7)
        scenes = [rng.integers(0, most, (SIZE, SIZE, 3)) for most in (256, 60, 200)]
        frames = [np.roll(scene, k, 1).astype(np.uint8) for scene in scenes for k in range(4)]
        for codes in frames:
            frame = codes if kind is np.uint8 else (codes / np.float32(255)).astype(kind)
            found = compensator.solve(frame)
            np.testing.assert_array_equal(found.sent, other.apply(frame, found.coefficients))
            assert found.certificate.kkt < (2e-5 if kind is np.uint8 else 1e-7)
        assert sum(by is compensator._equations for by in written_late) < len(frames)

    @pytest.mark.parametrize("method", ["exact", "least-squares"])
    @pytest.mark.parametrize("kind", ["grey", "noise", "lines", "stars"])
    def test_the_first_frame_starts_near_its_solution(
        self, calibration: Calibration, method: str, kind: str, rng: np.random.Generator
    ) -> None:
        size = 320
        frame = rng.integers(0, 256, (size, size, 3), np.uint8)
        if kind == "grey":
            frame[:] = 128
        if kind == "lines":
            frame[np.arange(size) % 3 > 0] = 0
        if kind == "stars":
            frame *= rng.random((size, size, 1)) < 0.02
        compensator = Compensator(furnished(calibration), size, method)
        equations, done = compensator._equations, []
        for name in ("residual", "apply"):
            known = getattr(equations, name)
            counted = lambda *given, known=known, name=name: done.append(name) or known(*given)  # noqa: E731
            setattr(equations, name, counted)
        _, _, coding, solved = _certified(compensator.solve(frame))
        start, solution = equations._start(frame, coding).value, solved.unknowns
        assert np.abs(start - solution).max() < 0.3 * np.abs(solution).max()
        most = {"exact": 3, "least-squares": 5}[method]
        assert len(done) <= (2 if (method, kind) == ("exact", "grey") else most)

    def test_what_no_sample_solves_starts_from_no_light(
        self, calibration: Calibration, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
    ) -> None:
        frame = rng.random((200, 200, 3)).astype(np.float32)
        expected = Compensator(calibration, 200).frame(frame)
        solve = FrameEquations.solve

        def fails_for_samples(self: FrameEquations, *given: Any) -> Any:
            if self.model.size < 200:
                raise DidNotConverge("not solved")
            return solve(self, *given)

        monkeypatch.setattr(FrameEquations, "solve", fails_for_samples)
        found = Compensator(calibration, 200).frame(frame)
        np.testing.assert_allclose(found, expected, atol=1e-7)

    @pytest.mark.parametrize(
        ("method", "bad"), [*zip(METHODS, cycle((np.nan, np.inf, -np.inf)), strict=False)]
    )
    def test_what_is_not_finite_is_black(
        self, calibration: Calibration, method: str, bad: float
    ) -> None:
        rng, compensator = np.random.default_rng(8), Compensator(calibration, SIZE, method)
        frame = rng.random((SIZE, SIZE, 3)).astype(np.float32)
        holes = rng.random((SIZE, SIZE)) < 0.01
        broken, dark = np.copy(frame), np.copy(frame)
        broken[holes], dark[holes] = bad, 0
        expected = Compensator(calibration, SIZE, method).frame(dark)
        np.testing.assert_allclose(compensator.frame(broken), expected, atol=1e-7)
        if method == "perceptual-video":  # the frames before count
            return
        after = Compensator(calibration, SIZE, method).frame(frame)
        np.testing.assert_allclose(compensator.frame(frame), after, atol=1e-6)

    @pytest.mark.parametrize("method", METHODS)
    def test_black_frames(self, calibration: Calibration, method: str) -> None:
        maps = calibration.maps
        black = replace(calibration, maps=replace(maps, lo=np.zeros_like(maps.lo)))
        compensator = Compensator(black, SIZE, method)
        compensator.frame(np.full((SIZE, SIZE, 3), 0.5, np.float32))
        solved = compensator.solve(np.zeros((SIZE, SIZE, 3), np.float32))
        assert 0 <= solved.sent.min() and solved.sent.max() < 1e-10
        assert solved.certificate.self_consistency <= BLACK / DARKEST


class TestStrength:
    @pytest.mark.parametrize("kind", TYPES)
    def test_from_the_content_to_the_full_result(
        self, calibration: Calibration, kind: type
    ) -> None:
        rng, whole = np.random.default_rng(7), WHOLE.get(kind)
        content = (rng.uniform(0, 1, (SIZE, SIZE, 3)) * (whole or 1)).astype(kind)

        def at(strength: float) -> np.ndarray:
            return Compensator(calibration, SIZE, strength=strength).frame(content).astype(float)

        steps = [at(s) for s in (0.0, 0.25, 0.5, 0.75, 1.0)]
        np.testing.assert_array_equal(steps[0], content.astype(float))
        np.testing.assert_array_equal(steps[-1], Compensator(calibration, SIZE).frame(content))
        turn = np.sign(steps[-1] - steps[0])
        for before, after in pairwise(steps):
            assert ((after - before) * turn >= 0).all()

    @pytest.mark.parametrize("strength", [-0.1, 1.1, np.nan])
    def test_outside_0_to_1(self, calibration: Calibration, strength: float) -> None:
        with pytest.raises(InputError, match=r"strength: .* is outside 0"):
            Compensator(calibration, SIZE, strength=strength)


class TestWhite:
    def test_kept_white_is_the_total_of_todays(self, calibration: Calibration) -> None:
        """Content 1.0 is the total light of a full white as it is today."""
        full = np.ones((SIZE, SIZE, 3), np.float32)
        today = Compensator(calibration, SIZE, "none").predict(full)
        area = (master_solid_angles(SIZE) * calibration.maps.coverage)[..., None]
        totals = (area * today.observed).sum(axis=(0, 1)) / area.sum()
        kept = Compensator(calibration, SIZE, white="keep")
        lit = calibration.maps.coverage > 0
        np.testing.assert_allclose(kept.target(full)[lit], totals.min(), rtol=1e-5)

    def test_an_unknown_white(self, calibration: Calibration) -> None:
        with pytest.raises(InputError, match="white: 'bright' is unknown; choose summed or keep"):
            Compensator(calibration, SIZE, white="bright")


class TestProtectedInStates:
    """What is left alone goes out as it came, whatever white, lamps and matched white do elsewhere."""

    @pytest.mark.parametrize("case", ["state", "keep", "falloff", "all"])
    def test_light_that_arrives_is_counted(self, calibration: Calibration, case: str) -> None:
        maps = calibration.maps
        covered = np.zeros((SIZE, SIZE), bool)
        covered[25:60, 40:70] = True
        fall = np.broadcast_to(np.linspace(0.7, 1, SIZE, dtype=np.float32), (SIZE, SIZE)).copy()
        falloff = fall if case in ("falloff", "all") else None
        maps = replace(maps, protected=Mask("screen", covered), falloff=falloff)
        lamps = np.full((SIZE, SIZE, 3), 0.05, np.float32)
        with_audience = VenueState(
            "full", Measured(np.full(3, 0.3), np.full(3, 0.01)), np.ones(3), lamps
        )
        known = replace(calibration, maps=maps, states={"full": with_audience})
        state = "full" if case in ("state", "all") else None
        white = "keep" if case in ("keep", "all") else "summed"
        compensator = Compensator(known, SIZE, state=state, white=white)
        content = np.random.default_rng(8).uniform(0.45, 0.7, (SIZE, SIZE, 3)).astype(np.float32)
        found = compensator.predict(content)
        area = (master_solid_angles(SIZE) * maps.coverage)[..., None]
        sent = np.where(covered[..., None], np.clip(content, maps.lo, maps.hi), found.direct)
        flux = (area * sent.astype(float)).sum(axis=(0, 1))
        np.testing.assert_allclose(found.solved.certificate.flux_out, flux, rtol=1e-6)
        np.testing.assert_allclose(found.flux, flux, rtol=1e-6)
        ambient = 0 if state is None else lamps
        seen = sent + maps.scatter_per_flux * flux + ambient
        lit = maps.coverage > 0
        np.testing.assert_allclose(found.observed[lit], seen[lit], atol=2e-6)
        target = compensator.target(content)
        assert 0.3 < found.free[lit].mean()
        np.testing.assert_allclose(seen[found.free], target[found.free], atol=2e-6)
        np.testing.assert_array_equal(target[covered & lit], content[covered & lit])

    def test_no_outline_where_content_is_finer_than_maps(self, calibration: Calibration) -> None:
        covered = np.zeros((SIZE, SIZE), bool)
        covered[30:60, 40:60] = True
        maps = replace(calibration.maps, protected=Mask("screen", covered))
        compensator = Compensator(replace(calibration, maps=maps), 2 * SIZE)
        content = np.full((2 * SIZE, 2 * SIZE, 3), 0.6, np.float32)
        found = compensator.predict(content)
        ring = np.zeros((2 * SIZE, 2 * SIZE), bool)
        ring[56:124, 76:124] = True
        ring &= ~compensator.protected
        np.testing.assert_allclose(found.observed[ring], 0.6, atol=2e-3)
        spread = found.direct[ring].reshape(-1, 3)
        assert (spread.max(axis=0) - spread.min(axis=0) < 0.01).all()  # slow waves of u alone


class TestOut:
    def picture(self) -> np.ndarray:
        return np.full((SIZE, SIZE, 3), 128, np.uint8)

    def test_that_overlaps_the_content(self, calibration: Calibration) -> None:
        room = np.zeros(2 * SIZE * SIZE * 3, np.uint8)
        image = room[: SIZE * SIZE * 3].reshape(SIZE, SIZE, 3)
        out = room[288 : 288 + SIZE * SIZE * 3].reshape(SIZE, SIZE, 3)
        with pytest.raises(InputError, match="out: it overlaps the content"):
            Compensator(calibration, SIZE).frame(image, out)


def test_fields_of_a_wrong_shape(calibration: Calibration) -> None:
    model = Compensator(calibration, SIZE).fields.model
    with pytest.raises(ShapeError, match=r"field lo has shape .*; it needs \(96, 96, 3\)"):
        replace(model, lo=model.lo[..., :1])
