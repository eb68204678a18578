"""Frame kernels against their reference implementation, and that against sums pixel by pixel."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from procam import kernels
from procam.errors import InputError, ShapeError
from procam.kernels.frame.api import MODES, frame_apply, frame_sums, scattered_light
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.grid import Grid
from procam.kernels.frame.model import SPARE, FrameModel, padded, zeros_to_pad
from procam.kernels.native.curve import Curve
from procam.maths.codes.dither import threshold_tile
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.maths.light.transfer import TRANSFER_NAMES, transfer

SIZES = [(64, 64, 1), (97, 64, 4), (270, 257, 9), (35, 33, 9)]
TYPES = [np.uint8, np.uint16, np.float16, np.float32]
WHOLE = {np.uint8: 255, np.uint16: 65535}
CASES = [  # each size with each kind of dome, most with each type
    (*SIZES[i % 4], TYPES[(i + i // 4) % 4], (0, 1, 3)[i % 3], (1.0, 0.4, 0.0, 1.0, 0.4)[i % 5])
    for i in range(12)
]
CLOSE = {np.uint8: 2e-6, np.uint16: 3e-7, np.float16: 3e-7, np.float32: 3e-7}  # of the sum of light
STEP = {np.uint8: 1, np.uint16: 1, np.float16: 2**-10, np.float32: 3e-7}


def model(size: int, nodes: int, terms: int, seed: int = 0) -> FrameModel:
    """0: without gain and upper limits; 1: with both; 3: with limits, which bind in one half."""
    rng = np.random.default_rng(seed)
    direction, inside = master_directions(nodes)
    coverage = (inside & (direction[..., 2] > 0.15) & (direction[..., 1] > -0.8)).astype(np.float32)

    def field(low: float, high: float, *shape: int) -> np.ndarray:
        return rng.uniform(low, high, (nodes, nodes, *shape)).astype(np.float32)

    spread, lo, hi = field(0.02, 0.04, 3), field(0, 0.01, 3), field(0.5, 1.2, 3)
    if seed == 3:
        hi[:, : nodes // 2] = 1.1
    return FrameModel(
        size,
        spread,
        lo,
        hi if seed else None,
        field(0, 0.01, 3) if seed % 3 else None,
        field(0.8, 1) if seed == 1 else None,
        coverage,
        (master_solid_angles(nodes) * (nodes / size) ** 2 * coverage).astype(np.float32),
        np.ascontiguousarray(np.moveaxis(direction, -1, 0), np.float32),
        terms,
    )


def coding(kind: type, strength: float = 1.0, name: str = "srgb") -> Coding:
    known = transfer(name)
    top = 1.0 if kind in WHOLE else np.inf
    return Coding(known.decode, known.encode, threshold_tile(), strength, top)


def picture(size: int, kind: type) -> np.ndarray:
    values = np.random.default_rng(size).random((size, size, 3))
    values[: size // 8] = 0
    return (values * WHOLE.get(kind, 1)).astype(kind)


def numbers() -> np.ndarray:
    found = np.random.default_rng(3).normal(0, 0.3, (3, 9))
    found[:, 0] = 2
    return found


Picture = tuple[FrameModel, np.ndarray, np.ndarray, Coding]  # and its scattered light and coding


def light_with_gain_and_limits(kind: type) -> Picture:
    dome = model(300, 130, 9, 1)
    return dome, picture(300, kind), scattered_light(dome, numbers()), coding(kind)


def light_below_zero(kind: type) -> Picture:
    """It does not lift what is sent."""
    dome = model(300, 256, 4, 3)
    light = scattered_light(dome, numbers())
    light[100:130, 90:180] = -0.3
    return dome, np.full((300, 300, 3), WHOLE.get(kind, 1), kind), light, coding(kind)


def a_hole(kind: type) -> Picture:
    """Below rows where nothing is lit, fields are read anew."""
    dome = model(300, 100, 4)
    lit = np.ones((100, 100), np.float32)
    lit[40:60] = 0
    ramp = np.linspace(0, 0.5, 100, dtype=np.float32)[:, None, None]
    dome = replace(
        dome,
        lo=np.ascontiguousarray(dome.lo + ramp),
        coverage=dome.coverage * lit,
        solid_angle_sr=dome.solid_angle_sr * lit,
    )
    return dome, picture(300, kind), scattered_light(dome, numbers()), coding(kind)


def black_under_lamps(kind: type) -> Picture:
    dome = model(300, 256, 9)
    dome = replace(dome, lo=np.full_like(dome.lo, 1e-4), ambient=np.full_like(dome.lo, 0.7))
    light = scattered_light(dome, 1e-4 * numbers())
    return dome, np.zeros((300, 300, 3), kind), light, coding(kind)


def black_brighter_than_the_top(kind: type) -> Picture:
    dome = model(300, 256, 1, 3)
    dome = replace(dome, lo=dome.lo + 1.5)
    light = scattered_light(dome, numbers())
    return dome, picture(300, kind), light, replace(coding(kind), top=1.0)


def a_low_top(kind: type) -> Picture:
    dome = model(300, 256, 1, 3)
    light = scattered_light(dome, numbers())
    return dome, picture(300, kind), light, replace(coding(kind), top=0.4)


SCENES = [
    light_with_gain_and_limits,
    light_below_zero,
    a_hole,
    black_under_lamps,
    black_brighter_than_the_top,
    a_low_top,
]


def computed(level: str, scene: Picture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is sent, and its sums: those found while writing, and those without writing."""
    dome, content, light, how = scene
    written = np.empty((3, dome.terms))
    with kernels.forced(level):
        sent = frame_apply(dome, content, light, how, None, written).astype(float)
        return sent, written, frame_sums(dome, content, light, "light", how)


class TestAgainstTheReference:
    @pytest.mark.parametrize(("size", "nodes", "terms", "kind", "seed", "strength"), CASES)
    def test_sums(
        self, level: str, size: int, nodes: int, terms: int, kind: type, seed: int, strength: float
    ) -> None:
        dome, content = model(size, nodes, terms, seed), picture(size, kind)
        how = coding(kind, strength)  # which sums do not depend on
        light = scattered_light(dome, numbers(), numbers() / 9)
        for what in MODES:
            found = frame_sums(dome, content, light, what, how)
            with kernels.forced("numpy"):
                expected = frame_sums(dome, content, light, what, how)
                whole = frame_sums(dome, content, light, "light", how)
            one = dome.solid_angle_sr.max() if what.startswith("at") else 0  # a pixel on the limit
            close = CLOSE[kind] * np.abs(whole).max() + 1.01 * one
            np.testing.assert_allclose(found, expected, rtol=0, atol=close)

    @pytest.mark.parametrize(("size", "nodes", "terms", "kind", "seed", "strength"), CASES)
    def test_pictures(
        self, level: str, size: int, nodes: int, terms: int, kind: type, seed: int, strength: float
    ) -> None:
        dome, content = model(size, nodes, terms, seed), picture(size, kind)
        how, light = coding(kind, strength), scattered_light(dome, numbers())
        found = frame_apply(dome, content, light, how).astype(float)
        with kernels.forced("numpy"):
            expected = frame_apply(dome, content, light, how).astype(float)
        off = np.abs(found - expected)
        assert off.max() <= STEP[kind]
        assert (off > 0).mean() < (0.01 if kind is not np.float32 else 1)  # at ties of the rounding

    @pytest.mark.parametrize("kind", TYPES)
    @pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
    def test_scenes(self, level: str, scene: Callable[[type], Picture], kind: type) -> None:
        given = scene(kind)
        sent, written, read = computed(level, given)
        expected, _, sums = computed("numpy", given)
        assert np.abs(sent - expected).max() <= STEP[kind]
        for found in (written, read):
            np.testing.assert_allclose(found, sums, rtol=0, atol=CLOSE[kind] * np.abs(sums).max())
        np.testing.assert_allclose(written, read, rtol=0, atol=2e-8 * np.abs(read).max())

    def test_one_node_whatever_lies_behind_it(self, level: str) -> None:
        one = np.ones((1, 1, 3), np.float32)
        plane, up = one[..., 0], np.array([0, 0, 1], np.float32).reshape(3, 1, 1)
        dome = FrameModel(8, 0 * one, 0 * one, None, None, None, plane, plane, up)
        content, how = np.full((8, 8, 3), 0.5, np.float32), coding(np.float32)
        spoilt = np.full(3 + SPARE, np.nan, np.float32)
        light = scattered_light(dome, numbers(), out=spoilt[:3].reshape(1, 1, 3))
        np.testing.assert_allclose(frame_apply(dome, content, light, how), 0.5)

    def test_light_is_written_nowhere_else(self, level: str) -> None:
        dome, kept = model(64, 20, 1), np.zeros((20, 20, 3), np.float32)
        kept.flags.writeable = False
        wide = np.zeros((20, 40, 3), np.float32)
        for wrong in (kept, wide[:, ::2], np.zeros((19, 20, 3), np.float32), np.zeros((20, 20, 3))):
            with pytest.raises(InputError, match="out"):
                scattered_light(dome, numbers(), out=wrong)
        assert not kept.any()
        assert not wide.any()

    def test_nothing_is_written_where_sums_do_not_fit(self, level: str) -> None:
        dome, content, how = model(64, 20, 9), picture(64, np.uint8), coding(np.uint8)
        light, before = scattered_light(dome, numbers()), content.copy()
        with pytest.raises(ShapeError, match="sums"):
            frame_apply(dome, content, light, how, content, np.zeros((3, 3)))
        np.testing.assert_array_equal(content, before)

    def test_codes_below_zero_are_black(self, level: str) -> None:
        dome, content, how = model(64, 20, 1), picture(64, np.uint8), replace(coding(np.uint8))
        pieces = np.zeros((4, 16), np.float32)
        pieces[0] = -3
        how.__dict__["curve"] = Curve(2.0**-7, pieces)
        light = scattered_light(dome, numbers())
        assert level == "numpy" or not frame_apply(dome, content, light, how).any()

    def test_black_is_code_0(self, level: str) -> None:
        with pytest.raises(InputError, match=r"encode: light 0 is coded as 0\.0627; black must"):
            replace(coding(np.uint8), encode=lambda light: (16 + 219 * light) / 255)

    @pytest.mark.parametrize("kind", TYPES)
    def test_light_below_black(self, level: str, kind: type) -> None:
        dome, content = replace(model(64, 64, 1), ambient=None), np.zeros((64, 64, 3), kind)
        dark = replace(dome, lo=np.full_like(dome.lo, -0.1))
        light, how = scattered_light(dark, numbers()), coding(kind, 0.5)
        assert frame_apply(dark, content, light, how).max() <= 0
        content = (picture(64, kind).astype(float) / 30).astype(kind)
        found = frame_apply(dark, content, light, how).astype(float)
        with kernels.forced("numpy"):
            expected = frame_apply(dark, content, light, how).astype(float)
        assert np.abs(found - expected).max() <= STEP[kind]

    @pytest.mark.parametrize(
        ("kind", "bad", "strength"),
        [
            (np.float16, np.nan, 0.5),
            (np.float16, np.inf, 0.5),
            (np.float16, -np.inf, 0.0),
            (np.float32, -np.inf, 0.5),
        ],
    )
    def test_what_is_not_finite_is_mixed_as_black(
        self, level: str, kind: type, bad: float, strength: float
    ) -> None:
        dome, content = model(64, 64, 1), picture(64, kind)
        broken, dark = content.copy(), content.copy()
        broken[30:34, 30:34], dark[30:34, 30:34] = bad, 0
        light, how = scattered_light(dome, numbers()), coding(kind, strength)
        np.testing.assert_array_equal(
            frame_apply(dome, broken, light, how), frame_apply(dome, dark, light, how)
        )

    @pytest.mark.parametrize(("least", "code"), [(1000.505, 1001), (1000.495, 1000), (7e4, 65535)])
    def test_16_bits_are_rounded_and_end_at_white(
        self, level: str, least: float, code: int
    ) -> None:
        dome = model(64, 64, 1)
        lo = np.full_like(dome.lo, least / 65535)
        how = replace(coding(np.uint16), top=np.inf)
        light = scattered_light(dome, numbers())
        found = frame_apply(replace(dome, lo=lo), np.zeros((64, 64, 3), np.uint16), light, how)
        assert np.unique(found[dome.coverage > 0]).tolist() == [code]

    def test_rounding_of_what_is_the_same_everywhere(self, level: str) -> None:
        """It must not repeat from row to row: such columns would be summed wrong."""
        flat, value = replace(model(512, 512, 1), ambient=None), np.zeros((3, 9))
        flat, value[:, 0] = replace(flat, spread=np.full_like(flat.spread, 0.1)), 1
        off = scattered_light(flat, value).astype(float) - np.float32(0.1).astype(float)
        if level != "numpy":  # the reference rounds to nearest
            assert (off != 0).any()
        assert np.abs(off.mean(axis=0)).max() < 5e-9

    @pytest.mark.parametrize("offset", [None, numbers()])
    @pytest.mark.parametrize("terms", [1, 4, 9])
    def test_bounced_light(self, level: str, terms: int, offset: np.ndarray | None) -> None:
        for seed in range(3):
            dome = model(150, 150, terms, seed)
            found = scattered_light(dome, numbers(), offset)
            with kernels.forced("numpy"):
                expected = scattered_light(dome, numbers(), offset)
            np.testing.assert_allclose(found, expected, atol=1e-6)

    @pytest.mark.parametrize("threads", [1, 3])
    def test_threads_change_nothing(self, level: str, threads: int) -> None:
        dome, content, how = model(300, 130, 9), picture(300, np.uint8), coding(np.uint8)
        light = scattered_light(dome, numbers())
        one = frame_sums(dome, content, light, "light", how)
        with kernels.forced(level, threads):
            np.testing.assert_array_equal(frame_sums(dome, content, light, "light", how), one)

    @pytest.mark.parametrize("strength", [1.0, 0.5])
    @pytest.mark.parametrize("kind", TYPES)
    def test_in_place_and_unaligned(self, level: str, kind: type, strength: float) -> None:
        dome, how = model(97, 64, 1), coding(kind, strength)
        content = picture(97, kind)
        light = scattered_light(dome, numbers())
        expected = frame_apply(dome, content, light, how)
        room = np.zeros(content.nbytes + 64, np.uint8)[content.itemsize :][: content.nbytes]
        apart = room.view(kind).reshape(content.shape)
        np.testing.assert_array_equal(frame_apply(dome, content, light, how, apart), expected)
        assert frame_apply(dome, content, light, how, content) is content
        np.testing.assert_array_equal(content, expected)

    def test_nan_becomes_the_least_light(self, level: str) -> None:
        dome, how = model(64, 64, 1), coding(np.float32)
        content = np.full((64, 64, 3), np.nan, np.float32)
        found = frame_apply(dome, content, scattered_light(dome, numbers()), how)
        lit = dome.coverage > 0
        np.testing.assert_allclose(found[lit], dome.lo[lit], rtol=1e-6)


@pytest.mark.parametrize("name", TRANSFER_NAMES)
@pytest.mark.parametrize("size", [64])
def test_encoding_is_within_a_tenth_of_a_step(level: str, size: int, name: str) -> None:
    """Without scattered light codes come back as themselves under any threshold."""
    dome = replace(
        model(size, size, 1), spread=np.zeros((size, size, 3), np.float32),
        lo=np.zeros((size, size, 3), np.float32),
    )  # fmt: skip
    codes = np.resize(np.arange(256, dtype=np.uint8), (size, size, 3))
    light = scattered_light(dome, numbers())
    known, lit = transfer(name), dome.coverage > 0
    for rest in (0.1, 0.9):
        how = Coding(known.decode, known.encode, np.full((64, 64), rest, np.float32), 1.0, 1.0)
        found = frame_apply(dome, codes, light, how)
        np.testing.assert_array_equal(found[lit], codes[lit])


class TestPadded:
    def test_any_other_is(self) -> None:
        spoilt = zeros_to_pad((5, 5))
        spoilt.base[-1] = np.nan  # type: ignore[index]
        wide, double = np.ones((6, 5), np.float32), np.ones((5, 5))
        room = np.zeros(25 + SPARE, np.float32)
        room[:25], later = 3, room[SPARE:].reshape(5, 5)
        for field in (spoilt, wide[1:], wide[:5], double, wide.T[:, :5], later):
            found = padded(field)
            assert found is not None
            assert not np.shares_memory(found, field)
            np.testing.assert_array_equal(found[:-SPARE], field.ravel())
            assert not found[-SPARE:].any()
        assert padded(None) is None


class TestGrid:
    def test_half_pixel_centres(self) -> None:
        grid = Grid(8, 4)
        positions = grid.above + grid.down
        np.testing.assert_allclose(positions[1:-1], (np.arange(8) / 2 - 0.25)[1:-1])
        assert grid.rows.tolist() == [0, 1, 3, 5, 7, 8]

    @pytest.mark.parametrize(("size", "nodes"), [(64, 64), (97, 64), (270, 30), (40, 1)])
    @pytest.mark.parametrize("colours", [(), (3,)])
    def test_the_least_of_blocks(self, size: int, nodes: int, colours: tuple[int, ...]) -> None:
        field = np.random.default_rng(1).random((nodes, nodes, *colours))
        grid = Grid(size, nodes)
        found = grid.least(field)
        for interval, block in np.ndindex(found.shape):
            above, below = np.clip([interval - 1, interval], 0, nodes - 1)
            first, last = np.minimum([block * 64, block * 64 + 63], 3 * size - 1) // 3
            near = field[above : below + 1, grid.left[first] : grid.right[last] + 1]
            assert found[interval, block] == near.min()
        assert found.shape == (nodes + 1, -(-3 * size // 64))


class TestReference:
    def test_sums_are_those_pixel_by_pixel(self) -> None:
        """At the maps' own size there is nothing between a pixel and its node."""
        dome, content = model(64, 64, 9), picture(64, np.float32)
        light = scattered_light(dome, numbers())
        direct = np.maximum(content - light, dome.lo).astype(float)
        x, y, z = dome.direction.astype(float)
        mono = (1, x, y, z, x * y, y * z, x * z, x * x - y * y, z * z)
        expected = np.array(
            [[(dome.solid_angle_sr * m * direct[..., c]).sum() for m in mono] for c in range(3)]
        )
        found = frame_sums(dome, content, light, "light", coding(np.float32))
        np.testing.assert_allclose(found, expected, atol=1e-6)


def stripes(size: int) -> dict[str, np.ndarray]:
    """Pictures (N, N) of bright rows, columns, noise, rims and rings."""
    y, x = np.mgrid[:size, :size]
    upper, radius = y < size // 2, np.hypot(y - size / 2, x - size / 2) / size
    kept = {f"1 row in {n}": (y % n == 0) & upper for n in (2, 3, 4, 8, 16)}
    kept |= {
        "8 rows in 16": (y % 16 < 8) & upper,
        "1 column in 16": (x % 16 == 0) & (x < size / 2),
        "noise": np.random.default_rng(4).random(y.shape) < 0.5,
        "rim": radius > 0.42,
        "upper rim": (radius > 0.42) & upper,
        "ring": (radius > 0.425) & (radius < 0.4265),
        "one row": y == int(0.11 * size),
        "first rows": y < 12,
        "last rows": y >= size - 12,
    }
    known = (y >= 4) & (y < size - 4)  # between nodes, not before the first
    return {name: 255 * (where & known).astype(np.uint8) for name, where in kept.items()}


def bordered(dome: FrameModel, border: str) -> FrameModel:
    """A dome that is lit to a sharp border, to one that fades over 3 nodes, or into all corners."""
    nodes, none = dome.nodes, np.zeros_like(dome.lo)
    y, x = (np.mgrid[:nodes, :nodes] + 0.5) / nodes - 0.5
    if border == "none":
        coverage, area = np.ones((nodes, nodes)), 1 / (1 + (x + 0.2) ** 2 + y**2)
    else:
        inside, area = 0.43 - np.hypot(x, y), master_solid_angles(nodes)
        coverage = (
            np.clip(inside * nodes / 3 + 0.5, 0, 1) if border == "soft" else 1.0 * (inside > 0)
        )
    return replace(
        dome, ambient=None, lo=none, spread=none + np.float32(0.1),
        coverage=coverage.astype(np.float32),
        solid_angle_sr=(area * coverage).astype(np.float32),
    )  # fmt: skip


@pytest.mark.parametrize(("size", "nodes"), [(1200, 300), (1200, 520), (1300, 901), (1300, 1024)])
@pytest.mark.parametrize("border", ["sharp", "soft", "none"])
def test_sums_use_the_area_and_direction_of_each_pixel(size: int, nodes: int, border: str) -> None:
    """Wherever in a band of rows light lies; areas and directions are those between nodes."""
    dome = bordered(model(size, nodes, 9), border)
    how, dark = coding(np.uint8, name="linear"), np.zeros_like(dome.lo)
    area = cv2.resize(dome.solid_angle_sr.astype(float), (size, size))
    x, y, z = (cv2.resize(axis.astype(float), (size, size)) for axis in dome.direction)
    mono = (1, x, y, z, x * y, y * z, x * z, x * x - y * y, z * z)[: dome.terms]
    for name, picture in stripes(size).items():
        expected = np.array([(area * m * picture).sum() for m in mono]) / 255
        if expected[0] == 0:
            continue
        content = np.repeat(picture[..., None], 3, axis=2)
        found = frame_sums(dome, content, dark, "light", how)[1]
        off = np.abs(found - expected) / expected[0]
        assert off[0] < 2e-5 and off.max() < 4e-5, (name, off)


class TestRefusals:
    def test_light_of_any_origin(self, level: str) -> None:
        dome, content, how = model(64, 64, 4), picture(64, np.uint8), coding(np.uint8)
        light = scattered_light(dome, numbers())
        expected = frame_sums(dome, content, light, "light", how)
        for other in (light.copy(), light.astype(float), np.asfortranarray(light)):
            found = frame_sums(dome, content, other, "light", how)
            np.testing.assert_array_equal(found, expected)
        with pytest.raises(ShapeError, match="light has shape"):
            frame_sums(dome, content, light[:-1], "light", how)

    def test_fields_finer_than_the_picture(self) -> None:
        with pytest.raises(InputError, match="fields: 64 nodes are more than the picture's 32 px"):
            model(32, 64, 1)

    def test_terms_of_no_kernel(self) -> None:
        with pytest.raises(InputError, match="terms: 3 are not supported, only 1, 4 and 9"):
            model(64, 64, 3)

    def test_solid_angles_where_nothing_is_lit(self) -> None:
        dome = model(64, 64, 1)
        with pytest.raises(InputError, match="at 5 nodes it or the coverage is 0"):
            solid = dome.solid_angle_sr.copy()
            solid[32, 30:35] = 0
            replace(dome, solid_angle_sr=solid)

    def test_content_of_a_wrong_shape(self) -> None:
        dome, how = model(64, 64, 1), coding(np.uint8)
        light = scattered_light(dome, numbers())
        with pytest.raises(ShapeError, match=r"content has shape .*; it needs \(64, 64, 3\)"):
            frame_sums(dome, picture(65, np.uint8), light, "light", how)
        with pytest.raises(ShapeError, match="out has shape"):
            frame_apply(dome, picture(64, np.uint8), light, how, picture(65, np.uint8))

    def test_sums_of_no_such_thing(self) -> None:
        dome, how = model(64, 64, 1), coding(np.uint8)
        with pytest.raises(
            InputError, match="what: 'ligth' is unknown; choose one of light, content"
        ):
            frame_sums(dome, picture(64, np.uint8), scattered_light(dome, numbers()), "ligth", how)

    def test_content_of_a_wrong_type(self) -> None:
        dome, how = model(64, 64, 1), coding(np.uint8)
        light = scattered_light(dome, numbers())
        with pytest.raises(InputError, match="content: float64 is not supported"):
            frame_sums(dome, np.zeros((64, 64, 3)), light, "light", how)
        with pytest.raises(
            InputError,
            match="out: it must be a writable, contiguous array of uint8",
        ):
            frame_apply(dome, picture(64, np.uint8), light, how, picture(64, np.uint16))
