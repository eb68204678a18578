"""The simulated media server: its alignment, its soft edges, its input, and its template."""

import numpy as np
import pytest

from procam.errors import ShapeError, UnitError
from procam.files.venue.load import load_venue, template_text
from procam.maths.geometry.sphere import angle_between, master_directions, master_pixels
from procam.workflows.venue_rig import open_rig
from simulators.backend import build_scene, build_server
from simulators.backend import open_rig as open_backend
from simulators.scene import DomeScene, SceneSize
from simulators.server import ASSUMED_GAMMA, BITS, ERROR_ARCMIN, MediaServer
from simulators.template import server_text

SIZE, BINS = 256, 40
SETTINGS = {
    "preset": "standard",
    "projectors": 2,
    "projector_size": (160, 100),
    "camera_size": (64, 64),
    "rays": 64,
    "server": True,
    "server_size": SIZE,
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> DomeScene:
    return build_scene(SETTINGS, tmp_path_factory.mktemp("none"))


@pytest.fixture(scope="module")
def server(scene: DomeScene, tmp_path_factory: pytest.TempPathFactory) -> MediaServer:
    found = build_server(scene, SETTINGS, tmp_path_factory.mktemp("none"))
    assert found is not None
    return found


def test_the_committed_template_is_current() -> None:
    """Made by `python -m simulators.template server`."""
    assert template_text("simulated-server") == server_text()


def test_soft_edges_add_up_for_projectors_of_the_gamma_it_believes_in(
    scene: DomeScene, server: MediaServer
) -> None:
    frames = server.frames(np.ones((SIZE, SIZE, 3), np.float32))
    direction, _ = master_directions(BINS)
    total, seen = np.zeros((2, BINS, BINS))
    for name, light in scene.lights.items():
        weight = frames[name][..., 0] ** ASSUMED_GAMMA
        assert 0 <= weight.min() and weight.max() <= 1
        at = master_pixels(light.direction, BINS)[light.lit]
        column, row = np.rint(at).astype(int).T.clip(0, BINS - 1)
        sums, count = np.zeros((2, BINS, BINS))
        np.add.at(sums, (row, column), weight[light.lit])
        np.add.at(count, (row, column), 1)
        total += sums / np.maximum(count, 1)
        seen += count > 0
    inner = (seen == 2) & (np.degrees(np.arccos(direction[..., 2])) < 60)
    assert np.median(np.abs(total[inner] - 1)) < 0.01


def test_its_alignment_is_a_little_off(server: MediaServer) -> None:
    ideal, _ = master_directions(SIZE)
    direction, lands = server.pixel_directions()
    error = np.degrees(angle_between(direction[lands], ideal[lands])) * 60
    assert 0.5 * ERROR_ARCMIN < np.sqrt(np.mean(error**2)) < 1.5 * ERROR_ARCMIN
    assert error.max() < 5 * ERROR_ARCMIN
    rim = np.degrees(np.arcsin(ideal[lands][:, 2]))
    assert 5 < rim.min() < 7  # the plates


def test_masters_are_played_with_its_depth(server: MediaServer) -> None:
    step = 1 / (2**BITS - 1)
    near, same = (
        server.frames(np.full((SIZE, SIZE, 3), 0.5 + off, np.float32)) for off in (0.0, 0.3 * step)
    )
    for name in near:
        np.testing.assert_array_equal(near[name], same[name])


def test_the_rig_has_one_input_and_one_wire(tmp_path) -> None:
    rig = open_backend(SETTINGS, tmp_path)
    try:
        assert list(rig.projectors) == list(rig.ports) == ["server"]
        device = rig.projectors["server"]
        assert device.size == (SIZE, SIZE)
        with pytest.raises(ShapeError, match="master of the server"):
            device.show(np.zeros((SIZE, SIZE // 2, 3), np.float32))
        with pytest.raises(
            UnitError, match=r"master of the server is 0\.\.1\.5; it must be 0\.\.1"
        ):
            master = np.zeros((SIZE, SIZE, 3), np.float32)
            master[0, 0] = 1.5
            device.show(master)
    finally:
        for close in rig.closers:
            close()


def test_one_shutter_darkens_all_projectors(tmp_path) -> None:
    size = SceneSize(projector_size=(160, 100), camera_size=(64, 64), rays=64)
    (tmp_path / "venue.toml").write_text(server_text(size, 2 * SIZE), "utf-8")
    with open_rig(load_venue(tmp_path)) as rig:
        rig.start()
        dark = rig.cameras["zenith"].capture().counts.astype(float).mean()
        rig.light("server")
        lit_size = (2 * SIZE, 2 * SIZE, 3)
        rig.projectors["server"].show(np.ones(lit_size, np.float32))
        assert rig.cameras["zenith"].capture().counts.mean() > 3 * dark
        rig.darken("server")
        assert abs(rig.cameras["zenith"].capture().counts.mean() - dark) < 1
