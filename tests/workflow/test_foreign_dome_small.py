"""The study of a dome of another program's making, at a fraction of its size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.workflows.solve import geometry
from studies import foreign_bounces, foreign_dome, foreign_photographs, foreign_room

SMALL = foreign_photographs.Size((400, 250), 360, walks=256, rays=1024)
SHOWN = ("front", "left")  # of the three projectors
RECEIVERS, ELSEWHERE = (12, 30), 48  # of bounced light
make_projectors = foreign_room.make_projectors


def few_projectors(size: tuple[int, int], hot_spot: float) -> dict[str, foreign_room.Projector]:
    """Those of the study without the third."""
    every = make_projectors(size, hot_spot)
    return {name: every[name] for name in SHOWN}


def test_bounces_in_a_cap_of_one_paint(monkeypatch: pytest.MonkeyPatch) -> None:
    """From any place of a sphere, every other fills its share of the whole sphere."""
    paint = 0.6
    monkeypatch.setattr(foreign_bounces, "paint", lambda d: np.full(d.shape[:-1], paint))
    monkeypatch.setattr(foreign_bounces, "RECEIVERS", RECEIVERS)
    monkeypatch.setattr(foreign_bounces, "ELSEWHERE", 30)
    monkeypatch.setattr(foreign_bounces, "ALBEDOS", np.zeros(4))
    on_dome = RECEIVERS[0] * RECEIVERS[1]
    matrix = foreign_bounces.Bounces(512, 4096).matrix[:on_dome]
    share = (1 - np.cos(foreign_bounces.HALF_ANGLE)) / 2
    total = matrix.sum(axis=1)
    np.testing.assert_allclose(total.mean(), share / (1 - paint * share), rtol=2e-3)
    np.testing.assert_allclose(total[40:], total.mean(), rtol=0.02)


def test_rays_of_projector_and_camera_return() -> None:
    room_size = (320, 200)
    projector = foreign_room.make_projectors(room_size)["left"]
    pixel = np.array([[0.0, 0.0], [319, 199], [100, 50]])
    rays = projector.rays(pixel)
    points, kind = foreign_bounces.hit(np.broadcast_to(projector.place, rays.shape), rays)
    np.testing.assert_allclose(projector.pixels(points), pixel, atol=1e-6)
    assert (kind[2], np.linalg.norm(points[2])) == (0, pytest.approx(foreign_bounces.RADIUS))
    camera = foreign_room.make_camera(320)
    pixel = np.array([[100.0, 200.0], [250, 60]])
    rays = camera.rays(pixel)
    points, _ = foreign_bounces.hit(np.broadcast_to(camera.place, rays.shape), rays)
    np.testing.assert_allclose([camera.pixel_of(p) for p in points], pixel, atol=1e-4)


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        (foreign_photographs.RAW, SMALL),
        (foreign_photographs.JPEG, replace(SMALL, hot_spot=15)),
    ],
    ids=["raw", "jpeg"],
)
def test_a_foreign_dome_is_within_its_intervals(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: foreign_photographs.FileKind,
    size: foreign_photographs.Size,
) -> None:
    monkeypatch.setattr(foreign_bounces, "RECEIVERS", RECEIVERS)
    monkeypatch.setattr(foreign_bounces, "ELSEWHERE", ELSEWHERE)
    monkeypatch.setattr(foreign_room, "make_projectors", few_projectors)
    # the dome is no sphere; that causes of this are looked for is shown by test_diagnosis.py
    monkeypatch.setattr(geometry, "find_causes", lambda *_: [])
    monkeypatch.setattr(foreign_dome, "MASTER", 256)
    stage = foreign_photographs.Stage(size.room(), tmp_path / "stage", kind, map_size=256)
    stage.prepare()
    found = stage.calibrate(1, tmp_path)
    row = foreign_dome.Judge(stage.room).figures(found)
    for name in ("m", "albedo"):
        value, sigma, true = row[name]
        assert abs(value - true) < 2.5 * sigma and sigma < 0.06 * true
    assert row["m"][0] == pytest.approx(row["m"][2], rel=0.012)
    assert row["relative_arcmin"] < 1.2 and row["absolute_arcmin"] < 2 * row["stated_arcmin"]
    assert row["line"] < 0.01
    assert row["left_half-sky"] < 0.02 and row["left_texture"] < 0.02
    assert all("do not fit a sphere" in note for note in row["notes"])
    assert len(list(foreign_dome.table([row], 0.02))) == 10
