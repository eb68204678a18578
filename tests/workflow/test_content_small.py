"""The study of content at an eighth of its size: scattered light in the residual, and the rest."""

from typing import Any

import numpy as np
import pytest
from tiny_venue import TINY_PAIR

from procam.interfaces import judge
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from simulators import transport, truth
from simulators.presets import PRESETS, PresetName
from simulators.scene import ALL_BANDS, DomeScene, SceneSize
from studies import content
from studies.contents import CONTENTS, night

MASTER = 128
SMALL = SceneSize(
    projectors=2, projector_size=(160, 100), camera_size=(260, 260), rays=128, map_size=MASTER
)


@pytest.fixture(scope="module")
def rows() -> dict[str, dict[str, Any]]:
    with pytest.MonkeyPatch.context() as patch:
        for module in (truth, content):
            patch.setattr(module, "MASTER", MASTER)
        patch.setattr(judge, "PATCHES", MASTER // 4)
        found = content.study("standard", SMALL, ("left-right", "white"))
    return {row["content"]: row for row in found}


def test_hardly_any_scattered_light_remains(rows: dict[str, dict[str, Any]]) -> None:
    for row in rows.values():
        assert row["interreflection_left"] < 0.02
        assert row["picture_error_jnd"] < 0.5 * row["picture_error_jnd_before"]
    white = rows["white"]  # it has no edges to blur
    # the camera's falloff is known to 0.5 % at the rim, which gains follow
    assert white["scatter_left"] < min(0.025, 0.3 * white["paper_eq12"])


def test_matte_paint_has_no_view_dependence(rows: dict[str, dict[str, Any]]) -> None:
    for row in rows.values():
        assert row["from_camera"] == pytest.approx(row["scatter_left"], rel=1e-3)


@pytest.mark.parametrize(
    ("preset", "least", "most"), [("standard", 0, 1e-6), ("realistic", 0.01, 0.1)]
)
def test_gloss_depends_on_the_view(
    preset: PresetName, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name, size in (
        (transport, "DOME_RINGS", 6),
        (transport, "DOME_SECTORS", 12),
        (content, "MASTER", 64),
    ):
        monkeypatch.setattr(module, name, size)
    scene = DomeScene(PRESETS[preset], TINY_PAIR, 1)
    camera = next(iter(scene.cameras.values())).camera_from_dome.inverse().translation
    white = {name: np.ones_like(drive) for name, drive in scene.shown.items()}
    centre, aside = (
        scene.radiance_of_drives(
            content.sight_lines(scene, eye), white, dict.fromkeys(white, 1.0), ALL_BANDS, 0
        )
        for eye in (np.zeros(3), camera)
    )
    assert least <= np.std(centre - aside) / np.mean(centre) <= most


def test_the_table_has_a_line_for_every_content(rows: dict[str, dict[str, Any]]) -> None:
    missed = rows["white"] | {"interreflection_left": 0.021}
    lines = list(content.table([*rows.values(), missed]))
    assert len(lines) == 2 + 3
    assert "| 2.10% (missed) |" in lines[-1] and "missed" not in lines[-2]
    assert lines[2].startswith("| standard | left-right | ")


@pytest.mark.parametrize("name", CONTENTS)
def test_contents_are_valid_pictures(name: str) -> None:
    picture = CONTENTS[name](96)
    _, inside = master_directions(96)
    assert picture.dtype == np.float32 and picture.shape == (96, 96, 3)
    assert picture[inside].min() > 0 and picture.max() <= 1
    assert not picture[~inside].any()


def test_properties_of_the_contents() -> None:
    solid = master_solid_angles(96)
    left_right, room, white = (CONTENTS[n](96) for n in ("left-right", "interior", "white"))
    halves = [(solid[:, h, None] * left_right[:, h]).sum() for h in (slice(48), slice(48, None))]
    assert halves[0] > 1.8 * halves[1]
    assert room.max() == 1 and room[white[..., 0] > 0].min() < 0.06
    stars = night(512)
    assert np.median(stars[stars > 0]) < 0.05 and stars.max() > 0.8
