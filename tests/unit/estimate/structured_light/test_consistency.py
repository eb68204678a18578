"""The score of an order of photographs, on ideal photographs of a plane."""

import numpy as np
import pytest

from procam.estimate.structured_light.codes import CODES, Code, generate, make_code
from procam.estimate.structured_light.consistency import OrderConsistency, probe_places

SIZE = (160, 100)


def scored(code: Code) -> tuple[OrderConsistency, list[int | None]]:
    """The panel seen 1:1 in 12 bits."""
    places = probe_places((SIZE[1], SIZE[0]))
    rng = np.random.default_rng(2)
    probes = []
    for pattern in generate(code):
        light = 40 + 3000 * (pattern[..., 0] / 255.0) ** 2.2
        counts = np.rint(light + rng.normal(0, 5, light.shape))
        probes.append(counts.astype(np.float32)[places])
    return OrderConsistency(code, probes), list(range(len(probes)))


@pytest.mark.parametrize("name", CODES)
def test_the_right_order_is_consistent_and_others_are_less(name: str) -> None:
    consistency, order = scored(make_code(name, SIZE))
    assert consistency.of(order) > 1.6
    exchanged = [order[i] for i in [0, 1, 2, 5, 4, 3, *range(6, len(order))]]
    assert consistency.along(exchanged, "x") < 0.7 * consistency.along(order, "x")
    assert consistency.along(exchanged, "y") == consistency.along(order, "y")
    gap = [None if i == 4 else photo for i, photo in enumerate(order)]
    assert consistency.along(gap, "x") > 0.8 * consistency.along(order, "x")


def test_without_white_or_black_nothing_is_consistent() -> None:
    consistency, order = scored(make_code("gray", SIZE))
    assert consistency.of([None, *order[1:]]) == consistency.of([0, None, *order[2:]]) == 0


def test_probes_are_spread_over_the_picture() -> None:
    for shape in ((500, 500), (60, 80), (3000, 4000), (12, 30)):
        rows, columns = probe_places(shape)
        assert rows.shape == columns.shape and rows.shape[1] == 3
        assert rows.min() >= 0 and rows.max() < shape[0]
        assert columns.min() >= 0 and columns.max() < shape[1]
        assert len(rows) <= 40_000 and np.ptp(rows) > 0.7 * shape[0]
