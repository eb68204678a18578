"""Patches found in photographs of a camera on its side, and their light."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.errors import NotEnoughData
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.projector_tests.patches import Patches, find_patches
from procam.estimate.projector_tests.patterns import COUNT, PatchLayout

LAYOUT = PatchLayout((128, 80))
QUIET = NoiseLaw(1e-6, 0.0)


class TestPatches:
    SCALE = 4

    def photograph(self, picture: np.ndarray) -> np.ndarray:
        """A camera on its side, with falloff, paint and scattered light."""
        rows, columns = np.indices((128 * self.SCALE, 80 * self.SCALE))
        paint = 1 + 0.2 * np.sin(rows / 40) * np.cos(columns / 30)
        light = np.kron(picture[..., 0].T[:, ::-1], np.ones((self.SCALE, self.SCALE)))
        return paint * (1000 * gaussian_filter(light, 3.0) + 600 * picture.mean() + 5)

    def found(self, hidden: slice = slice(0)) -> Patches:
        def taken(picture: np.ndarray) -> np.ndarray:
            image = self.photograph(picture)
            image[hidden] = 5
            return image

        first, second = LAYOUT.pair()
        white, black = np.ones_like(first), np.zeros_like(first)
        span = taken(white) - taken(black)
        bits = [taken(LAYOUT.bit(bit)) for bit in (1, 2)]
        return find_patches((taken(first), taken(second)), bits, span, QUIET, LAYOUT)

    def test_each_is_found_well_inside(self) -> None:
        patches = self.found()
        truth = self.photograph_of_numbers()
        inside = patches.place >= 0
        assert np.array_equal(patches.place[inside], truth[inside])
        counts = np.bincount(patches.place[inside], minlength=COUNT)
        inner_px = (LAYOUT.side_px - 6) * self.SCALE
        assert counts == pytest.approx(np.full(COUNT, inner_px**2), rel=0.25)
        assert patches.camera_px == pytest.approx(np.full(COUNT, self.SCALE), rel=0.05)
        assert patches.scale == pytest.approx(patches.largest_px, rel=0.02)

    def photograph_of_numbers(self) -> np.ndarray:
        numbers = LAYOUT.picture(np.arange(1, COUNT + 1))[..., 0].T[:, ::-1]
        return np.kron(numbers, np.ones((self.SCALE, self.SCALE))).astype(int) - 1

    def test_a_hidden_patch_is_left_out(self) -> None:
        patches = self.found(slice(90 * self.SCALE, 120 * self.SCALE))
        seen = np.isfinite(patches.camera_px)
        assert seen.tolist() == [True, True, True, False] * 2
        light = patches.read(np.ones((*patches.place.shape, 3)), NoiseLaw(0.5, 0.5))
        assert np.array_equal(np.isfinite(light.mean[:, 0]), seen)
        count = (patches.place == 0).sum()
        assert light.variance[0] == pytest.approx(np.full(3, 1 / count))

    def test_few_are_refused(self) -> None:
        with pytest.raises(NotEnoughData, match=r"the camera sees 4 of 8 well and needs 6"):
            self.found(slice(60 * self.SCALE, None))

    def test_a_dark_photograph_is_refused(self) -> None:
        dark = np.zeros((60, 90))
        with pytest.raises(NotEnoughData, match="sees 0 of 8"):
            find_patches((dark, dark), (dark, dark), dark, QUIET, LAYOUT)
