"""Rooms of walls: where rays end, what walls exchange, and what projectors put on them."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import CLOSED_FORM

from simulators.presets import IDEAL
from simulators.scene import ALL_BANDS, DomeScene, SceneSize
from simulators.walled_room import WalledRoom, WalledSurface
from simulators.walls import ArcFloor, ArcWall, Wall, canvas_corners, walls_of

BOX = {"width_m": 4.0, "depth_m": 3.0, "height_m": 2.0}
L = BOX | {"cut_width_m": 2.0, "cut_depth_m": 1.5}
NAMES = ("left", "front", "right", "back", "floor", "ceiling")


def surface(
    kind: str, lengths: dict[str, float], lit: tuple[str, ...], others: float = 0.5
) -> WalledSurface:
    walls = tuple(walls_of(kind, lengths))
    return WalledSurface(IDEAL, walls, frozenset(lit), {w.name: others for w in walls}, 0.5)


def room_scene(walls: WalledSurface) -> DomeScene:
    return DomeScene(IDEAL, SceneSize(1, (160, 100), 1, (120, 120), rays=64), 1, surface=walls)


@pytest.mark.parametrize(
    "wall",
    [
        *walls_of("box", BOX),
        ArcWall("wall", 3.0, 2.0, 1.0, -1.0),
        ArcFloor("floor", 3.0, 2.0, -1.0),
    ],
    ids=lambda wall: f"{type(wall).__name__}-{wall.name}",
)
def test_a_ray_to_a_point_of_a_wall_meets_it_there(wall: Wall) -> None:
    rng = np.random.default_rng(1)
    u, v = rng.uniform(0.05, 0.95, (2, 50))
    points = wall.points(u, v)
    origin = np.tile([0.1, -0.1, 0.05], (50, 1))
    away = points - origin
    distance, *place = wall.hit(origin, away / np.linalg.norm(away, axis=1, keepdims=True))
    np.testing.assert_allclose(distance, np.linalg.norm(away, axis=1), rtol=CLOSED_FORM)
    np.testing.assert_allclose(place, [u, v], atol=CLOSED_FORM)
    assert (np.einsum("ni,ni->n", wall.inwards(points), away) < 0).all()
    assert np.isinf(wall.hit(points, away)[0]).all()  # from the wall outwards


def test_a_closed_box_of_one_paint_and_uniform_light() -> None:
    """All light that leaves a wall arrives at walls: E = b / (1 - rho) for uniform direct light b."""
    room = WalledRoom.trace(surface("box", BOX, NAMES), rays=256)
    albedo = IDEAL.albedo
    np.testing.assert_allclose(room.exchange.sum(axis=1), 1.0, atol=1e-2)
    found = room.irradiance(room.area_m2[:, None])
    np.testing.assert_allclose(found, 1 / (1 - albedo), rtol=0.01)


def test_walls_behind_a_corner_are_hidden() -> None:
    room = surface("L", L, ("front",))
    before = np.array([[0.0, 1.9, 0.0], [-1.4, -1.9, 0.0]])  # left wall; back right
    assert room.sees(np.array([1.4, 1.0, 0.0]), before).tolist() == [True, False]
    area = sum(float(w.cell_areas(3, 2).sum()) for w in room.walls if w.name.endswith("floor"))
    assert area == pytest.approx(4 * 3 - 2 * 1.5)


def test_projectors_cover_the_walls_that_are_lit() -> None:
    scene = DomeScene(
        IDEAL,
        SceneSize(1, (160, 100), 1, (120, 120), rays=64),
        1,
        surface=surface("box", BOX, ("front", "floor")),
    )
    assert list(scene.lights) == ["front", "floor"]
    for light, area in zip(scene.lights.values(), (4 * 2, 4 * 3), strict=True):
        own = light.patch_flux(light.irradiance[..., None], len(scene.room.area_m2))
        flux = float((light.irradiance * light.reflected_m2).sum())
        assert own.sum() == pytest.approx(flux, rel=1e-6)
        assert light.area_m2[light.lit].sum() == pytest.approx(area, rel=0.15)  # some spills over


def test_a_camera_sees_direct_and_scattered_light_and_repaint_scales_it() -> None:
    scene = DomeScene(
        IDEAL,
        SceneSize(1, (160, 100), 1, (120, 120), rays=64),
        1,
        surface=surface("box", BOX, ("front",), 0.0),
    )
    drives = {"front": np.ones((100, 160, 3), np.float32)}
    lines = scene.sight_lines("zenith")
    direct, scattered = scene.parts_of_drives(lines, drives, {"front": 1.0}, ALL_BANDS, 0.0)
    assert direct.max() > 0.1
    assert scattered.max() < 1e-6 * direct.max()  # a flat wall alone does not light itself
    brighter = replace(scene.surface, preset=replace(IDEAL, albedo=0.25))
    half = lines.repainted(scene.surface, brighter).direct(
        "front", scene.lights["front"].irradiance[..., None]
    )
    whole = lines.direct("front", scene.lights["front"].irradiance[..., None])
    np.testing.assert_allclose(half, 0.25 / IDEAL.albedo * whole, rtol=1e-5)


def test_the_canvas_is_a_strip() -> None:
    found = canvas_corners(walls_of("box", BOX), ("left", "front", "floor"))
    assert found == {"left": (0.0, 0.0), "front": (3.0, 0.0), "floor": (3.0, 2.0)}
