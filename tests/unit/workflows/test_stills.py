"""Test pictures for the eye: what is on them, and what is written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.errors import InputError
from procam.files.images.pixels import read_image
from procam.generators import result_of
from procam.maths.geometry.sphere import direction_from_angles, master_pixels
from procam.model.calibration import Calibration
from procam.workflows.stills import INK, STILLS, grid, ramp, soft_checker, write_stills

SIZE = 512


def _at(picture: np.ndarray, azimuth_deg: float, elevation_deg: float) -> float:
    """Green light of the pixel in a direction."""
    angles = np.radians([azimuth_deg, elevation_deg])
    x, y = master_pixels(direction_from_angles(*angles), len(picture)).round().astype(int)
    return float(picture[y, x, 1])


@pytest.mark.parametrize("name", STILLS)
def test_each_is_light_that_a_dome_can_be_asked_for(name: str) -> None:
    draw, text = STILLS[name]
    picture = draw(96)
    assert picture.shape == (96, 96, 3) and picture.dtype == np.float32
    assert 0 <= picture.min() and picture.max() <= 1 and text.endswith(".")
    assert not picture[0, 0].any()


class TestGrid:
    @pytest.mark.parametrize("place", [(0, 50), (45, 50), (15, 37), (7, 30), (-100, 45), (0, 90)])
    def test_lines_are_at_multiples_of_15_degrees(self, place: tuple[float, float]) -> None:
        assert _at(grid(SIZE), *place) == pytest.approx(INK)

    @pytest.mark.parametrize("place", [(7, 37), (52, 52), (15, 82)])
    def test_there_is_nothing_between(self, place: tuple[float, float]) -> None:
        assert _at(grid(SIZE), *place) < INK / 2

    def test_numbers_read_from_left_to_right_on_their_azimuth(self) -> None:
        """Beside a digit 1 of 120: its upper right dot is dark, that of the 2 is lit; left is + azimuth."""
        picture, height, dot = grid(2 * SIZE), 15 + 4 * 0.9, 0.9
        aside = dot / np.cos(np.radians(height + 2 * dot))
        row = [_at(picture, 120 - k * aside, height + 2 * dot) > INK / 2 for k in range(-5, 6)]
        expected = "010" + "0" + "111" + "0" + "111"  # tops of 1, 2 and 0
        assert "".join("01"[lit] for lit in row) == expected


def test_the_ramp_has_sixteen_equal_steps_on_both_sides() -> None:
    picture = ramp(SIZE)
    left = [_at(picture, (k + 0.5) * 180 / 16, 40) for k in range(16)]
    right = [_at(picture, -(k + 0.5) * 180 / 16, 40) for k in range(16)]
    assert left == right and left[0] == 0 and left[-1] == 1
    assert (np.diff(left) > 0).all()


def test_the_checker_has_soft_edges() -> None:
    row = soft_checker(SIZE)[SIZE // 2 + 20, 60:-60, 1]
    assert np.abs(np.diff(row)).max() < 0.1 and row.max() - row.min() > 0.3


class TestFiles:
    def test_dome_masters_and_frames_with_an_index(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        result_of(write_stills(calibration, tmp_path, 96))
        hows = ("uncompensated", "compensated")
        names = [f"{name}.{how}.png" for name in STILLS for how in hows]
        folders = ("dome-masters", *calibration.projectors)
        expected = {str(tmp_path / folder / name) for folder in folders for name in names}
        assert expected == {str(p) for p in tmp_path.rglob("*.png")}
        index = (tmp_path / "index.txt").read_text()
        assert all(f"\n{name}\n  " in index for name in STILLS) and "south/" in index

    def test_compensation_takes_light_out(self, tmp_path: Path, calibration: Calibration) -> None:
        list(write_stills(calibration, tmp_path, 96))
        folder = tmp_path / "dome-masters"
        plain, ours = (
            read_image(folder / f"checker.{how}.png").astype(int)
            for how in ("uncompensated", "compensated")
        )
        assert plain.dtype == ours.dtype and plain[48, 48].min() > ours[48, 48].max() > 0
        frames = [read_image(tmp_path / n / "white.compensated.png") for n in ("south", "north")]
        assert [f.shape for f in frames] == [(30, 48, 3)] * 2 and all(f.any() for f in frames)

    def test_without_projectors_there_are_dome_masters_only(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        list(write_stills(replace(calibration, projectors={}), tmp_path, 96))
        assert {p.name for p in tmp_path.iterdir()} == {"dome-masters", "index.txt"}

    def test_without_photometry_nothing_is_written(
        self, tmp_path: Path, calibration: Calibration
    ) -> None:
        maps = replace(calibration.maps, hi=np.zeros_like(calibration.maps.hi))
        with pytest.raises(InputError, match="no photometry"):
            list(write_stills(replace(calibration, maps=maps), tmp_path, 96))
        assert list(tmp_path.iterdir()) == []
