"""What `procam compensate` would write over, and the pictures that explain."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tiny_venue import procam

from procam.compensate.compensator import Compensator
from procam.errors import InputError
from procam.files.images.layers import RGB
from procam.files.images.pixels import write_image
from procam.model.calibration import Calibration
from procam.model.mask import Mask
from procam.workflows.playout.compensate import refuse_overwriting
from procam.workflows.playout.explain import explain
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.sources import ClipFrame
from procam.workflows.sample_content import half_sky

SIZE = 48


def picture(path: Path) -> Path:
    write_image(path, np.full((SIZE, SIZE, 3), 99, np.uint8), RGB)
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def assert_refused(folder: Path, words: str, *arguments: object) -> None:
    """Refused in one line, and nothing is there that was not, or is other than it was."""
    before = contents(folder)
    ran = procam("compensate", *arguments)
    assert (ran.code, words in ran.complaint, ran.err.count("\n")) == (2, True, 1), ran
    assert contents(folder) == before


FRAMES = ("--to", "projectors")


class TestOverwriting:
    @pytest.mark.parametrize(
        ("source", "out", "more", "words"),
        [
            ("a.plot.png", "b.png", ("--report", "a.csv"), "a.plot.png is IN itself"),
            ("a.png", "b.plot.png", ("--report", "b.csv"), "a file that OUT writes already"),
            ("content.exr", "b.exr", ("--explain", "."), "content.exr is IN itself"),
            ("a.exr", "direct.exr", ("--explain", "."), "a file that OUT writes already"),
            ("a.png", "explained.png", ("--explain", "."), "a file that OUT writes already"),
        ],
    )
    def test_by_a_report_or_an_explanation(
        self, source: str, out: str, more: tuple[str, str], words: str, kept: Path, tmp_path: Path
    ) -> None:
        pytest.importorskip("matplotlib", reason="needs the extra `report`")
        ends = picture(tmp_path / source), tmp_path / out
        asked = more[0], tmp_path / more[1]
        assert_refused(tmp_path, words, kept, *ends, *asked)

    def test_by_an_explanation_through_links(self, kept: Path, tmp_path: Path) -> None:
        pytest.importorskip("matplotlib", reason="needs the extra `report`")
        ends = picture(tmp_path / "sky.0001.png"), tmp_path / "b.png"
        (tmp_path / "why").symlink_to(tmp_path)
        os.link(tmp_path / "sky.0001.png", tmp_path / "limits.exr")
        words = "limits.exr is IN itself"
        assert_refused(tmp_path, words, kept, *ends, "--explain", tmp_path / "why")

    def test_by_a_padding_that_meets_another(self, kept: Path, tmp_path: Path) -> None:
        for number in range(8, 12):
            picture(tmp_path / f"sky.{number}.png")
        ends = tmp_path / "sky.%d.png", tmp_path / "sky.%02d.png"
        assert_refused(tmp_path, "sky.10.png is IN itself", kept, *ends)

    def test_by_another_way_to_the_same_folder(self, kept: Path, tmp_path: Path) -> None:
        source = picture(tmp_path / "in" / "sky.1.png").parent
        (tmp_path / "way").symlink_to(source)
        ends = source, tmp_path / "way"
        assert_refused(tmp_path, "is IN itself", kept, *ends)

    @pytest.mark.parametrize("way", [Path.symlink_to, Path.hardlink_to])
    def test_by_another_name_of_the_same_file(
        self, way: Callable[[Path, Path], None], kept: Path, tmp_path: Path
    ) -> None:
        source, out = picture(tmp_path / "a.png"), tmp_path / "b.png"
        way(out, source)
        assert_refused(tmp_path, "is IN itself", kept, source, out)

    def test_by_frames_of_projectors(self, kept: Path, tmp_path: Path) -> None:
        still = picture(tmp_path / "w2" / "north.png")
        words = "north.png is IN itself"
        assert_refused(tmp_path, words, kept, still, still.parent, *FRAMES)
        for number in range(8, 12):
            picture(tmp_path / "north" / f"sky.{number}.png")
        source = tmp_path / "north" / "sky.%d.png"
        assert_refused(tmp_path, "sky.8.png is IN itself", kept, source, tmp_path, *FRAMES)

    def test_by_movies_of_projectors(self, kept: Path, tmp_path: Path) -> None:
        pytest.importorskip("av", reason="needs the extra `video`")
        source = tmp_path / "south.mkv"
        source.write_bytes(b"a movie")
        assert_refused(tmp_path, "south.mkv is IN itself", kept, source, tmp_path, *FRAMES)

    def test_what_is_apart_is_not_refused(self, tmp_path: Path) -> None:
        source = picture(tmp_path / "a.png")
        refuse_overwriting([source], [("OUT", tmp_path / "b.png"), ("OUT", tmp_path / "c/a.png")])
        with pytest.raises(InputError, match=r"--x: .*b\.png is a file that OUT writes"):
            refuse_overwriting([], [("OUT", tmp_path / "b.png"), ("--x", tmp_path / "c/../b.png")])


class TestExplained:
    def piece(self) -> ClipFrame:
        return ClipFrame(0, "sky", np.asarray(half_sky(SIZE), np.float32), "linear")

    @pytest.mark.parametrize("white", ["summed", "keep"])
    def test_limits_are_against_the_content_under_its_white(
        self, white: str, calibration: Calibration
    ) -> None:
        """At free places what is seen is the target; beyond limits it is above or below it."""
        piece = self.piece()
        found = explain(calibration, piece, FrameSettings(white=white))
        target = Compensator(calibration, SIZE, white=white).target(piece.rgb)
        apart = found.observed - target
        np.testing.assert_allclose(apart[found.limits == 0], 0, atol=1e-5)
        assert (apart[found.limits == 1] > 0).all()
        assert (apart[found.limits == -1] < 0).all()
        assert (found.limits == 0).mean() > 0.3

    def test_what_is_above_the_content_may_be_below_its_white(
        self, calibration: Calibration
    ) -> None:
        """Of white specks little bounces: full light is above 1, and below what the white asks for."""
        rgb = np.zeros((SIZE, SIZE, 3), np.float32)
        rgb[::8, ::8] = 1
        found = explain(
            calibration, ClipFrame(0, "specks", rgb, "linear"), FrameSettings(white="keep")
        )
        between = (found.limits == -1) & (found.observed > rgb)
        assert between.sum() > 9
        target = Compensator(calibration, SIZE, white="keep").target(rgb)
        assert (found.observed < target)[between].all()

    def test_without_compensation_is_todays_picture_under_any_white(
        self, calibration: Calibration
    ) -> None:
        pictures = [
            explain(calibration, self.piece(), FrameSettings(white=w)) for w in ("summed", "keep")
        ]
        np.testing.assert_array_equal(pictures[0].without, pictures[1].without)

    def test_limits_tell_nothing_of_protected_and_unlit_places(
        self, calibration: Calibration
    ) -> None:
        edge = calibration.maps.size
        covered = np.zeros((edge, edge), bool)
        covered[edge // 2 - 8 : edge // 2 + 8, edge // 2 - 8 : edge // 2 + 8] = True
        kept = replace(
            calibration, maps=replace(calibration.maps, protected=Mask("screen", covered))
        )
        found = explain(kept, self.piece(), FrameSettings())
        compensator = Compensator(kept, SIZE)
        unlimited = ~compensator.lit | compensator.protected
        np.testing.assert_array_equal(np.isnan(found.limits).all(axis=-1), unlimited)
        np.testing.assert_array_equal(np.isnan(found.limits).any(axis=-1), unlimited)
        assert compensator.protected.any()

    @pytest.mark.parametrize(("strength", "message"), [(1.0, False), (0.5, True)])
    def test_the_sheet_says_that_it_shows_the_full_result(
        self,
        strength: float,
        message: bool,
        calibration: Calibration,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        pytest.importorskip("matplotlib", reason="needs the extra `report`")
        from procam.interfaces.plots import clip as clip_plot

        sheets: list[Any] = []
        monkeypatch.setattr(clip_plot, "save_figure", lambda figure, path: sheets.append(figure))
        found = explain(calibration, self.piece(), FrameSettings(strength=strength))
        clip_plot.write_explained(tmp_path / "e.png", found, strength)
        titles = [axes.get_title() for axes in sheets[0].axes]
        assert sum("at strength 1" in title for title in titles) == (2 if message else 0)
