"""A dome master as a projector: directions of its pixels, its pictures, its lit pixels."""

import numpy as np
import pytest
from tolerances import CLOSED_FORM

from procam.estimate.media_server.dome_master import (
    SECTORS,
    DomeMaster,
    lit_by_stripes,
    plan_server,
    zone_picture,
)
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import (
    direction_from_angles,
    master_directions,
    master_pixels,
    master_solid_angles,
)

SIZE = 512
RNG = np.random.default_rng(5)


def pixels_of(master: DomeMaster, direction: np.ndarray) -> np.ndarray:
    model = master.model
    return project(model.projector_from_dome.apply(6.0 * direction), model.lens)


@pytest.mark.parametrize("fov_deg", [120.0, 220.0])
def test_directions_are_those_of_the_format(fov_deg: float) -> None:
    """Against the dome master's formula, which has no lens."""
    fov = float(np.radians(fov_deg))
    direction, inside = master_directions(64, fov)
    found = pixels_of(DomeMaster("server", 64, fov), direction)
    np.testing.assert_allclose(found, master_pixels(direction, 64, fov), atol=1e-9)
    x, y = np.meshgrid(np.arange(64.0), np.arange(64.0))
    np.testing.assert_allclose(found[inside], np.stack([x, y], -1)[inside], atol=1e-9)


def test_front_is_at_the_bottom_unless_it_is_turned() -> None:
    front = direction_from_angles(0.0, 0.0)
    bottom = pixels_of(DomeMaster("server", SIZE), front)
    np.testing.assert_allclose(bottom, [(SIZE - 1) / 2, SIZE - 0.5], atol=CLOSED_FORM * SIZE)
    turned = DomeMaster("server", SIZE, rotation=float(np.radians(90)))
    left = direction_from_angles(np.pi / 2, 0.0)
    np.testing.assert_allclose(pixels_of(turned, left), bottom, atol=CLOSED_FORM * SIZE)


@pytest.mark.parametrize(("size", "coarse"), [(512, 1), (1024, 1), (3000, 3), (4096, 4)])
def test_stripes_are_some_degrees_wide_for_every_size(size: int, coarse: int) -> None:
    master = DomeMaster("server", size)
    assert master.coarse == coarse
    for bit in master.stripe_bits:
        degrees = 2 ** (bit + 1) * coarse * 180 / size
        assert 2.5 < degrees < 12
    # pixel centres of the coarse raster: the middle of each block of pixels
    middle = (np.arange(3) + 0.5) * coarse - 0.5
    xy = np.stack([middle, middle], -1).astype(np.float32)
    np.testing.assert_allclose(master.coarse_pixels(xy), [[0, 0], [1, 1], [2, 2]], atol=1e-6)


def test_the_plan() -> None:
    plan, pictures = plan_server(DomeMaster("server", SIZE), 0.1, 6.0)
    assert len(plan.shots) == 23
    assert plan.shots[0].exposures_s == (0.1, 6.0)
    counts = {p: len(plan.of("server", p)) for p in ("white", "black", "tags", "stripes", "zone")}
    assert counts == {"white": 1, "black": 1, "tags": 2, "stripes": 8, "zone": 4}
    assert not plan.of("server", "code")
    assert {p.shape[:2] for p in pictures.values()} == {(SIZE, SIZE)}
    for pattern, inverse in zip(*[iter(plan.of("server", "stripes"))] * 2, strict=True):
        both = pictures[pattern.pattern].astype(int) + pictures[inverse.pattern]
        assert (both == 255).all()


def test_coarse_pictures_consist_of_equal_blocks() -> None:
    master = DomeMaster("server", 1536)
    assert master.coarse == 2
    plan, pictures = plan_server(master, 0.1, 6.0)
    for shot in [*plan.of("server", "levels"), *plan.of("server", "stripes")]:
        picture = pictures[shot.pattern]
        coarse = picture[:: master.coarse, :: master.coarse]
        again = coarse.repeat(master.coarse, 0).repeat(master.coarse, 1)
        np.testing.assert_array_equal(again, picture)


def test_zones_cover_the_master_once_and_lie_at_different_heights() -> None:
    zones = [zone_picture(256, z)[..., 0] / 255 for z in range(1 + SECTORS)]
    np.testing.assert_array_equal(sum(zones), np.ones((256, 256)))
    direction, _ = master_directions(256)
    solid = master_solid_angles(256)
    heights = [float((solid * z * direction[..., 2]).sum() / (solid * z).sum()) for z in zones]
    assert heights[0] > 0.75 and max(heights[1:]) < 0.5


class TestLitPixels:
    def test_scattered_light_is_not_lit(self) -> None:
        """White minus black is high everywhere; only a part of it is direct."""
        direct = np.zeros((60, 80, 3), np.float32)
        direct[:, :50] = 0.6
        white = direct + 0.25 + RNG.normal(0, 0.004, direct.shape).astype(np.float32)
        stripes = np.add.outer(np.zeros(60), np.arange(80) // 8 % 2)[..., None]
        pairs = [(direct * stripes + 0.12, direct * (1 - stripes) + 0.13)]
        found = lit_by_stripes(
            white, [(p.astype(np.float32), i.astype(np.float32)) for p, i in pairs]
        )
        assert found[:, :48].all() and not found[:, 52:].any()

    def test_a_dark_picture_has_no_lit_pixels(self) -> None:
        dark = np.zeros((20, 30, 3), np.float32)
        assert not lit_by_stripes(dark, [(dark, dark)]).any()


def test_positions_outside_the_circle() -> None:
    master = DomeMaster("server", 100)
    places = np.array([[49.5, 49.5], [49.5, 99.0], [5.0, 5.0], [np.nan, 3.0]], np.float32)
    assert master.inside(places).tolist() == [True, True, False, False]
