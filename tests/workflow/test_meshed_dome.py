"""A sphere as a mesh gives what the dome gives, from the same photographs."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from mesh_shapes import hemisphere
from scipy.ndimage import binary_erosion
from typer.testing import CliRunner

from procam.arrays import Array
from procam.compensate.any_screen import compensator_for
from procam.files.calibration import load_calibration
from procam.interfaces.cli.main import app
from procam.maths.geometry.canvas import STANDARD
from procam.maths.geometry.sphere import direction_from_angles, normalise
from procam.model.calibration import Calibration
from simulators.placement import place_cameras
from simulators.presets import IDEAL
from simulators.scene import SceneSize
from simulators.template import venue_text

SIZE = SceneSize(2, (320, 200), 1, (600, 600), rays=512, map_size=256)
STEPS = 40  # of the hemisphere: 6,400 faces of 2 degrees
MARKS_DEG = ((12, 35), (130, 30), (-110, 50), (175, 40), (40, 75), (-60, 25))
EDGE_PX = 4  # of the canvas, beside what is lit in part
MESH = f"""\
[screen]
kind = "mesh"
file = "dome.obj"
lit = ["dome"]
canvas = [256, 256]
smooth = true
map_size = {SIZE.map_size}

"""


def write_obj(path: Path) -> None:
    vertices, faces = hemisphere(IDEAL.radius_m, STEPS)
    pixel = STANDARD.pixels(normalise(vertices), 256)
    u, v = ((pixel + 0.5) / 256).T
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices]
    lines += [f"vt {a:.9f} {1 - b:.9f}" for a, b in zip(u, v, strict=True)]
    lines += ["g dome", *(f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in faces + 1)]
    path.write_text("\n".join(lines), "utf-8")


def marks() -> str:
    """Exact ones, by their coordinates."""
    (camera,) = place_cameras(1, SIZE.camera_size, SIZE.camera_kind, IDEAL)
    found = []
    for number, angles in enumerate(MARKS_DEG):
        point = IDEAL.radius_m * direction_from_angles(*np.radians(angles))
        pixel = camera.pixels(camera.camera_from_dome.apply(point))
        found.append(
            f'[[fiducials]]\nname = "mark {number}"\npoint_m = {np.round(point, 6).tolist()}\n'
            f'sigma_m = 0.001\ncamera = "{camera.name}"\npixel = {np.round(pixel, 3).tolist()}\n'
            "sigma_px = 0.01\n\n"
        )
    return "".join(found)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Calibration, Calibration]:
    """Calibrations as a dome and as a mesh."""
    folder, run = tmp_path_factory.mktemp("rooms"), CliRunner()
    dome, mesh = folder / "dome", folder / "mesh"
    dome.mkdir()
    text = venue_text("ideal", SIZE)
    (dome / "venue.toml").write_text(text, "utf-8")
    done = run.invoke(app, ["calibrate", str(dome)])
    assert done.exit_code == 0, done.output
    shutil.copytree(dome / "sessions", mesh / "sessions")
    write_obj(mesh / "dome.obj")
    text = re.sub(r"\[screen\].*?(?=\[cameras)", MESH, text, flags=re.DOTALL)
    text = re.sub(r"\[\[fiducials\]\].*?(?=\[capture\])", marks(), text, flags=re.DOTALL)
    for place in (mesh, mesh / "sessions" / "0001"):
        (place / "venue.toml").write_text(text, "utf-8")
    done = run.invoke(app, ["session", "solve", str(mesh)])
    assert done.exit_code == 0, done.output
    one, other = (load_calibration(each / "calibrations" / "0001") for each in (dome, mesh))
    return one, other


def test_light_that_bounces_is_the_same(both: tuple[Calibration, Calibration]) -> None:
    dome, mesh = both
    np.testing.assert_allclose(mesh.feedback.value, dome.feedback.value, rtol=2e-3)
    assert mesh.screen.moved == ()  # type: ignore[union-attr]


def test_pixels_land_in_the_same_directions(both: tuple[Calibration, Calibration]) -> None:
    dome, mesh = both
    for name, projector in dome.projectors.items():
        here, there = projector.surface, mesh.projectors[name].surface
        lit = here.valid & there.valid
        assert lit.sum() > 0.99 * here.valid.sum()
        off = np.linalg.norm(here.direction[lit] - there.direction[lit], axis=-1)
        assert np.degrees(np.sqrt(np.mean(off**2))) * 60 < 0.2
        area = here.solid_angle_sr[lit] * IDEAL.radius_m**2
        assert np.median(there.solid_angle_sr[lit] / area) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("kind", ["even", "half"])
def test_compensated_frames_are_the_same(both: tuple[Calibration, Calibration], kind: str) -> None:
    size = SIZE.map_size or 0
    content = np.full((size, size, 3), 0.4, np.float32)
    if kind == "half":
        content[:, size // 2 :] = 0
    one, other = (frame(each, content) for each in both)
    lit = np.minimum(*(each.maps.coverage for each in both)) > 0.999
    lit = binary_erosion(lit, iterations=EDGE_PX)
    assert np.abs(one - content)[lit].mean() > 0.01  # compensated at all
    off = np.abs(other - one)[lit]
    assert np.quantile(off, 0.99) < 1e-3
    assert off.max() < 2e-3  # beside the rim, at so few pixels


def frame(calibration: Calibration, content: Array) -> Array:
    """Direct light (N, N, 3) by the exact method."""
    compensator = compensator_for(calibration)(calibration, len(content), "exact")
    return np.asarray(compensator.frame(content))
