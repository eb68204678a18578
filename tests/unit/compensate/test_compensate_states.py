"""The compensator in a venue state, against light solved patch by patch.

The room: a sphere's cap, in which every patch lights every other with a_j / 4 pi (paper eq. 7), a dense
matrix here. Its lit part is what the calibration knows; the rim below reflects and is never lit. People
come in: the rim reflects more. Lamps shine on the screen.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tolerances import FLOAT32

from procam.compensate.compensator import Compensator
from procam.errors import InputError
from procam.maths.geometry.sphere import master_directions, master_solid_angles
from procam.model.calibration import Calibration
from procam.model.transport import Measured
from procam.model.venue_state import VenueState

SIZE = 32
ALBEDO, EMPTY, FULL = 0.5, 0.1, 0.6  # of the dome; of the rim, empty and full
EXACT = 1e-6  # the goal for unclipped pixels


@dataclass(frozen=True)
class Room:
    """Patches inside the circle of the dome master; `lit` (N,) among them."""

    solid: np.ndarray
    lit: np.ndarray
    inside: np.ndarray
    rim: float

    def total(self, first: np.ndarray) -> np.ndarray:
        """Light (N, C) after all bounces, of the light that patches emit first (N, C)."""
        albedo = np.where(self.lit, ALBEDO, self.rim)
        system = np.eye(len(albedo)) - albedo[:, None] * self.solid[None, :] / (4 * np.pi)
        return np.linalg.solve(system, first)

    def patches(self, picture: np.ndarray) -> np.ndarray:
        return picture[self.inside].astype(float)


def _room(rim: float) -> Room:
    direction, inside = master_directions(SIZE)
    lit = direction[inside][:, 2] > np.sin(np.radians(15.0))
    return Room(master_solid_angles(SIZE)[inside], lit, inside, rim)


def _lamps() -> np.ndarray:
    """Irradiance by lamps at the rim on the screen and the rim before any bounce (N, 3)."""
    direction, inside = master_directions(SIZE)
    near = np.exp(-6 * direction[inside][:, 2]) * (1 + 0.5 * direction[inside][:, 1])
    return near[:, None] * np.array([0.10, 0.06, 0.02])


@pytest.fixture(scope="module")
def known(make_calibration: Callable[..., Calibration]) -> Calibration:
    """The empty room as it would have been measured, and the full one as its state."""
    empty, full = _room(EMPTY), _room(FULL)
    scatter = [_scatter_per_flux(room) for room in (empty, full)]
    lamps = np.zeros((SIZE, SIZE, 3), np.float32)
    lamps[full.inside] = full.total(_lamps())
    made = make_calibration(size=SIZE)
    coverage = np.zeros((SIZE, SIZE), np.float32)
    coverage[empty.inside] = empty.lit
    flat = np.ones((SIZE, SIZE, 3), np.float32)
    maps = replace(
        made.maps,
        scatter_per_flux=scatter[0] * flat,
        lo=0.004 * flat,
        hi=1.5 * flat,
        coverage=coverage,
    )
    ratio = np.full(3, scatter[1] / scatter[0])
    m = Measured(ratio * made.feedback.value, made.feedback.sigma)
    state = VenueState("full", m, ratio, lamps)
    return replace(made, maps=maps, states={"full": state})


def _scatter_per_flux(room: Room) -> float:
    first = np.zeros((len(room.solid), 1))
    first[room.lit] = 1.0
    scattered = (room.total(first) - first)[room.lit, 0]
    assert np.ptp(scattered) < 1e-9  # on a sphere all get alike
    return float(scattered[0] / room.solid[room.lit].sum())


@pytest.fixture
def content(rng: np.random.Generator) -> np.ndarray:
    picture = rng.uniform(0.5, 0.9, (SIZE, SIZE, 3))
    picture[12:16, 8:20] = 0.0
    return picture.astype(np.float32)


class TestExact:
    def test_the_audience_sees_the_target_wherever_no_limit_holds(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        room = _room(FULL)
        found = Compensator(known, SIZE, state="full").predict(content)
        seen = room.total(room.patches(found.direct) + _lamps())
        free = room.patches(found.free).astype(bool)
        assert 0.9 < free[room.lit].mean() < 1
        np.testing.assert_allclose(seen[free], room.patches(content)[free], atol=EXACT)

    def test_what_it_predicts_is_what_is_seen(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        room = _room(FULL)
        for method in ("exact", "none"):
            found = Compensator(known, SIZE, method, "full").predict(content)  # type: ignore[arg-type]
            seen = room.total(room.patches(found.direct) + _lamps())
            observed = room.patches(found.observed)
            np.testing.assert_allclose(observed[room.lit], seen[room.lit], atol=EXACT)

    def test_black_stays_black_where_lamps_outshine_the_target(self, known: Calibration) -> None:
        black = np.zeros((SIZE, SIZE, 3), np.float32)
        found = Compensator(known, SIZE, state="full").predict(black)
        lit = known.maps.coverage > 0
        np.testing.assert_allclose(found.direct[lit], known.maps.lo[lit], rtol=FLOAT32)
        assert not found.free.any()

    def test_a_state_without_lamps_only_bounces_more(
        self, known: Calibration, content: np.ndarray
    ) -> None:
        dark = replace(known, states={"dark": replace(known.states["full"], ambient=None)})
        found = Compensator(dark, SIZE, state="dark").predict(content)
        room = _room(FULL)
        seen = room.total(room.patches(found.direct))
        free = room.patches(found.free).astype(bool)
        np.testing.assert_allclose(seen[free], room.patches(content)[free], atol=EXACT)


def test_an_unknown_state_is_refused(known: Calibration) -> None:
    with pytest.raises(InputError, match=r"venue state 'empty' was not measured .*: full"):
        Compensator(known, SIZE, state="empty")
