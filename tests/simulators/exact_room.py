"""A small dome whose bounces are known in closed form: for tests that are not about ray tracing."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import simulators.transport
from simulators.scene import SceneSize
from simulators.surface import Surface
from simulators.transport import Room

PANEL = (160, 100)
_trace = Room.trace
SIZE = SceneSize(projectors=2, projector_size=PANEL, camera_size=(200, 200), rays=64)


def _exact_room(surface: Surface, rays: int = 0) -> Room:
    """A black deck under a perfect sphere: E = a / A_s between all patches of the dome (eq. 7)."""
    tracer = simulators.transport.Tracer(surface)
    exchange = np.zeros((tracer.count, tracer.count))
    dome = slice(tracer.dome_count)
    exchange[dome, dome] = tracer.area_m2[dome] / (4 * np.pi * surface.preset.radius_m**2)
    albedo = np.full(tracer.count, surface.preset.albedo)
    return Room.painted(surface, exchange, tracer.area_m2, albedo)


@contextmanager
def coarse_rooms() -> Iterator[pytest.MonkeyPatch]:
    """Rooms of few patches, by rays."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulators.transport, "DOME_RINGS", 12)
        patch.setattr(simulators.transport, "DOME_SECTORS", 24)
        patch.setattr(Room, "trace", _trace)
        yield patch


@contextmanager
def exact_rooms() -> Iterator[None]:
    """Rooms of as few patches, in closed form."""
    with coarse_rooms() as patch:
        patch.setattr(Room, "trace", staticmethod(_exact_room))
        yield
