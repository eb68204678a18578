"""Maps reduced to observations: values that are not finite are ignored."""

import numpy as np
import pytest
from domes import SimulatedDome

from procam.errors import InputError
from procam.estimate.geometry.observations import gather_observations
from procam.estimate.geometry.solve import solve_geometry
from procam.model.correspondence import CorrespondenceMap

SIZE = (640, 400)


def _map() -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[:200, :300].astype(np.float32)
    return np.stack([x * 2 + 5, y * 2 + 7], axis=-1), np.full((200, 300, 2), 0.1, np.float32)


@pytest.mark.parametrize("part", ["places", "errors"])
def test_nan_is_ignored_also_where_the_map_marks_it_valid(part: str) -> None:
    xy, sigma = _map()
    whole = gather_observations(
        CorrespondenceMap(xy.copy(), sigma.copy(), np.ones((200, 300), bool)), SIZE
    )
    (xy if part == "places" else sigma)[50:60] = np.nan
    some = gather_observations(CorrespondenceMap(xy, sigma, np.ones((200, 300), bool)), SIZE)
    assert 0 < len(some.sigma_px) < len(whole.sigma_px)
    for values in (some.camera_px, some.projector_px, some.sigma_px):
        assert np.isfinite(values).all()


def test_an_empty_map_gives_no_observations() -> None:
    xy, sigma = _map()
    empty = gather_observations(
        CorrespondenceMap(xy * np.nan, sigma, np.ones((200, 300), bool)), SIZE
    )
    assert len(empty.sigma_px) == 0


def test_the_solver_names_the_camera_of_a_nan() -> None:
    dome = SimulatedDome.build(1, projectors=2, cameras=1)
    seen = dome.observations(64)
    seen["zenith", "north"].projector_px[[3, 5]] = np.nan
    with pytest.raises(InputError, match=r"2 of \d+ that zenith has of north are NaN or infinite"):
        solve_geometry(dome.problem(seen))
