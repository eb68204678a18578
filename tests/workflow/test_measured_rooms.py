"""Rooms from photographs to compensated frames, judged on the simulated walls."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from edited_files import rewritten
from scipy.ndimage import binary_erosion
from tiny_venue import refused
from typer.testing import CliRunner

from procam.arrays import Array, Image
from procam.compensate.any_screen import compensator_for
from procam.compensate.projector_frames import projector_frames
from procam.estimate.closed_loop.picture_loop import LOOP_SIZE
from procam.estimate.closed_loop.refined import with_gains
from procam.estimate.drift.room_scatter_change import RoomScattering, content_light
from procam.estimate.light.audience import expected_light
from procam.estimate.light.separation import CLEAR_CAMERA_PX
from procam.files.calibration import load_calibration, save_calibration
from procam.files.images.stills import read_picture
from procam.files.venue.load import load_venue
from procam.files.versions import calibration_in_use, use_calibration
from procam.interfaces.cli.main import app
from procam.maths.warp import grow
from procam.model.calibration import Calibration
from procam.workflows.comparison import compare
from procam.workflows.verify.photographs import read_reference
from simulators.backend import build_scene
from simulators.room_obj import obj_text
from simulators.scene import ALL_BANDS, DomeScene, SceneSize
from simulators.sight_lines import SightLines
from simulators.template import walls_text
from simulators.walled_room import Cast, WalledSurface

SIZE = SceneSize(2, (640, 400), 2, (800, 800), rays=1024, map_size=256)
LOWER_M = 0.02
EDGE_PX = 4  # of the canvas, beside what is lit in part
Room = tuple[Path, Calibration, DomeScene]


@dataclass(frozen=True)
class OnWalls:
    """What an audience sees on the pixels of the canvas, in content light."""

    lines: SightLines
    scene: DomeScene
    calibration: Calibration

    @classmethod
    def of(cls, scene: DomeScene, calibration: Calibration) -> "OnWalls":
        direction, _ = calibration.canvas.directions(SIZE.map_size or 0)
        lines = SightLines.along(scene.room, scene.lights, np.zeros(3), direction)
        return cls(lines, scene, calibration)

    def of_frames(self, frames: dict[str, Image]) -> tuple[Array, Array]:
        """Direct and scattered light (H, W, 3)."""
        full = dict.fromkeys(frames, 1.0)
        parts = self.scene.parts_of_drives(self.lines, frames, full, ALL_BANDS, 0)
        direct, scattered = (part @ self.calibration.content_from_camera.T for part in parts)
        return direct, scattered


@pytest.fixture(scope="module", params=["box", "box that is lower", "cylinder", "L"])
def room(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Room:
    kind, *other = request.param.split(maxsplit=1)
    folder = tmp_path_factory.mktemp(kind)
    text = walls_text(kind, SIZE, patch_m=0.25)
    (folder / "room.obj").write_text(obj_text(), "utf-8")  # of an L
    (folder / "venue.toml").write_text(_drawn_higher(text) if other else text, "utf-8")
    done = CliRunner().invoke(app, ["calibrate", str(folder)])
    assert done.exit_code == 0, done.output
    calibration = load_calibration(folder / "calibrations" / "0001")
    return folder, calibration, build_scene(load_venue(folder).backends["simulated"], folder)


def _drawn_higher(text: str) -> str:
    """venue.toml of a box that is `LOWER_M` lower than its drawing; marks are measured from upper edges."""
    document = tomlkit.parse(text)
    screen, marks = document["screen"], document["fiducials"]
    screen["height_m"] = float(screen["height_m"]) + LOWER_M
    for mark in marks:
        if mark["name"].startswith("floor"):
            mark["canvas_m"][1] = float(mark["canvas_m"][1]) + LOWER_M
    return tomlkit.dumps(document)


def test_pixels_land_where_they_land(room: Room) -> None:
    """Within 1 mm for each metre of the screen's width; at the edge of a shadow on either wall."""
    _, calibration, scene = room
    shape, width_m = calibration.screen.shape, calibration.screen.room.size_m[0]  # type: ignore[union-attr]
    for name, light in scene.lights.items():
        surface = calibration.projectors[name].surface
        both = surface.valid & light.lit
        assert both.sum() > 0.8 * light.lit.sum()
        direction = surface.direction[both].astype(float)
        away = shape.radius_at(direction)[:, None] * direction - light.direction[both]
        distance = np.linalg.norm(away, axis=1)
        on_other_wall = distance > 0.02 * width_m
        assert on_other_wall.mean() < 1e-3
        assert np.sqrt(np.mean(distance[~on_other_wall] ** 2)) < 1e-3 * width_m
        areas = surface.solid_angle_sr[both] / light.area_m2[both]
        assert np.median(areas) == pytest.approx(1, abs=5e-3)


def test_the_albedo_is_that_of_the_paint(room: Room) -> None:
    _, calibration, scene = room
    true = lit_albedo(scene.surface)  # type: ignore[arg-type]
    np.testing.assert_allclose(calibration.albedo.value, true, rtol=0.02)
    low, high = calibration.albedo.interval()
    assert ((low < true) & (true < high)).all()
    moved = calibration.screen.moved  # type: ignore[union-attr]
    noted = [(note.code, note.subject) for note in calibration.provenance.notes]
    assert noted == ([("wall off", "floor")] if moved else [])
    for _, albedo, sigma in calibration.screen.others:  # type: ignore[union-attr]
        assert abs(albedo - 0.2) < 3 * sigma


def test_walls_that_are_off_are_solved(room: Room) -> None:
    _, calibration, scene = room
    moved = dict(calibration.screen.moved)  # type: ignore[union-attr]
    lower = scene.room.surface.walls[0].size_m[1] < calibration.screen.size[2] - 0.01  # type: ignore[union-attr]
    assert bool(moved) == lower
    if moved:
        assert moved["floor"][0] - moved["floor"][3] == pytest.approx(-LOWER_M, abs=0.005)


def lit_albedo(surface: WalledSurface) -> float:
    at = (np.arange(200) + 0.5) / 200
    u, v = (grid.ravel() for grid in np.meshgrid(at, at))
    total, area = 0.0, 0.0
    for number, wall in enumerate(surface.walls):
        if wall.name in surface.lit:
            cast = Cast(np.full(len(u), number), np.zeros(len(u)), u, v)
            size = float(np.prod(wall.size_m))
            total, area = total + size * float(surface.albedo(cast).mean()), area + size
    return total / area


def test_a_compensated_picture_is_what_was_asked_for(room: Room) -> None:
    """On the simulated walls, all projectors lit, where no limit holds."""
    _, calibration, scene = room
    walls = OnWalls.of(scene, calibration)
    error = {method: _off(walls, method) for method in ("none", "exact")}
    if calibration.screen.kind == "box":
        assert error["none"] > 0.2
        assert error["exact"] < 0.04 * error["none"]
    else:  # walls that hardly see each other: what is left is the noise of the light of projectors
        assert error["exact"] < 0.02 < error["none"]


def _off(walls: OnWalls, method: str) -> float:
    """Root mean square error of a grey picture by a method, in green."""
    calibration, maps = walls.calibration, walls.calibration.maps
    content = np.full((*maps.coverage.shape, 3), 0.6, np.float32)
    inner = binary_erosion(maps.coverage > 0.999, iterations=EDGE_PX)
    weight = calibration.canvas.weights(maps.size) * inner
    picture = compensator_for(calibration)(calibration, maps.size, method).predict(content)
    direct, scattered = walls.of_frames(projector_frames(picture.direct, calibration))
    off = (direct + scattered - content)[..., 1]
    return float(np.sqrt((weight * off**2).sum() / weight.sum()))


def test_pictures_and_projectors_frames_by_the_command_line(room: Room, tmp_path: Path) -> None:
    import cv2

    folder, calibration, _ = room
    rows, columns = calibration.canvas.shape(200)
    content = np.full((rows, columns, 3), 150, np.uint8)
    cv2.imwrite(str(tmp_path / "in.png"), content)
    run = CliRunner()
    done = run.invoke(
        app, ["compensate", str(folder), str(tmp_path / "in.png"), str(tmp_path / "out.png")]
    )
    assert done.exit_code == 0, done.output
    assert "1 frame read back" in done.output
    sent, _ = read_picture(tmp_path / "out.png")
    assert sent.shape == content.shape
    done = run.invoke(
        app,
        [
            "compensate",
            str(folder),
            str(tmp_path / "in.png"),
            str(tmp_path / "frames"),
            "--to",
            "projectors",
        ],
    )
    assert done.exit_code == 0, done.output
    assert {path.stem for path in (tmp_path / "frames").iterdir()} == set(calibration.projectors)
    cv2.imwrite(str(tmp_path / "square.png"), np.zeros((64, 64, 3), np.uint8))
    complaint = refused("compensate", folder, tmp_path / "square.png", tmp_path / "x.png")
    assert "the canvas of this room is" in complaint


def test_the_canvas_is_drawn(room: Room, tmp_path: Path) -> None:
    folder, _, _ = room
    done = CliRunner().invoke(app, ["venue", "canvas", str(folder), str(tmp_path / "canvas.png")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "canvas.png").stat().st_size > 1000


def test_the_report_shows_the_room(room: Room) -> None:
    folder, calibration, _ = room
    page = (folder / "report.html").read_text("utf-8")
    assert "Simulated room" in page and "dome master" not in page
    for name in calibration.screen.lit:  # type: ignore[union-attr]
        assert f">{name}</text>" in page and f"<td>{name.capitalize()}</td>" in page


def test_stills_are_on_the_canvas(room: Room, tmp_path: Path) -> None:
    folder, calibration, _ = room
    done = CliRunner().invoke(app, ["report", str(folder), "--stills", str(tmp_path / "stills")])
    assert done.exit_code == 0, done.output
    written, _ = read_picture(tmp_path / "stills" / "canvas" / "white.compensated.png")
    assert written.shape[:2] == calibration.canvas.shape(written.shape[1])
    assert "room's canvas" in (tmp_path / "stills" / "index.txt").read_text("utf-8")


def test_scattered_light_is_compared_by_form_factors(room: Room) -> None:
    folder, calibration, _ = room
    seen = read_reference(load_venue(folder), calibration).photographs
    name, *_ = seen.projectors
    white = content_light(calibration, seen.projectors[name].white)
    scattering = RoomScattering(calibration, seen.view)
    as_calibrated = scattering.factor(name, white)
    np.testing.assert_allclose(as_calibrated, 1, atol=0.1)
    picture = np.ones((*calibration.projectors[name].surface.valid.shape, 1), np.float32)
    lit = grow(expected_light(calibration, seen.view, name, picture) > 0, CLEAR_CAMERA_PX)
    more = np.where(lit[..., None], white, 1.2 * white)
    ratio = scattering.factor(name, more) / as_calibrated
    assert (ratio > 1.19).all() and (ratio < 1.4).all()  # direct light is what is left of the same
    nowhere = RoomScattering(calibration, replace(seen.view, on_screen=lit))
    assert np.isnan(nowhere.factor(name, white)).all()


def test_a_calibration_agrees_with_itself(room: Room) -> None:
    _, calibration, _ = room
    assert compare(calibration, calibration).verdict.sound


# one room is enough for minutes of photographs
the_box = pytest.mark.parametrize("room", ["box"], indirect=True)


@the_box
def test_the_loop_finds_gains_that_are_off(room: Room) -> None:
    folder, calibration, scene = room
    cells = np.ones((*calibration.canvas.shape(LOOP_SIZE), 3))
    cells += 0.06 * np.sin(np.linspace(0, 9, LOOP_SIZE))[:, None]  # of brightness, along the walls
    wrong = with_gains(calibration, cells)
    save_calibration(wrong, folder / "calibrations" / "0002")
    done = CliRunner().invoke(app, ["refine", f"{folder}@2"])
    assert "calibrations/0003 written" in done.output, done.output
    refined = load_calibration(folder / "calibrations" / "0003")
    off = [_off(OnWalls.of(scene, each), "exact") for each in (calibration, wrong, refined)]
    assert off[1] > 3 * off[0]
    assert off[2] < 0.5 * off[1]
    use_calibration(folder, folder / "calibrations" / "0001")


@the_box
def test_a_projector_that_moved_is_measured_again(room: Room) -> None:
    folder, calibration, _ = room
    name, *_ = calibration.projectors
    turned = f'{{ kind = "turned", size = 0.3, projector = "{name}" }}'
    aged = f'{{ kind = "aged", size = 0.1, projector = "{name}" }}'
    drift = f"drifts = [{turned}, {aged}]"
    with rewritten(folder / "venue.toml", "^preset = .*", f'preset = "standard"\n{drift}'):
        scene = build_scene(load_venue(folder).backends["simulated"], folder)
        done = CliRunner().invoke(app, ["recalibrate", str(folder)])
    assert done.exit_code == 0, done.output
    assert f"{name} measured again" in done.output
    used = calibration_in_use(folder)
    before, after = (
        _off(OnWalls.of(scene, each), "exact") for each in (calibration, load_calibration(used))
    )
    assert after < 0.5 * before
    use_calibration(folder, folder / "calibrations" / "0001")


@pytest.mark.parametrize("command", ["state"])
def test_what_is_for_domes_only_says_so(room: Room, command: str) -> None:
    folder, _, _ = room
    assert "for domes" in refused(command, folder, *(["full"] if command == "state" else []))
