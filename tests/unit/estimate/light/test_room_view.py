"""Light of a room's faces in a camera's picture, and scattered light of stripes beside a wall."""

from dataclasses import dataclass

import numpy as np
import pytest

import procam.model.screen
from procam.estimate.light.picture_flux import RoomFlux, picture_flux
from procam.estimate.light.room_view import RoomView
from procam.maths.mesh.bounces import settled
from procam.maths.mesh.canvas import MeshCanvas
from procam.model.screen import RoomScreen

ALBEDO, OTHERS = 0.6, 0.3
PIXELS = 480  # along the horizon
STRIPE_M = 0.6


@dataclass
class AllAround:
    """A camera in the middle that sees every direction, but not what is `hidden` (H, W)."""

    direction: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, screen: RoomScreen) -> "AllAround":
        azimuth = np.linspace(np.pi, -np.pi, PIXELS, endpoint=False) + 1e-3
        polar = (np.arange(PIXELS // 2) + 0.5) / (PIXELS // 2) * np.pi
        up, around = np.meshgrid(polar, azimuth, indexing="ij")
        flat = np.stack([np.cos(around), np.sin(around)], axis=-1) * np.sin(up)[..., None]
        direction = np.concatenate([flat, np.cos(up)[..., None]], axis=-1)
        points = screen.shape.radius_at(direction.reshape(-1, 3)).reshape(up.shape)
        return cls(direction, points**2 * np.sin(up) * (np.pi / (PIXELS // 2)) ** 2)

    def faces(self, screen: RoomScreen) -> MeshCanvas:
        return screen.canvas.photograph(self.direction, self.weight)


@pytest.fixture(scope="module")
def screen() -> RoomScreen:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(procam.model.screen, "FACES", 3000)
        room = RoomScreen(
            "box",
            (4.0, 4.0, 3.0),
            ("front", "left"),
            tuple((name, OTHERS, 0.05) for name in ("right", "back", "floor", "ceiling")),
        )
        assert len(room.room.faces) < 3500
    return room


def _picture(screen: RoomScreen, direct: np.ndarray) -> np.ndarray:
    """Light (F, 3) that leaves the walls, of direct light (F,)."""
    lit = np.isin(np.arange(len(direct)), screen.canvas.lit_faces)
    albedo = np.where(lit, ALBEDO, OTHERS)[:, None] * np.ones(3)
    light = direct[:, None] * np.ones(3)
    return light + albedo * settled(screen.factors, albedo, light)


def test_scattered_light_of_stripes_differs_beside_another_wall(screen: RoomScreen) -> None:
    """Light of half a wall's stripes, which ends in the corner bright or dark, against that of white."""
    view, room = AllAround.of(screen), screen.room
    faces, middle = view.faces(screen), room.vertices[room.faces].mean(axis=1)
    front = room.part == room.names.index("front")
    bright = front & (np.floor((2.0 - middle[:, 1]) / STRIPE_M) % 2 == 0)
    pictures = [_picture(screen, on.astype(float)) for on in (front, bright, front & ~bright)]
    photographs = [p[faces.face].astype(np.float32) for p in pictures]
    flux = picture_flux(screen, view, photographs[0])  # type: ignore[arg-type]
    assert isinstance(flux, RoomFlux)
    shares = [flux.share(p)[..., 1] for p in photographs[1:]]
    np.testing.assert_allclose(shares[0] + shares[1], 1, atol=1e-3)
    left = room.part == room.names.index("left")
    white, striped = (screen.factors.gather(p)[:, 1] for p in pictures[:2])
    near = left & (middle[:, 0] > 1.6)  # beside the front wall, whose stripe there is bright
    area = screen.factors.area[near]
    true = float(area @ striped[near] / (area @ white[near]))
    assert true > 0.6
    there = np.isin(faces.face, np.flatnonzero(near))
    arriving = view.weight * faces.field(white[:, None])[..., 0]
    found = float(np.average(shares[0][there], weights=arriving[there]))
    assert found == pytest.approx(true, rel=0.03)
    by_flux = flux.total(photographs[1])[1] / flux.total(photographs[0])[1]
    assert abs(by_flux / true - 1) > 0.1


def test_hidden_faces_of_lit_walls_count_with_their_neighbours(screen: RoomScreen) -> None:
    view, room = AllAround.of(screen), screen.room
    direct = np.isin(np.arange(len(room.faces)), screen.canvas.lit_faces).astype(float)
    faces = view.faces(screen)
    photograph = _picture(screen, direct)[faces.face].astype(np.float32)
    whole = RoomView(screen, view).irradiance(photograph)  # type: ignore[arg-type]
    middle = room.vertices[room.faces].mean(axis=1)
    hidden = (room.part == room.names.index("left")) & (middle[:, 0] < -1.5)
    view.weight[np.isin(faces.face, np.flatnonzero(hidden))] = 0
    seen = RoomView(screen, view)  # type: ignore[arg-type]
    assert not seen.known[hidden].any() and seen.known[~hidden].all()
    np.testing.assert_allclose(seen.irradiance(photograph), whole, rtol=0.02)


def test_where_nothing_comes_back_shares_are_finite(screen: RoomScreen) -> None:
    """A camera that sees one wall, and all others black: no light arrives at what it sees."""
    black = screen.with_others(tuple((name, 0.0, 0.01) for name, _, _ in screen.others))
    view, room = AllAround.of(black), black.room
    face = view.faces(black).face
    view.weight[(room.part != room.names.index("front"))[face]] = 0
    white = np.where((view.weight > 0)[..., None], 0.5, 0).astype(np.float32) * np.ones(3)
    flux = picture_flux(black, view, white.astype(np.float32))  # type: ignore[arg-type]
    share = flux.share((white / 2).astype(np.float32))
    assert np.isfinite(share).all() and np.isfinite(flux.pattern).all()
    assert (np.asarray(flux.pattern) > 0).all()
