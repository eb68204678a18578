"""The path-traced judge against closed forms, form factors of textbooks and the flux tracer.

Runs with Mitsuba's LLVM variant where there is a library for it, else with the scalar one.
"""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest
from exact_room import coarse_rooms, exact_rooms
from tolerances import SIGMAS

from procam.errors import InputError, ShapeError, UnitError
from procam.maths.geometry.sphere import normalise
from simulators import mitsuba_scene, transport
from simulators.mitsuba_paths import PatchedMesh, scattered_irradiance
from simulators.mitsuba_scene import load_mitsuba
from simulators.mitsuba_venue import PathTracedRoom, room_mesh, scattered_radiosity
from simulators.presets import IDEAL, REALISTIC, Preset
from simulators.surface import Surface
from simulators.transport import Room, dome_patch

# Student's t with 7 degrees of freedom, eight batches: two-sided 1e-4
T_SIGMAS = 7.9
# its standard deviation
T_SPREAD = np.sqrt(7 / 5)
PARALLEL = 0.199825  # form factor of opposite faces of a cube; its neighbours share the rest


def _patched(
    parts: list[tuple[np.ndarray, np.ndarray]], albedo: list[float], gloss: float = 0.0
) -> PatchedMesh:
    """Meshes as one, a patch each."""
    start = np.cumsum([0, *(len(v) for v, _ in parts)])
    faces = np.concatenate([f + s for (_, f), s in zip(parts, start[:-1], strict=True)])
    patch = np.repeat(np.arange(len(parts)), [len(f) for _, f in parts])
    vertices = np.concatenate([v for v, _ in parts])
    return PatchedMesh(
        vertices, faces, patch, np.array(albedo)[patch, None], np.full((len(faces), 1), gloss)
    )


def _square(*corners: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])


def _sphere(gloss: float = 0.0) -> tuple[PatchedMesh, np.ndarray]:
    """A whole sphere of 16 patches, albedo 0.6, and light on one."""
    vertices, faces = mesh_shapes.scattered_sphere(2.0, 12_000)
    x, y, z = vertices[faces].mean(axis=1).T
    ring = np.minimum((1 - z / 2) / 2 * 4, 3).astype(int)
    patch = 4 * ring + (np.arctan2(y, x) / (np.pi / 2) % 4).astype(int)
    albedo, lobe = np.full((len(faces), 1), 0.6), np.full((len(faces), 1), gloss)
    mesh = PatchedMesh(vertices, faces, patch, albedo, lobe)
    direct = (patch == 0)[:, None] * 1.0
    return mesh, direct


class TestClosedForms:
    def test_sphere(self) -> None:
        """Eq. 10: b+ = rho/(1 - rho) flux/(4 pi r^2), the same everywhere; lit is the top."""
        mesh, _ = _sphere()
        direct = (mesh.patch < 4)[:, None] * 1.0
        light, error = scattered_irradiance(mesh, direct, 512)
        expected = mesh.areas_m2() @ direct / mesh.areas_m2().sum() / (1 - 0.6)
        score = (light - expected) / error
        assert np.abs(score).max() < T_SIGMAS
        assert 0.6 < np.sqrt(np.mean(score**2)) / T_SPREAD < 1.6
        assert np.sqrt(np.mean(error**2)) < 0.03 * expected

    def test_furnace(self) -> None:
        """In a closed room whose walls emit 1 - rho, the radiosity is 1 everywhere."""
        vertices, faces = mesh_shapes.box((0, 0, 0), (1, 1, 1))
        albedo = np.linspace(0.2, 0.8, 24).reshape(12, 2)
        scattered, error = scattered_radiosity(vertices, faces, albedo, 1 - albedo, 512)
        score = (scattered - albedo) / error
        assert np.abs(score).max() < T_SIGMAS
        assert error.max() < 0.02

    @pytest.mark.parametrize(
        ("other", "factor"),
        [
            (_square((0, 0, 1), (0, 1, 1), (1, 1, 1), (1, 0, 1)), PARALLEL),
            (_square((0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)), (1 - PARALLEL) / 4),
        ],
        ids=["parallel", "at-an-edge"],
    )
    def test_unit_squares(self, other: tuple[np.ndarray, np.ndarray], factor: float) -> None:
        floor = _square((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
        mesh = _patched([floor, other], [0.5, 0.0])
        light, error = scattered_irradiance(mesh, (mesh.patch == 1)[:, None] * 1.0, 8192)
        assert abs(light[0, 0] - factor) < T_SIGMAS * error[0, 0]
        assert error[0, 0] < 0.02 * factor

    def test_a_ball_in_a_sphere(self) -> None:
        """Occlusion: F to the ball is (r1/r2)^2; two equations give all light."""
        ball, cover = (
            mesh_shapes.scattered_sphere(1.0, 6000),
            mesh_shapes.scattered_sphere(2.0, 9000),
        )
        mesh = _patched([(ball[0], ball[1][:, ::-1]), cover], [0.7, 0.5])
        light, error = scattered_irradiance(mesh, (mesh.patch == 1)[:, None] * 1.0, 8192)
        to_ball = 0.25
        factors = np.array([[0.0, 1.0], [to_ball, 1 - to_ball]])
        sent = np.linalg.solve(np.eye(2) - np.diag([0.7, 0.5]) @ factors, [0.0, 1.0])
        np.testing.assert_array_less(np.abs(light[:, 0] - factors @ sent), T_SIGMAS * error[:, 0])
        assert error.max() < 0.01


class TestGloss:
    def test_it_loses_little(self) -> None:
        """A lobe of one bounce loses what bounces twice between its facets: a percent or so."""
        vertices, faces = mesh_shapes.box((0, 0, 0), (1, 1, 1))
        mesh = _patched([(vertices, faces)], [0.5], gloss=0.5)
        light, error = scattered_irradiance(mesh, np.full((12, 1), 0.5), 2048)
        assert 0.97 < light[0, 0] + SIGMAS * error[0, 0]
        assert light[0, 0] - SIGMAS * error[0, 0] < 1

    def test_it_gathers_light(self) -> None:
        """Light that skims a mirror sphere meets again opposite to where it began."""
        mesh, direct = _sphere(gloss=0.9)
        light, error = scattered_irradiance(mesh, direct, 512)
        opposite = 4 * 3 + 2
        assert light.argmax() == opposite
        assert light[opposite, 0] - SIGMAS * error[opposite, 0] > 1.2 * np.median(light)


@pytest.fixture
def bare() -> Iterator[Room]:
    with exact_rooms():
        yield Room.trace(Surface.build(IDEAL))


def _flux(room: Room) -> np.ndarray:
    """White on the whole dome, and on its left half."""
    dome = transport.DOME_RINGS * transport.DOME_SECTORS
    left = np.arange(dome) % transport.DOME_SECTORS < transport.DOME_SECTORS // 2
    flux = np.zeros((len(room.area_m2), 2))
    flux[:dome] = (room.area_m2 * room.albedo)[:dome, None]
    flux[:dome, 1] *= left
    return flux


class TestRoom:
    def test_bare_dome(self, bare: Room) -> None:
        """Eq. 10 with all that reflects, of a dome over a black deck."""
        dome = slice(transport.DOME_RINGS * transport.DOME_SECTORS)
        room = PathTracedRoom.of(bare, samples=64)
        light, error = room.irradiance_and_error(_flux(bare))
        score = (light - bare.irradiance(_flux(bare)))[dome] / error[dome]
        assert 0.8 < np.sqrt(np.mean(score**2)) / T_SPREAD < 1.2
        assert light[dome].mean() == pytest.approx(
            bare.irradiance(_flux(bare))[dome].mean(), rel=0.01
        )
        np.testing.assert_array_equal(room.irradiance(_flux(bare)), light)

    @pytest.mark.parametrize(
        "preset",
        [
            replace(
                REALISTIC, gloss=0.0, floor_albedo=0.3
            ),  # oval, panelled, with a deck and a pod
            replace(IDEAL, floor_albedo=0.4, deck_drop_m=1.5, wall_albedo=0.3, tilt_deg=0.0),
        ],
        ids=["pod", "wall"],
    )
    def test_furnished_dome_against_flux_tracing(self, preset: Preset) -> None:
        """Two tracers that share no ray."""
        with coarse_rooms():
            room = Room.trace(Surface.build(preset), 1024)
            traced = room.irradiance(_flux(room))
            judge = PathTracedRoom.of(room, samples=64, seed=3)
            light, error = judge.irradiance_and_error(_flux(room))
        assert light.shape == traced.shape == (len(room.area_m2), 2)
        for part in (slice(0, 288), slice(288, 480), slice(480, None)):  # dome, deck, pod or wall
            assert light[part].mean() == pytest.approx(traced[part].mean(), rel=0.02)
        score = (light - traced) / error
        assert np.sqrt(np.mean(score**2)) / T_SPREAD < 1.2
        if preset.wall_albedo:  # a closed room: every ray ends on something
            assert len(room.area_m2) == 480 + transport.WALL_RINGS * transport.WALL_SECTORS
            np.testing.assert_allclose(room.exchange.sum(axis=1), 1, atol=2e-3)

    @pytest.mark.parametrize("preset", [IDEAL, REALISTIC], ids=["ideal", "realistic"])
    def test_the_mesh_is_the_room(self, preset: Preset) -> None:
        surface = Surface.build(preset)
        mesh, tracer = room_mesh(surface), transport.Tracer(surface)
        area = np.bincount(mesh.patch, mesh.areas_m2())
        # a small patch beside a step: the mesh climbs it in one face
        np.testing.assert_allclose(area, tracer.area_m2, rtol=1e-2)
        assert area.sum() == pytest.approx(tracer.area_m2.sum(), rel=5e-4)
        paint = np.bincount(mesh.patch, mesh.areas_m2() * mesh.albedo[:, 0]) / area
        np.testing.assert_allclose(paint, tracer.patch_albedo(), rtol=1e-3)
        middle, inward = mesh.vertices[mesh.faces].mean(axis=1), mesh.frames()[:, 2]
        on_dome = mesh.patch < tracer.dome_count
        direction = normalise(middle[on_dome])
        np.testing.assert_array_equal(
            dome_patch(direction, surface.half_angle), mesh.patch[on_dome]
        )
        level = np.einsum("fi,fi->f", direction, inward[on_dome]) < -0.99  # steps are not
        assert mesh.areas_m2()[on_dome][level].sum() > 0.999 * area[: tracer.dome_count].sum()
        on_deck = (mesh.patch >= tracer.dome_count) & (mesh.patch < tracer.dome_count + 192)
        np.testing.assert_array_equal(
            transport._floor_patch(middle[on_deck], tracer.deck), mesh.patch[on_deck]
        )
        np.testing.assert_allclose(inward[on_deck] @ tracer.deck.up, 1, rtol=1e-5)
        out = middle[mesh.patch >= tracer.dome_count + 192] - transport.POD_CENTRE_M
        on_pod = mesh.patch >= tracer.dome_count + 192
        assert (np.einsum("fi,fi->f", out, inward[on_pod]) > 0).all()
        np.testing.assert_array_equal(
            tracer.dome_count + 192 + transport._pod_patch(normalise(out)), mesh.patch[on_pod]
        )

    def test_without_bounces_there_is_no_scattered_light(self, bare: Room) -> None:
        dark = bare.repainted(Surface.build(IDEAL.altered(albedo=0.0)))
        assert not PathTracedRoom.of(dark).irradiance(_flux(dark)).any()


class TestErrors:
    BOX = mesh_shapes.box((0, 0, 0), (1, 1, 1))

    def test_no_mitsuba(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "mitsuba", None)
        message = r'mitsuba is not installed; run: pip install "procam\[sim\]"$'
        with pytest.raises(InputError, match=message):
            load_mitsuba.__wrapped__()

    def test_albedo_of_other_faces(self) -> None:
        with pytest.raises(ShapeError, match=r"albedo has shape \(11, 1\); it needs \(12, C\)"):
            scattered_radiosity(*self.BOX, *np.full((2, 11, 1), 0.5), 16)

    def test_white_room(self) -> None:
        with pytest.raises(UnitError, match="albedo is 1 to 1; it must be 0 to below 1"):
            scattered_radiosity(*self.BOX, *np.ones((2, 12, 1)), 16)

    def test_direct_light_of_other_channels(self) -> None:
        with pytest.raises(ShapeError, match=r"direct has shape \(12, 3\); it needs \(12, 1\)"):
            scattered_radiosity(*self.BOX, np.full((12, 1), 0.5), np.ones((12, 3)), 16)

    @pytest.mark.parametrize("samples", [4, 100])
    def test_samples(self, samples: int) -> None:
        message = f"samples is {samples}; it must be a power of two from 8 on"
        with pytest.raises(UnitError, match=message):
            scattered_radiosity(*self.BOX, *np.full((2, 12, 1), 0.5), samples)


class TestVariant:
    def test_a_library_that_cannot_be_loaded(self) -> None:
        assert not mitsuba_scene._llvm_works("/none/libLLVM.so")

    def test_a_library_that_hangs(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def hang(*arguments: object, **options: object) -> None:
            raise subprocess.TimeoutExpired("python", 1)

        monkeypatch.setattr(subprocess, "run", hang)
        assert not mitsuba_scene._llvm_works("")
