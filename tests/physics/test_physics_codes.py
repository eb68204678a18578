"""Codes in a room that scatters light, against the simulator's truth: small cousins of studies/.

`python -m studies codes code-table one-fringe` asks the same at full size.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from procam.estimate.structured_light.codes import CODES, make_code
from procam.estimate.structured_light.scatter_bias import (
    flux_share_maps,
    remove_phasor,
)
from procam.maths.warp import grow
from simulators import transport
from simulators.photograph_bench import PhotographBench
from simulators.presets import STANDARD
from simulators.scene import DomeScene, SceneSize
from studies import code_table, codes, one_fringe
from studies.measure import Errors, Shots, patch_errors

PANEL = (960, 600)
HALF_BLUR_PX = 1.5  # periods are half as long as on a panel of full size


@pytest.fixture(scope="module", autouse=True)
def coarse_rooms() -> Iterator[None]:
    """Rooms of a quarter of the patches: scattered light is as smooth as before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transport, "DOME_RINGS", 15)
        patch.setattr(transport, "DOME_SECTORS", 30)
        yield


@pytest.fixture(scope="module")
def shots() -> Shots:
    # 1024 rays: below, the room's own noise is no longer small beside a patch's error
    size = SceneSize(1, PANEL, 1, (560, 560), rays=1024)
    preset = STANDARD.altered(albedo=0.6, snr=50.0, defocus_px=HALF_BLUR_PX)
    return Shots(
        PhotographBench(DomeScene(preset, size, 1), "south"), make_code("micro-phase", PANEL)
    )


@pytest.fixture(scope="module")
def cell() -> Callable[..., code_table.Row]:
    scene = DomeScene(STANDARD, SceneSize(1, (320, 200), 1, (256, 256), rays=64), 1)

    def measure(name: str, snr: float, **overrides: float) -> code_table.Row:
        bench = PhotographBench(scene.altered(**overrides), "south")
        return code_table.cell(Shots(bench, make_code(name, (320, 200))), snr, 1)

    return measure


@pytest.fixture(scope="module")
def fringe() -> one_fringe.OneFringe:
    size = SceneSize(1, (480, 300), 1, (480, 480), rays=4096)
    return one_fringe.OneFringe(one_fringe.ROOMS["black level deck"], size)


class TestDefaultCode:
    def test_meets_its_goals(self, shots: Shots) -> None:
        figures = codes.figures_of(shots, shots.decode([1]))
        names = [n for n in codes.GOALS if "patch_chi2" not in n]
        missed = {n: figures[n] for n in names if not codes.meets(n, figures[n])}
        assert not missed
        assert all(0.9 < figures[f"pixel_chi2_{axis}"] < 1.1 for axis in "xy")

    def test_a_patch_is_as_good_as_it_says(self, shots: Shots) -> None:
        """At a low SNR: what all patches share, 0.003 px of it, is no part of their sigma."""
        misses = Errors(shots.decode([2], snr=15.0).map, shots.truth)
        error, sigma = patch_errors(misses, PANEL)
        assert len(error) >= 800
        assert np.mean((error / sigma) ** 2) == pytest.approx(1.0, abs=0.1)


class TestEveryCode:
    @pytest.mark.parametrize("name", CODES)
    def test_is_usable_in_good_light(self, cell: Callable[..., code_table.Row], name: str) -> None:
        row = cell(name, 50.0, albedo=0.6, defocus_px=0.0)
        assert "error" not in row, row
        assert row["coverage"] > 0.85, row  # type: ignore[operator]
        assert row["misread"] <= code_table.USABLE_MISREAD, row  # type: ignore[operator]

    def test_waves_outlive_blur_that_ends_stripes(
        self, cell: Callable[..., code_table.Row]
    ) -> None:
        waves, stripes = (
            cell(name, 50.0, albedo=0.6, defocus_px=3.0) for name in ("micro-phase", "gray")
        )
        assert code_table.usable(waves), waves
        assert not code_table.usable(stripes), stripes


class TestOneFringe:
    def test_unlit_pixels_tell_the_bias(self, fringe: one_fringe.OneFringe) -> None:
        direct = fringe.direct_places()
        counts = fringe.photograph(None)
        biased, mended = (
            [fringe.judge(fringe.found(counts, m), direct, i)["bias_rms_px"] for i in range(2)]
            for m in ("none", "unlit")
        )
        assert min(biased) > 10.0
        assert max(mended) < 0.25  # of which this room's few rays make 0.1 to 0.2

    def test_shares_are_those_of_the_flux(self, fringe: one_fringe.OneFringe) -> None:
        counts = fringe.photograph(200.0)
        frames = np.stack(counts[2:]).astype(np.float32)
        near = grow(fringe.lit, one_fringe.AWAY_PX)
        shares = one_fringe.flux_shares(frames, counts[0], counts[1], near)
        # glare and the rays' noise: a thousandth of the flux
        np.testing.assert_allclose(shares, fringe.true_shares(), atol=1e-3)
        maps = flux_share_maps(frames, counts[0], counts[1], near)
        np.testing.assert_allclose(maps[:, fringe.lit].mean(axis=1), shares, atol=2e-3)

    def test_balanced_pictures_are_left_alone(self) -> None:
        frames = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
        scattered = np.full((3, 4), 5.0, np.float32)
        np.testing.assert_array_equal(remove_phasor(frames, np.full(2, 0.5), scattered), frames)
