"""warp_frame against its reference implementation, and both against places where the answer is known."""

from collections.abc import Callable

import numpy as np
import pytest

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels.warp import reference as reference_warp
from procam.kernels.warp.reference import KNOTS, PLACE, WarpPlan
from procam.maths.light.curves import srgb_decode, srgb_encode
from procam.maths.warp import sample

MASTERS = [np.uint8, np.uint16, np.float16, np.float32]
FRAMES = [np.uint8, np.uint16, np.float32]
LIGHT = 1e-4  # between levels: rounding of places of 1e-5 px, on noise
CODES = srgb_decode(np.arange(256) / 255)
RESPONSE = np.repeat(srgb_encode(KNOTS)[:, None], 3, axis=1) ** np.array([1.0, 0.9, 1.1])
MIX = np.array([[0.95, 0.03, 0.02], [0.02, 0.96, 0.02], [0.01, 0.04, 0.95]])


def _places(shape: tuple[int, int], master: tuple[int, int]) -> np.ndarray:
    """A panel turned by half a radian, its corners beyond the master."""
    y, x = np.mgrid[: shape[0], : shape[1]] - (np.array(shape)[:, None, None] - 1) / 2
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    middle = (np.array(master[::-1]) - 1) / 2
    return np.stack([x, y], axis=-1) @ turn.T * (1.1 * max(master) / max(shape)) + middle


def _plan(rng, shape: tuple[int, int], master: tuple[int, int], **more) -> WarpPlan:
    place = _places(shape, master)
    place[shape[0] // 2, : shape[1] // 3] = np.nan
    share = np.minimum(1, np.linspace(0, 3, shape[1]))[:, None] * rng.uniform(0.7, 1, 3)
    return kernels.plan_warp(
        place,
        rng.uniform(0, 0.004, (*shape, 3)),
        np.broadcast_to(share, (*shape, 3)),
        np.linalg.inv(MIX),
        **{"drives": RESPONSE, "decode": CODES, "thresholds": rng.uniform(0, 1, (64, 64))} | more,
    )


def _master(rng, shape: tuple[int, int], kind: type) -> np.ndarray:
    light = rng.uniform(0, 1, (*shape, 3))
    if np.issubdtype(kind, np.integer):
        return np.rint(light * np.iinfo(kind).max).astype(kind)
    return (light * 1.3 - 0.1).astype(kind)


def _expected(master: np.ndarray, plan: WarpPlan, kind: type = np.float32) -> np.ndarray:
    with kernels.forced("numpy"):
        return kernels.warp_frame(master, plan, dtype=kind)


def _check_dither(frame: np.ndarray, light: np.ndarray, plan: WarpPlan, slack: float) -> None:
    """floor(255 drive + threshold) for some light within `slack` of the reference."""
    least, most = (
        255 * reference_warp.drive(np.clip(light + s, 0, 1), plan) for s in (-slack, slack)
    )
    tile = np.tile(plan.thresholds, [-(-n // 64) for n in plan.shape])
    tile = tile[: plan.shape[0], : plan.shape[1], None]
    assert (frame >= np.floor(least + tile - 0.02)).all()
    assert (frame <= np.floor(most + tile + 0.02)).all()


@pytest.mark.parametrize(
    ("shape", "edge", "kind"),
    [
        *(((1, 1), (41, 67), MASTERS[0]), ((3, 130), (2, 2), MASTERS[1])),
        *(((33, 17), (41, 67), MASTERS[2]), ((64, 64), (41, 67), MASTERS[3])),
        *(((40, 203), (2, 2), MASTERS[0]), ((40, 203), (41, 67), MASTERS[1])),
        *(((1, 1), (2, 2), MASTERS[2]), ((3, 130), (2, 2), MASTERS[3])),
        *(((70, 90), (400, 500), kind) for kind in MASTERS),  # pixels of a strip lie far apart
    ],
)
def test_light_equals_the_reference(level: str, shape, edge, kind: type, rng) -> None:
    plan, master = _plan(rng, shape, edge), _master(rng, edge, kind)
    found = kernels.warp_frame(master, plan, dtype=np.float32)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, _expected(master, plan), atol=LIGHT)


@pytest.mark.parametrize("kind", MASTERS)
def test_drives_equal_the_reference(level: str, kind: type, rng) -> None:
    plan, master = _plan(rng, (50, 203), (90, 70)), _master(rng, (90, 70), kind)
    light = _expected(master, plan)
    whole = kernels.warp_frame(master, plan, dtype=np.uint16)
    least, most = (
        65535 * reference_warp.drive(np.clip(light + s, 0, 1), plan) for s in (-LIGHT, LIGHT)
    )
    assert whole.dtype == np.uint16
    assert (whole >= least - 1.5).all() and (whole <= most + 1.5).all()
    _check_dither(kernels.warp_frame(master, plan), light, plan, LIGHT)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_16_bit_drives_are_rounded(level: str, share: float, rng) -> None:
    """On average over levels nothing is lost; cut off, it would be half a step."""
    plan, master = _plan(rng, (50, 203), (90, 70)), np.full((90, 70, 3), share, np.float32)
    light = kernels.warp_frame(master, plan, dtype=np.float32)
    exact = 65535 * reference_warp.drive(light, plan)
    found = kernels.warp_frame(master, plan, dtype=np.uint16)
    inner = (light > 0.01) & (light < 1)
    assert inner.sum() > 5000
    assert abs(np.mean(found[inner] - exact[inner])) < 0.1


def test_masters_of_any_layout(level: str, odd_layout: Callable, rng) -> None:
    kind = np.uint8
    plan = _plan(rng, (20, 70), (31, 45))
    master = odd_layout(_master(rng, (31, 45), np.float32))
    plain = kernels.warp_frame(np.ascontiguousarray(master), plan, dtype=kind)
    np.testing.assert_array_equal(kernels.warp_frame(master, plan, dtype=kind), plain)


@pytest.mark.parametrize(("kind", "start"), [*zip(FRAMES, (4, 0, 4), strict=True), (np.uint8, 0)])
def test_writes_to_the_array_given(level: str, kind: type, start: int, rng) -> None:
    plan, master = _plan(rng, (35, 128), (40, 40)), _master(rng, (40, 40), np.uint8)
    size = 35 * 128 * 3
    room = np.full(size + 2 * start, 7, kind)
    out = room[start : start + size].reshape(35, 128, 3)
    assert kernels.warp_frame(master, plan, out) is out
    np.testing.assert_array_equal(out, kernels.warp_frame(master, plan, dtype=kind))
    assert (np.delete(room, slice(start, start + size)) == 7).all()


def test_threads_change_nothing(level: str, rng) -> None:
    plan, master = _plan(rng, (150, 99), (80, 80)), _master(rng, (80, 80), np.uint8)
    frames = []
    for threads in (1, 2):
        with kernels.forced(level, threads):
            frames.append(kernels.warp_frame(master, plan))
    np.testing.assert_array_equal(*frames)


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("unknown", [np.nan, -np.inf])
def test_unknown_light_is_none(level: str, kind: type, unknown: float, rng) -> None:
    place = np.stack(np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5), axis=-1)
    some = np.ones((8, 8, 3))
    mixed = 0.1 + 0.7 * np.eye(3)  # no zero that would make NaN of what is infinite
    plan = kernels.plan_warp(place, 0 * some, some, mixed)
    master = np.full((9, 9, 3), 0.5, kind)
    master[4, 6] = unknown
    found = kernels.warp_frame(master, plan, dtype=np.float32)
    touched = np.zeros((8, 8), bool)
    touched[3:5, 5:7] = True
    np.testing.assert_array_equal(found.max(axis=-1) == 0, touched)
    np.testing.assert_allclose(found[~touched], 0.5, atol=1e-6)


@pytest.mark.parametrize("kind", FRAMES)
def test_unknown_numbers_are_dark(level: str, kind: type, rng) -> None:
    place, one = _places((20, 40), (30, 30)), np.ones((20, 40, 3))
    black, share = 0.001 * one, one.copy()
    place[3, 4, 1], black[5, 6, 2], share[7, 8, 0] = np.nan, np.inf, np.nan
    plan = kernels.plan_warp(place, black, share, np.eye(3), drives=RESPONSE)
    found = kernels.warp_frame(np.full((30, 30, 3), 255, np.uint8), plan, dtype=kind)
    for row, column in ((3, 4), (5, 6), (7, 8)):
        assert not found[row, column].any()
        assert found[row, column + 1].all()


@pytest.mark.parametrize("kind", MASTERS)
def test_outside_the_master_there_is_nothing(level: str, kind: type, rng) -> None:
    """Bilinear with a border of 0, as OpenCV has it; far places too."""
    master = _master(rng, (12, 15), kind)
    place = rng.uniform(-3, 18, (16, 64, 2)).round(1)
    place[0, :4] = [[1e9, 3], [-1e9, 3], [3, 1e9], [3, -1e9]]
    plan = kernels.plan_warp(place, np.zeros((16, 64, 3)), np.ones((16, 64, 3)), np.eye(3),
                             decode=CODES)  # fmt: skip
    exact = reference_warp.unpacked(plan, 0)[..., PLACE].astype(float)
    expected = sample(reference_warp.decoded(master, plan), np.clip(exact, -1e4, 1e4))
    found = kernels.warp_frame(master, plan, dtype=np.float32)
    np.testing.assert_allclose(found[1:], np.clip(expected, 0, 1)[1:], atol=2e-4)
    assert not found[0, :4].any()


def test_black_is_0_and_white_is_255_whatever_the_threshold(level: str) -> None:
    place, one = np.zeros((64, 64, 2)), np.ones((64, 64, 3))
    tile = np.linspace(0, np.nextafter(np.float32(1), np.float32(0)), 64 * 64).reshape(64, 64)
    plan = kernels.plan_warp(place, 0 * one, 2 * one, np.eye(3), drives=RESPONSE, thresholds=tile)
    for value, code in ((0, 0), (255, 255)):
        frame = kernels.warp_frame(np.full((2, 2, 3), value, np.uint8), plan)
        assert (frame == code).all()


def test_dither_keeps_the_mean(level: str) -> None:
    place, one = np.zeros((64, 64, 2)), np.ones((64, 64, 3))
    tile = np.linspace(0, 1, 64 * 64, endpoint=False).reshape(64, 64)
    straight = np.repeat(KNOTS[:, None], 3, axis=1)
    plan = kernels.plan_warp(place, 0 * one, one, np.eye(3), drives=straight, thresholds=tile)
    for light in (0.0013, 0.1, 0.75):
        frame = kernels.warp_frame(np.full((2, 2, 3), light, np.float32), plan)
        assert frame.mean() / 255 == pytest.approx(light, abs=1e-5)


def test_numbers_are_kept_to_a_hundred_thousandth_of_their_range(rng) -> None:
    place, black, share = (rng.uniform(0, 9, (37, 70, n)) for n in (2, 3, 3))
    plan = kernels.plan_warp(place, black, share, np.eye(3))
    kept = np.concatenate([reference_warp.unpacked(plan, band) for band in range(2)])
    np.testing.assert_allclose(
        kept, np.concatenate([place, black, share], -1), atol=9 / 131070 + 1e-6
    )


def test_knots_are_where_c_looks_them_up(level: str) -> None:
    """Light at and half way between knots comes back from a table of the light itself."""
    light = np.concatenate([KNOTS, (KNOTS[1:] + KNOTS[:-1]) / 2]).astype(np.float32)
    place = np.stack([np.arange(light.size), np.zeros(light.size)], axis=-1)[None]
    straight = np.repeat(KNOTS[:, None], 3, axis=1)
    one = np.ones((1, light.size, 3))
    plan = kernels.plan_warp(place, 0 * one, one, np.eye(3), drives=straight)
    master = np.broadcast_to(light[:, None], (2, light.size, 3))
    found = kernels.warp_frame(master, plan, dtype=np.uint16)[0]
    np.testing.assert_allclose(found, 65535 * master[0].astype(float), atol=1.01)


GRID, ONE = np.zeros((4, 5, 2)), np.ones((4, 5, 3))


@pytest.mark.parametrize(
    ("more", "error", "text"),
    [
        ({"place": np.zeros((4, 5, 3))}, ShapeError, r"place has shape \(4, 5, 3\)"),
        ({"black": np.zeros((4, 6, 3))}, ShapeError, r"black has shape \(4, 6, 3\)"),
        ({"share": np.zeros((4, 5))}, ShapeError, r"share has shape \(4, 5\)"),
        ({"share": -ONE}, InputError, "share: the least is -1; none"),
        ({"unmix": np.eye(4)}, ShapeError, r"unmix has shape \(4, 4\)"),
        ({"unmix": np.full((3, 3), np.nan)}, InputError, "unmix: some values are not finite"),
        ({"decode": np.zeros(255)}, ShapeError, r"decode has shape \(255,\)"),
        ({"drives": np.zeros((512, 3))}, ShapeError, r"drives has shape \(512, 3\)"),
        ({"drives": RESPONSE[::-1]}, InputError, "drives: .* must rise"),
        ({"drives": 2 * RESPONSE}, InputError, "drives: 0 to 2; .* within 0..1"),
        (
            {"thresholds": np.full((64, 64), 1.1)},
            InputError,
            "thresholds: 1.1 to 1.1; they must be",
        ),
        ({"thresholds": np.zeros((8, 8))}, ShapeError, r"thresholds has shape \(8, 8\)"),
    ],
)
def test_plans_that_do_not_fit_are_refused(more: dict, error: type, text: str) -> None:
    given = {"place": GRID, "black": 0 * ONE, "share": ONE, "unmix": np.eye(3)} | more
    with pytest.raises(error, match=text):
        kernels.plan_warp(**given)


@pytest.mark.parametrize(
    ("master", "out", "error", "text"),
    [
        (np.zeros((4, 4, 3)), None, InputError, "master: float64 is not supported; convert it to uint8"),
        (np.zeros((4, 4), "u1"), None, ShapeError, r"master has shape \(4, 4\)"),
        (np.zeros((1, 4, 3), "u1"), None, ShapeError, "N and M 2 or more"),
        (np.zeros((4, 4, 3), "u1"), np.zeros((4, 5, 3)), InputError, "frame: float64 is not supported"),
        (np.zeros((4, 4, 3), "u1"), np.zeros((5, 4, 3), "f4"), ShapeError, r"out has shape"),
        (np.zeros((4, 4, 3), "u1"), np.zeros((4, 5, 3), "u1"), InputError, "this one has none"),
        (np.zeros((4, 4, 3), "u1"), np.zeros((4, 5, 6), "f4")[..., ::2], InputError, "contiguous"),
        (np.broadcast_to(np.uint8(0), (1 << 15, 1 << 15, 3)), None, ShapeError, "at most"),
        (np.broadcast_to(np.uint8(0), (2, 1 << 25, 3)), None, ShapeError, "edges of at most"),
    ],
)  # fmt: skip
def test_frames_that_do_not_fit_are_refused(master, out, error: type, text: str) -> None:
    plan = kernels.plan_warp(GRID, 0 * ONE, ONE, np.eye(3))
    with pytest.raises(error, match=text):
        kernels.warp_frame(master, plan, out, dtype=np.float32)
