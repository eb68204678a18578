"""Spots in the scattered light of a screen, and edges of projectors' pictures that are too dark."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.edge_blend import edge_blend_notes
from procam.estimate.light.spots import hidden_notes, spot_notes

SIZE = 200


def view() -> ScreenView:
    """A dome as an orthographic camera sees it."""
    y, x = (np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2) / (SIZE / 2)
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    on_screen = z > 0.3
    camera = SimpleNamespace(name="zenith")
    direction = np.stack([x, y, z], axis=-1).astype(np.float32)
    return ScreenView(camera, direction, on_screen, np.where(on_screen, 1 / np.maximum(z, 0.3), 0))


def scattered(rng: np.random.Generator) -> np.ndarray:
    """Smooth light with 0.5 % of noise, and paint that is uneven by 5 %."""
    x, y, _ = np.moveaxis(view().direction, -1, 0)
    smooth = 0.05 + 0.01 * x - 0.02 * y + 0.01 * x * y
    smooth *= 1 + 0.05 * np.sin(9 * x) * np.sin(7 * y)
    light = smooth * (1 + 0.005 * rng.normal(size=smooth.shape))
    return (light[..., None] * np.ones(3)).astype(np.float32)


def test_uneven_paint_is_no_spot(rng: np.random.Generator) -> None:
    assert spot_notes(scattered(rng), view()) == []


@pytest.mark.parametrize(
    ("factor", "words"),
    [(0.8, "up to 2.% darker than around it on 0.3%"), (1.6, "up to 5.% brighter .+ on 0.2%")],
)
def test_a_spot_is_named_with_its_place(
    rng: np.random.Generator, factor: float, words: str
) -> None:
    light = scattered(rng)
    light[120:129, 80:89] *= factor
    (note,) = spot_notes(light, view())
    assert "near pixel (84, 124) of camera zenith" in str(note)
    assert re.search(words, str(note)), note


def test_the_rim_and_a_grain_are_no_spots(rng: np.random.Generator) -> None:
    light, seen = scattered(rng), view()
    edge = seen.on_screen & (seen.direction[..., 2] < 0.33)
    light[edge] *= 0.5
    light[100, 100:103] *= 0.3
    assert spot_notes(light, seen) == []
    nothing = replace(seen, on_screen=np.zeros_like(seen.on_screen))
    assert spot_notes(light, nothing) == []


class TestHidden:
    """A person in a projector's picture, whose place shows a hundredth of its light."""

    @staticmethod
    def notes(size: int, light: float) -> list[str]:
        hidden = np.zeros((SIZE, SIZE), bool)
        hidden[100 : 100 + size, 80 : 80 + size] = True
        white = np.ones((SIZE, SIZE, 3), np.float32)
        white[hidden] = light
        return hidden_notes("south", white, hidden, view())

    def test_a_person_is_named_with_the_place(self) -> None:
        (note,) = self.notes(15, 0.01)
        assert str(note).startswith(
            "projector south: 0.2% of the screen is too dark within its picture"
        )
        assert "near pixel (87, 107) of camera zenith: something stood" in str(note)

    def test_a_grain_and_a_corner_that_fades_are_none(self) -> None:
        assert self.notes(8, 0.01) == [] and self.notes(15, 0.5) == []


def projector(
    light: np.ndarray, valid: np.ndarray | None = None, exponent: np.ndarray | None = None
) -> SimpleNamespace:
    """A projector whose pixels have light (H, W), spread over solid angles that differ."""
    height, width = light.shape
    solid = 1e-5 * (1 + np.linspace(0, 2, width)) * np.ones((height, 1))
    gain = (light / solid)[..., None] * np.ones(3)
    valid = np.ones(light.shape, bool) if valid is None else valid
    surface = SimpleNamespace(solid_angle_sr=solid, valid=valid)
    photometry = SimpleNamespace(gain=gain, exponent=exponent)
    return SimpleNamespace(surface=surface, photometry=photometry)


def lens(height: int = 100, width: int = 160) -> np.ndarray:
    """Light of a panel whose lens leaves half of it in the corners."""
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return 1 - 0.25 * (x**2 + y**2)


class TestEdgeBlend:
    def test_a_lens_and_a_plate_are_none(self) -> None:
        light = lens()
        valid = np.ones(light.shape, bool)
        valid[:30] = False
        light[:, :3] *= [0.3, 0.6, 0.9]  # as a lens blurs the edge
        light[:, 115:] *= np.linspace(
            1, 0.2, 45
        )  # and the rim of the dome, beyond which is nothing
        valid[:, 140:] = False
        assert edge_blend_notes({"a": projector(light, valid)}) == []

    @pytest.mark.parametrize("width", [10, 16, 40])
    def test_a_ramp_is_named_with_its_side(self, width: int) -> None:
        ramp = np.clip((np.arange(160) + 0.5) / width, 0, 1)
        (note,) = edge_blend_notes({"a": projector(lens() * ramp[::-1])})
        assert str(note).startswith("projector a: its pixels get darker") and "(right)" in str(note)

    def test_a_hot_spot_is_none(self) -> None:
        y, x = np.mgrid[-1:1:100j, -1:1:160j] * np.array([100, 160])[:, None, None]
        hot_spot = 15.0 ** -((x**2 + y**2) / (100**2 + 160**2))
        assert edge_blend_notes({"a": projector(lens() * hot_spot)}) == []

    def test_the_blend_of_a_media_server_stays_on(self) -> None:
        ramp = np.clip((np.arange(160) + 0.5) / 16, 0, 1)
        assert edge_blend_notes({"a": projector(lens() * ramp, None, np.ones(1))}) == []

    def test_both_ways_up(self) -> None:
        ramp = np.clip((np.arange(100) + 0.5) / 12, 0, 1)[:, None]
        (note,) = edge_blend_notes({"a": projector(lens() * ramp * ramp[::-1])})
        assert "(top, bottom)" in str(note)

    def test_a_projector_that_lights_nothing(self) -> None:
        nothing = np.zeros((100, 160), bool)
        assert edge_blend_notes({"a": projector(lens(), nothing)}) == []
