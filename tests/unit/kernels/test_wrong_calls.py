"""Kernels with wrong arguments: a part of `studies/wrong_calls.py`, in this process."""

import numpy as np
import pytest

from procam import kernels
from procam.errors import InputError, ShapeError
from studies.wrong_calls import KERNELS, wrong_calls

CASES = 150


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", KERNELS)
def test_wrong_arguments_are_refused_or_read_as_by_numpy(name: str) -> None:
    found = wrong_calls(name, range(CASES))
    assert found.keys() <= {"refused", "same", "Python's", "refused by NumPy alone"}, found
    assert found["refused"] > CASES / 4 and found["same"] > CASES / 10


class TestRays:
    lens = np.array([100.0, 100, 320, 240, 0, 0, 0, 0])

    @pytest.mark.parametrize("shape", [(3,), (4, 3), (5,), ()])
    def test_pixels_are_pairs(self, shape: tuple[int, ...]) -> None:
        with pytest.raises(ShapeError, match="pixels has shape"):
            kernels.fisheye_rays(np.zeros(shape), self.lens)

    @pytest.mark.parametrize("count", [0, 7, 9])
    def test_a_lens_has_eight_numbers(self, count: int) -> None:
        with pytest.raises(ShapeError, match="lens has shape"):
            kernels.fisheye_rays(np.zeros((3, 2)), np.ones(count))

    @pytest.mark.parametrize(
        ("place", "value", "words"),
        [
            (0, 0.0, "focal lengths not 0"),
            (5, np.nan, "must be finite"),
            (4, -1e9, "folds at its centre"),
        ],
    )
    def test_lenses_without_rays(self, place: int, value: float, words: str) -> None:
        lens = self.lens.copy()
        lens[place] = value
        with pytest.raises(InputError, match=words):
            kernels.fisheye_rays(np.zeros((3, 2)), lens)

    def test_complex_numbers(self) -> None:
        with pytest.raises(InputError, match="complex128 is no type of real numbers"):
            kernels.fisheye_rays(np.zeros((3, 2), complex), self.lens)
